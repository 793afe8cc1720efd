"""The points at which a component communicates: all, or the multiples of its own step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master.reserved import Reserved

Integers = NDArray[np.int64]


class ComponentPoints:
    """The own points of one component, as indices of the points of the run.

    The first and the last point of a run are points of every component.

    Parameters
    ----------
    every_ns : its step [ns]; None: it communicates at every point.
    most : room for so many points of the run.

    Attributes
    ----------
    always : whether it communicates at every point.
    last : its latest point at or before each point of the run, int64 (most,).
    following : its next point, at its own points (at the end of the run that point itself); -1
        elsewhere, int64 (most,). It is not known yet at the latest of its points.
    latest : the latest of its points so far; -1 before the first.
    """

    def __init__(self, every_ns: int | None, most: int) -> None:
        self.always = every_ns is None
        self._every_ns = every_ns
        count = 1 if self.always else 2
        self._reserved = [Reserved((most + 1,), np.int64, large_pages=True) for _ in range(count)]
        self.last: Integers = self._reserved[0].array[:-1]
        # the next point of one that communicates at every point is its latest at the next one
        following = self._reserved[0].array[1:] if self.always else self._reserved[1].array[:-1]
        self.following: Integers = following
        self.latest = -1

    def extend(self, points_ns: Integers, first: int, last: int, end_ns: int) -> None:
        """Take over the points first to last - 1 of the run, which ends at `end_ns` [ns]."""
        if first == last:
            return
        if self._every_ns is None:
            _count(first, self.last[first:last])
            self.following[last - 1] = self.latest = last - 1
            return
        here, times = np.arange(first, last), points_ns[first:last]
        mine = (times % self._every_ns == 0) | (times == end_ns)
        own = here[mine]
        self.last[first:last] = np.maximum.accumulate(np.where(mine, here, self.latest))
        self.following[first:last] = -1
        if not own.size:
            return
        if self.latest >= 0:
            self.following[self.latest] = own[0]
        self.following[own[:-1]] = own[1:]
        self.latest = int(own[-1])
        self.following[self.latest] = self.latest

    def copied(self, count: int) -> ComponentPoints:
        """Return a copy of what is known of the first `count` points of the run."""
        found = ComponentPoints(self._every_ns, count)
        found.last[:] = self.last[:count]
        found.following[:] = self.following[:count]
        found.latest = int(found.last[-1]) if count else -1
        return found

    @property
    def own(self) -> Integers:
        """Its points so far, int64 (m,), where nothing was given back."""
        return self.own_between(0, self.latest + 1)

    def own_between(self, first: int, last: int) -> Integers:
        """Return its points among first to last - 1."""
        if self.always:
            return np.arange(first, last)
        return first + np.flatnonzero(self.last[first:last] == np.arange(first, last))

    def give_back(self, before: int) -> None:
        """Give back the memory of the points before this one."""
        for reserved in self._reserved:
            reserved.give_back(before)


_NUMBERS = np.arange(1 << 12)


def _count(first: int, here: Integers) -> None:
    """Fill an array with the numbers from `first` on, without another one of its size."""
    for begin in range(0, here.size, _NUMBERS.size):
        part = here[begin : begin + _NUMBERS.size]
        np.add(_NUMBERS[: part.size], first + begin, out=part)


def own_instants(every_ns: int, after_ns: int, until_ns: int, end_ns: int) -> Integers:
    """Return the multiples of a step, and the end, in (after, until] [ns]."""
    first = (after_ns // every_ns + 1) * every_ns
    found = np.arange(first, min(until_ns, end_ns - 1) + 1, every_ns, dtype=np.int64)
    return np.append(found, np.int64(end_ns)) if after_ns < end_ns <= until_ns else found
