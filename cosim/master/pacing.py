"""Slow a run down to wall-clock time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError

_NAP_S = 0.05
"""Longest sleep at a time, so that an interrupt takes effect soon."""


class PaceFigures(NamedTuple):
    """How a pace was kept; as the attributes of `Pace`."""

    points: int
    late: int
    largest_s: float
    total_s: float


@dataclass
class Pace:
    """The pace of a run in real time, and how late its points were.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.master import Pace
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> outcome = run(lag, pace=Pace(factor=10.0))  # ten times as fast as real time
        >>> outcome.pace.points, outcome.wall_s > 0.09
        (11, True)

    Parameters
    ----------
    factor : simulated seconds per second of wall-clock time, positive.
    clock, sleep : for tests.

    Attributes
    ----------
    points : number of communication points that were paced.
    late : how many of these were reached later than the next one was due.
    largest_s, mean_s : lateness of the points [s of wall-clock time].
    """

    factor: float = 1.0
    clock: Callable[[], float] = field(default=time.perf_counter, repr=False)
    sleep: Callable[[float], None] = field(default=time.sleep, repr=False)
    points: int = 0
    late: int = 0
    largest_s: float = 0.0
    total_s: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.factor < float("inf"):
            raise InputError(
                "a pace is a positive factor of real time", where="pace", got=f"{self.factor:g}"
            )
        self._began: float | None = None
        self._from_ns = 0

    @property
    def mean_s(self) -> float:
        """Mean lateness [s of wall-clock time]."""
        return self.total_s / self.points if self.points else 0.0

    def wait(
        self, points_ns: NDArray[np.int64], first: int, look: Callable[[], None] | None = None
    ) -> int:
        """Sleep until point `first` is due; return how many points are due then, at least one.

        `look` is called before each nap; what it raises ends the wait.
        """
        if self._began is None:
            self._began, self._from_ns = self.clock(), int(points_ns[first])
        while (rest := self._due(int(points_ns[first])) - self.clock()) > 0.0:
            if look is not None:
                look()
            self.sleep(min(rest, _NAP_S))
        simulated_ns = self._from_ns + (self.clock() - self._began) * 1e9 * self.factor
        due = int(np.searchsorted(points_ns, simulated_ns, side="right")) - first
        return max(1, due)

    def done(self, points_ns: NDArray[np.int64], first: int, last: int) -> None:
        """Record the lateness of the points first to last - 1, which were reached now."""
        now = self.clock()
        due = np.array([self._due(int(t)) for t in points_ns[first : last + 1]])
        late = np.maximum(now - due[: last - first], 0.0)
        self.points += last - first
        self.total_s += float(late.sum())
        self.largest_s = max(self.largest_s, float(late.max(initial=0.0)))
        self.late += int(np.count_nonzero(now > due[1:]))

    @property
    def figures(self) -> PaceFigures:
        """The figures of the pace: how late the points were."""
        return PaceFigures(self.points, self.late, self.largest_s, self.total_s)

    def take(self, figures: PaceFigures) -> None:
        """Take over the figures of a pace that was kept elsewhere."""
        self.points, self.late, self.largest_s, self.total_s = figures

    def _due(self, time_ns: int) -> float:
        assert self._began is not None  # noqa: S101 - set by `wait`
        return self._began + (time_ns - self._from_ns) / 1e9 / self.factor
