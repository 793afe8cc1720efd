"""The points at which a component communicates: all, or the multiples of its own step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ComponentPoints:
    """The own points of one component, as indices of the points of the run.

    Attributes
    ----------
    own : its points, int64 (m,); the first and the last of the run are among them.
    last : its latest point at or before each point of the run, int64 (n,).
    following : its next point, at its own points (at the end of the run that point itself); -1
        elsewhere, int64 (n,).
    """

    own: Integers
    last: Integers
    following: Integers

    @property
    def always(self) -> bool:
        """Whether it communicates at every point."""
        return self.own.size == self.last.size


def component_points(every_ns: int | None, points_ns: Integers) -> ComponentPoints:
    """Return the own points of a component with this step [ns]; None: every point.

    Raises
    ------
    InputError : a multiple of the step is not a communication point.
    """
    n = points_ns.size
    if every_ns is None:
        own = np.arange(n)
    else:
        instants = own_instants(every_ns, int(points_ns[-1]))
        own = np.searchsorted(points_ns, instants)
        if (points_ns[own] != instants).any():
            missing = int(instants[np.argmax(points_ns[own] != instants)])
            raise InputError(
                "a component's step does not fall on communication points",
                where="run",
                expected="a communication point at every multiple of the component's step",
                got=f"none at {missing / 1e9:g} s",
                hint="a multiple of the communication step, or events = align",
            )
    last = np.zeros(n, np.int64)
    last[own] = own
    last = np.maximum.accumulate(last)
    following = np.full(n, -1, np.int64)
    following[own] = np.append(own[1:], n - 1)
    return ComponentPoints(own, last, following)


def own_instants(every_ns: int, end_ns: int) -> Integers:
    """Return the multiples of a component's step before the end, and the end [ns]."""
    return np.append(np.arange(0, end_ns, every_ns, dtype=np.int64), np.int64(end_ns))
