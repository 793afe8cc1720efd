"""Laws of one component: where a run left them for the first time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.scenario.guarantee.departure import Departure

Reals = NDArray[np.float64]

CLOSE = 1e-9
"""Relative size of an error that is rounding."""


def departed(
    instance: ComponentInstance, variable: str, expected: str, got: str, at_ns: Any = None
) -> list[Departure]:
    """Return the departure of a component at an instant of the run [ns], or for all of it."""
    place = f"{instance.name}.{variable}" if variable else instance.name
    at = None if at_ns is None else instance.comm_points.at_s(int(at_ns))
    return [Departure(place, expected, got, at)]


def first_departed(
    instance: ComponentInstance,
    names: Sequence[str],
    times: NDArray[np.int64],
    values: tuple[Reals, Reals],
    wrong: NDArray[np.bool_],
    law: str,
) -> list[Departure]:
    """Return the departure of the first values that are wrong; none where all are right.

    times : of the values [ns], (n,); values : expected by a law, and got, (n, names).
    """
    if not wrong.any():
        return []
    k, j = (int(x) for x in np.argwhere(wrong)[0])
    expected, got = (f"{each[k, j]:.9g}" for each in values)
    return departed(instance, names[j], f"{expected}, {law}", got, times[k])


def lacking(instance: ComponentInstance, needed: Iterable[str]) -> list[Departure]:
    """Return that a component lacks a variable that its law needs: the first one; or nothing."""
    ports = instance.component.description.ports
    for name in needed:
        if name not in ports:
            return departed(instance, name, "a variable of the controller", "there is none")
    return []


def unexplained_by(effects: Reals) -> Reals:
    """Return the projection on what no combination of columns explains; (m, m), symmetric."""
    if not effects.size:
        return np.eye(len(effects))
    return np.asarray(np.eye(len(effects)) - effects @ np.linalg.pinv(effects))
