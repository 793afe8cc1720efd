"""What a receiver got or missed, in order of time, and what it has after each of that."""

from __future__ import annotations

from array import array
from bisect import bisect_left
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.network.arrivals import DELIVERED, LOST, ON_MEDIUM, Arrivals
from cosim.network.state import LinkState
from cosim.network.stepping import Arrival, Receiver, Reception, Rules, receive

_SMALL: dict[str, Any] = {"status": np.int8, "changed": np.bool_}
"""Types of the columns of `Received` that take a byte; all others are int64."""


class Received(NamedTuple):
    """Entries that the receiver got or missed, in order of time; arrays of shape (m,).

    Attributes
    ----------
    before : the receiver before the first of them.
    arrival_ns, sent_ns, message, status : of each, as in `Arrivals` (`message`: sequence).
    changed : whether it made another message the one in use, or the substitute, bool.
    sequence, origin_ns, delivered : the receiver after it, as in `LinkState`: the message in use
        or `NONE_YET`, `SUBSTITUTE`; instant of sending of the newest in use so far [ns], 0
        before the first; how many so far; int64.
    """

    before: Receiver | Reception
    arrival_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    message: NDArray[np.int64]
    status: NDArray[np.int8]
    changed: NDArray[np.bool_]
    sequence: NDArray[np.int64]
    origin_ns: NDArray[np.int64]
    delivered: NDArray[np.int64]

    def first(self, count: int) -> Received:
        """Return the first `count` entries, in the same arrays."""
        columns: list[Any] = [column[:count] for column in self[1:]]
        return Received(self.before, *columns)

    def after(self, count: int) -> Receiver:
        """Return the receiver after the first `count` entries; its `newest` is not known."""
        if not count:
            return Receiver(*self.before[:5])
        got = int(self.delivered[count - 1])
        missed = self.before.dropped + count - (got - self.before.delivered)
        k = count - 1
        return Receiver(-1, int(self.sequence[k]), int(self.origin_ns[k]), missed, got)

    def up_to(self, times_ns: ArrayLike) -> NDArray[np.intp]:
        """Return how many entries there are up to each time, it included."""
        return np.searchsorted(self.arrival_ns, np.asarray(times_ns, np.int64), side="right")

    def sent_in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return instants of sending as `GrowingSchedule.sent_in_use`."""
        count = self.up_to(points_ns)
        used = _at(self.sequence, count, self.before.sequence)
        return np.where(used >= 0, _at(self.origin_ns, count, self.before.origin_ns), used)

    def runs_in_use(self, points_ns: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return what `sent_in_use` returns at points in order, and how often one after another."""
        # among many points there are few entries: their places are quicker to find
        first, last = self.up_to(points_ns[[0, -1]])
        sequences = np.append(self.before.sequence, self.sequence)[first : last + 1]
        origins = np.append(self.before.origin_ns, self.origin_ns)[first : last + 1]
        ends = np.searchsorted(points_ns, self.arrival_ns[first:last])
        repeats = np.diff(ends, prepend=0, append=points_ns.size)
        return np.where(sequences >= 0, origins, sequences), repeats

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return the state at each point."""
        points, before = np.asarray(points_ns, np.int64), self.before
        count = self.up_to(points)
        delivered = _at(self.delivered, count, before.delivered)
        return LinkState(
            age_s=(points - _at(self.origin_ns, count, before.origin_ns)) / 1e9,
            sequence=_at(self.sequence, count, before.sequence),
            dropped=before.dropped + before.delivered + count - delivered,
            delivered=delivered,
        )

    def changes(self, first: int = 0, last: int | None = None) -> NDArray[np.intp]:
        """Return the places from `first` to `last` after which another message is in use.

        Of several at one instant the last one.
        """
        places = np.flatnonzero(self.changed[first:last]) + first
        times = self.arrival_ns[places]
        last_there = np.ones(times.size, np.bool_)
        last_there[:-1] = times[1:] != times[:-1]
        found: NDArray[np.intp] = places[last_there]
        return found

    def arrivals(self, first: int = 0) -> Arrivals:
        """Return the entries from the `first`-th on, in arrays of their own."""
        columns = self.arrival_ns, self.sent_ns, self.message, self.status
        return Arrivals._make(column[first:].copy() for column in columns)


def _at(values: NDArray[np.int64], count: NDArray[np.intp], before: int) -> NDArray[np.int64]:
    """Return the value after so many entries; `before` where there was none."""
    if not values.size:
        return np.full(count.shape, before, np.int64)
    return np.where(count > 0, values[count - 1], np.int64(before))


class ReceivedRecord:
    """A growing record of what a receiver got or missed, of which the oldest can be forgotten.

    Attributes
    ----------
    forgotten : how many entries were.
    receiver : after the last entry.
    """

    def __init__(self, rules: Rules) -> None:
        self._rules = rules
        names = Received._fields[1:]
        self._columns = {name: array("b" if name in _SMALL else "q") for name in names}
        self._before: Receiver | Reception = Receiver()
        self.receiver: Receiver | Reception = Receiver()
        self.forgotten = 0

    def received(self) -> Received:
        """Return the entries that were not forgotten, in arrays valid until the next change."""
        columns: list[Any] = [
            np.frombuffer(column, _SMALL.get(name, np.int64))
            for name, column in self._columns.items()
        ]
        return Received(self._before, *columns)

    def extend(self, receiver: Receiver, block: Received) -> None:
        """Append a block of entries, after which this is the receiver."""
        for name, column in self._columns.items():
            column.frombytes(getattr(block, name).view(np.uint8))
        self.receiver = receiver

    def receive(self, time_ns: int, arrival: Arrival) -> None:
        """Receive the next entry in order of time, at one instant in order of sending."""
        on_medium = arrival.fate in ON_MEDIUM
        known = arrival._replace(fate=LOST) if on_medium else arrival
        self.receiver = found = receive(self._rules, self.receiver, known)
        status = arrival.fate if on_medium else found.status
        changed = status == DELIVERED or found.noticed
        now = (time_ns, arrival.sent_ns, arrival.message, status, changed)
        then = (found.sequence, found.origin_ns, found.delivered)
        for column, value in zip(self._columns.values(), now + then, strict=True):
            column.append(value)

    def forget(self, before_ns: int) -> None:
        """Drop the entries before an instant."""
        count = bisect_left(self._columns["arrival_ns"], before_ns)
        self._before = self.received().after(count)
        self.forgotten += count
        for column in self._columns.values():
            del column[:count]

    def copy(self) -> ReceivedRecord:
        """Return a copy that grows independently."""
        twin = copy(self)
        vars(twin).update(_columns={name: column[:] for name, column in self._columns.items()})
        return twin
