"""The communication points of a run, as far as they are known.

They are known from the start, except where the delay of a link follows a signal of the run: then
the arrival of a message, which is a point, is known only when it is sent. (On a grid, the row
that is read is.) The points are then added from one such sending to the next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master.parts import DelaySource
from cosim.master.system import System
from cosim.network import NONE_YET, Arrivals, LinkState, LiveSchedule, PacketSchedule

Integers = NDArray[np.int64]
Rows = NDArray[np.float64]


class CommunicationPoints:
    """The communication points of a run, and the schedules of its packet links.

    Attributes
    ----------
    points_ns : room for all points [ns], int64 (most,); `count` of them are known.
    seconds, sizes : the points [s], and the step from each to the next [s], (most,).
    final : index of the last point of the run; `most` as long as it is not known.
    values : by live link, the values of its delay signal so far.
    live : the links whose delays follow a signal of the run.
    grows : whether points are added during the run.
    """

    def __init__(self, system: System) -> None:
        comm_schedule = system.comm_schedule
        self._known = comm_schedule.points_ns
        self.grows = bool(comm_schedule.live) and comm_schedule.events == "align"
        self._end_ns = int(self._known[-1])
        self._system = system
        self.live = self._unresolved()
        self._schedules = comm_schedule.schedules
        self._changes = {name: s.changes() for name, s in comm_schedule.schedules.items()}
        self._arrivals: dict[str, Arrivals] = {}
        self.values: dict[str, list[float]] = {name: [] for name in self.live}
        if self.grows:
            # each message, and each copy of one, arrives once at most
            more = sum(2 * live.sent_ns.size for live in self.live.values())
            self.points_ns = np.full(self._known.size + more, self._end_ns, np.int64)
            self.points_ns[0] = 0
            self.seconds = np.zeros(self.points_ns.size)
            self.sizes = np.zeros(self.points_ns.size)
            self._begin()
        else:
            self.points_ns = self._known
            self.seconds = self.points_ns / 1e9
            self.sizes = np.append(np.diff(self.points_ns) / 1e9, 0.0)
            self.count = self.points_ns.size
            self.final = self.count - 1

    def _unresolved(self) -> Mapping[str, LiveSchedule]:
        points = None if self.grows else self._known
        links = self._system.comm_schedule.live
        return {name: LiveSchedule(link, self._end_ns, points) for name, link in links.items()}

    def _begin(self) -> None:
        self.count, self.final, self._place = 1, self.points_ns.size, 1
        self.extend()

    @property
    def horizon(self) -> int:
        """The first point at which a message of unknown delay is sent; `count` without one."""
        instant = min((live.horizon_ns for live in self.live.values()), default=None)
        if instant is None or instant > self._end_ns:
            return self.count
        return int(np.searchsorted(self.points_ns[: self.count], instant))

    def extend(self) -> None:
        """Add the points up to the next horizon, it included, or to the end."""
        if not self.grows or self.final < self.points_ns.size:
            return
        instant = min(live.horizon_ns for live in self.live.values())
        until = min(instant, self._end_ns)
        place = int(np.searchsorted(self._known, until, side="right"))
        known = self._known[self._place : place]
        self._place = place
        after = int(self.points_ns[self.count - 1])
        arrivals = [t for live in self.live.values() for t in _changes(live, after, until)]
        new = np.unique(np.concatenate([known, np.array(arrivals, np.int64)]))
        new = new[new > after]
        first, self.count = self.count, self.count + new.size
        self.points_ns[first : self.count] = new
        self.seconds[first : self.count] = new / 1e9
        begin = first - 1
        self.sizes[begin : self.count - 1] = np.diff(self.points_ns[begin : self.count]) / 1e9
        if self.points_ns[self.count - 1] == self._end_ns:
            self.final = self.count - 1

    def resolve(self, k: int, row: Rows, columns: Mapping[str, tuple[int, ...]]) -> None:
        """Resolve the delays of what is sent at point k, and add the points known by then.

        `columns` : of the signals of each live link in `row`.

        Raises
        ------
        InputError : a value that gives no valid delay; the link and the message are named.
        """
        now = int(self.points_ns[k])
        for name, live in self.live.items():
            source = self._system.delays[name]
            while live.message < live.sent_ns.size and live.sent_ns[live.message] == now:
                value = _value(source, row, columns[name])
                live.resolve(live.message, value)
                self.values[name].append(value)
        self.extend()

    def go_back(self, values: Mapping[str, Sequence[float]]) -> None:
        """Return to the state in which `values` were the values so far."""
        if not self.live:
            return
        self.live = self._unresolved()
        self.values = {name: list(values[name]) for name in self.live}
        if self.grows:
            self._begin()
        while (k := self.horizon) < self.count and self._again(int(self.points_ns[k])):
            self.extend()

    def _again(self, now: int) -> bool:
        """Resolve what was sent at an instant; return whether all of it has values."""
        for name, live in self.live.items():
            while live.message < live.sent_ns.size and live.sent_ns[live.message] == now:
                if live.message >= len(self.values[name]):
                    return False
                live.resolve(live.message, self.values[name][live.message])
        return True

    def rows_of_messages(self, name: str, first: int, last: int) -> Integers:
        """Return the row in use over a packet link at points first to last - 1, as `RowsInUse`."""
        points = self.points_ns[first:last]
        if name in self.live:
            used, sent = self.live[name].state(points).sequence, self.live[name].sent_ns
        else:
            times, messages = self._changes[name]
            place = np.searchsorted(times, points, side="right")
            used, sent = np.append(NONE_YET, messages)[place], self._schedules[name].sent_ns
        used = used.copy()
        real = used >= 0
        used[real] = self.rows_at(sent[used[real]])
        return used

    def rows_at(self, instants_ns: Integers) -> Integers:
        """Return the indices of the points at these instants [ns]."""
        return np.searchsorted(self.points_ns[: self.count], instants_ns)

    def arrivals(self, name: str, first: int) -> Arrivals:
        """Return the known arrivals and drops of a link, from the `first`-th on."""
        if name in self.live:
            return self.live[name].arrivals(first)
        if name not in self._arrivals:
            self._arrivals[name] = self._schedules[name].arrivals()
        return self._arrivals[name].select(slice(first, None))

    def state(self, name: str, first: int, last: int) -> LinkState:
        """Return the state of a packet link at the points first to last - 1."""
        points = self.points_ns[first:last]
        return (self.live.get(name) or self._schedules[name]).state(points)

    def schedules(self, until_ns: int) -> dict[str, PacketSchedule]:
        """Return the schedules of a run that ended at this instant."""
        whole = until_ns == self._end_ns
        done = self._schedules if whole else self._system.comm_schedule.shortened(until_ns)
        # a run that diverges or fails at an instant of sending ends before that message
        live = {n: one.finish(until_ns, broken_off=True) for n, one in self.live.items()}
        return dict(done) | live


def _changes(live: LiveSchedule, after_ns: int, until_ns: int) -> list[int]:
    """Return the instants in (after, until] at which the message in use changes."""
    found = []
    change = live.next_change_ns(after_ns)
    while change is not None and change <= until_ns:
        found.append(change)
        change = live.next_change_ns(change)
    return found


def _value(source: DelaySource, row: Rows, columns: tuple[int, ...]) -> float:
    """Return the value that decides a delay: a signal, or the distance from the origin."""
    values = [float(row[column]) for column in columns]
    if source.origin is None:
        return values[0]
    total = 0.0
    for value, place in zip(values, source.origin, strict=True):
        total += (value - place) * (value - place)
    return math.sqrt(total)
