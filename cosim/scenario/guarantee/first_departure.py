"""Laws of one component: where a run left them for the first time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.scenario.guarantee.departure import Departure

Reals = NDArray[np.float64]

CLOSE = 1e-9
"""Relative size of an error that is rounding."""


def departed(
    instance: ComponentInstance, variable: str, expected: str, got: str, at_ns: int | None = None
) -> Departure:
    """Return a departure of a component at an instant of the run [ns], or for all of it."""
    place = f"{instance.name}.{variable}" if variable else instance.name
    at = None if at_ns is None else instance.comm_points.at_s(int(at_ns))
    return Departure(place, expected, got, at)


def lacking(instance: ComponentInstance, needed: Iterable[str]) -> list[Departure]:
    """Return that a component lacks the first of the variables that its law needs and it has not."""
    ports = instance.component.description.ports
    missing = [name for name in needed if name not in ports]
    words = "a variable of the controller", "there is none"
    return [departed(instance, name, *words) for name in missing[:1]]


def unexplained_by(effects: Reals) -> Reals:
    """Return the projection on what no combination of columns explains; (m, m), symmetric."""
    if not effects.size:
        return np.eye(len(effects))
    return np.asarray(np.eye(len(effects)) - effects @ np.linalg.pinv(effects))
