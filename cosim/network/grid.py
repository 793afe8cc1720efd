"""The communication points to which the instants of a link are rounded up."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.network.checks import check_duration


class Grid(Protocol):
    """Communication points from 0 to the end of a run [ns]."""

    def up(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the first point at or after each time; times after the last point stay."""
        ...

    def up_one(self, time_ns: int) -> int:
        """Return `up` of one time."""
        ...

    def down(self, time_ns: int) -> int:
        """Return the last point at or before a time; -1 before the first."""
        ...

    def cut(self, end_ns: int) -> Grid:
        """Return the points of a run that ends earlier, at one of them."""
        ...


class UniformGrid:
    """The multiples of a step up to the end, and the end itself; of 1 ns, every instant.

    Nothing is kept of the points, so that a run of any length needs no memory for them.
    """

    def __init__(self, step_ns: int, end_ns: int) -> None:
        check_duration("align: step", step_ns, minimum=1)
        self._step, self._end = int(step_ns), int(end_ns)

    def up(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the first point at or after each time; times after the last point stay."""
        if self._step == 1:
            return times_ns
        multiple = -(-times_ns // self._step) * self._step
        return np.where(times_ns > self._end, times_ns, np.minimum(multiple, self._end))

    def up_one(self, time_ns: int) -> int:
        """Return `up` of one time."""
        if time_ns > self._end:
            return time_ns
        return min(-(-time_ns // self._step) * self._step, self._end)

    def down(self, time_ns: int) -> int:
        """Return the last point at or before a time; -1 before the first."""
        if time_ns < 0:
            return -1
        return self._end if time_ns >= self._end else time_ns // self._step * self._step

    def cut(self, end_ns: int) -> UniformGrid:
        """Return the points of a run that ends earlier, at one of them."""
        return UniformGrid(self._step, end_ns)


class PointGrid:
    """Any communication points, strictly increasing from 0 to the end [ns], int64 (n,)."""

    def __init__(self, points_ns: NDArray[np.int64]) -> None:
        self._points = points_ns

    def up(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the first point at or after each time; times after the last point stay."""
        place = np.searchsorted(self._points, times_ns)
        inside = place < self._points.size
        return np.where(inside, self._points[np.where(inside, place, 0)], times_ns)

    def up_one(self, time_ns: int) -> int:
        """Return `up` of one time."""
        place = int(self._points.searchsorted(time_ns))
        return int(self._points[place]) if place < self._points.size else time_ns

    def down(self, time_ns: int) -> int:
        """Return the last point at or before a time; -1 before the first."""
        place = int(self._points.searchsorted(time_ns, side="right"))
        return int(self._points[place - 1]) if place else -1

    def cut(self, end_ns: int) -> PointGrid:
        """Return the points of a run that ends earlier, at one of them."""
        return PointGrid(self._points[self._points <= end_ns])


def grid_of(points_ns: int | ArrayLike | None, end_ns: int) -> Grid:
    """Return the grid of a step [ns], of communication points, or, None, of every instant.

    Raises
    ------
    InputError : a step that is no positive integer, points out of order or of another run.
    """
    if points_ns is None:
        return UniformGrid(1, end_ns)
    if isinstance(points_ns, (int, np.integer)):
        return UniformGrid(int(points_ns), end_ns)
    return PointGrid(communication_points(points_ns, end_ns))


def communication_points(points_ns: int | ArrayLike, end_ns: int | None) -> NDArray[np.int64]:
    """Check communication points, or lay out a grid for a step; int64 (n,)."""
    if isinstance(points_ns, (int, np.integer)):
        check_duration("align: step", points_ns, minimum=1)
        if end_ns is None:
            raise InputError(
                "with a step alone the end of the run is unknown",
                where="align",
                expected="at least one schedule, or the points themselves",
                got="no schedule",
            )
        return np.append(np.arange(0, end_ns, points_ns, dtype=np.int64), end_ns)
    points = np.asarray(points_ns)
    right = points.ndim == 1 and points.size > 0 and np.issubdtype(points.dtype, np.integer)
    if not right or points[0] != 0 or (np.diff(points) <= 0).any():
        raise InputError(
            "communication points out of order",
            where="align",
            expected="integers [ns], strictly increasing from 0",
            got=f"array of {points.dtype}, shape {points.shape}",
        )
    if end_ns is not None and points[-1] != end_ns:
        raise InputError(
            "the communication points do not end where the schedules do",
            where="align",
            expected=f"last point {end_ns} ns",
            got=f"{points[-1]} ns",
        )
    return points.astype(np.int64)
