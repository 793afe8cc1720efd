"""Laws of one component: where a run left them for the first time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.measure import Measure

Reals = NDArray[np.float64]

CLOSE = 1e-9
"""Relative size of an error that is rounding."""


class FirstDeparture(Measure[list[Departure]]):
    """Where a component left its law for the first time; empty if it never did.

    A law binds the variables that it needs (`bind`), and compares rows (`compare`) until it finds
    the first one that is not by the law (`depart`).

    Parameters
    ----------
    component : its name.
    needed : variables without which there is no such law.
    """

    def __init__(self, component: str, needed: Iterable[str] = ()) -> None:
        self._component, self._needed = component, tuple(needed)
        self._found: Departure | None = None
        self._bound = False
        self._instance: ComponentInstance
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find what the law is about."""
        instance = next((one for one in instances if one.name == self._component), None)
        if instance is None:
            return
        self._instance = instance
        ports = instance.component.description.ports
        missing = next((name for name in self._needed if name not in ports), None)
        if missing is not None:
            self.depart(missing, "a variable of the controller", "there is none")
            return
        self.bind(instance)
        self._bound = True

    def bind(self, instance: ComponentInstance) -> None:
        """Find the columns of the variables."""
        raise NotImplementedError

    def add(self, first: int, last: int) -> None:
        """Compare at the points, until the law was left."""
        if self._bound and self._found is None:
            self.compare(first, last)

    def compare(self, first: int, last: int) -> None:
        """Compare the points first to last - 1."""
        raise NotImplementedError

    def depart(self, variable: str, expected: str, got: str, at_ns: int | None = None) -> None:
        """Keep a departure, if it is the first; `at_ns` : instant of the run [ns]."""
        if self._found is None:
            place = f"{self._component}.{variable}" if variable else self._component
            at = None if at_ns is None else self._instance.comm_points.at_s(int(at_ns))
            self._found = Departure(place, expected, got, at)

    def result(self, run: Run) -> list[Departure]:
        """Return where the law was left."""
        del run
        return [] if self._found is None else [self._found]


def unexplained_by(effects: Reals) -> Reals:
    """Return the projection on what no combination of columns explains; (m, m), symmetric."""
    if not effects.size:
        return np.eye(len(effects))
    return np.asarray(np.eye(len(effects)) - effects @ np.linalg.pinv(effects))
