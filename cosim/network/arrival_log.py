"""What a receiver got or missed, in order of time, and what it has after each of that."""

from __future__ import annotations

from array import array
from bisect import bisect_left
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.network.arrivals import DELIVERED, LOST, ON_MEDIUM, REASONS, Arrivals
from cosim.network.state import SUBSTITUTE, LinkState
from cosim.network.stepping import Arrival, Receiver, Reception, Rules, receive

Integers = NDArray[np.int64]

COLUMNS: Final = (
    *("arrival_ns", "sent_ns", "sequence", "status"),
    *("changes", "used", "origin_ns", "delivered"),
)
"""Of each arrival: as in `Arrivals`; whether another message, or the substitute, is in use after it
(0 or 1); then the receiver after it, `used` being its message in use."""


class Counts(NamedTuple):
    """What was counted of a link from the start of its run.

    Attributes
    ----------
    statuses : how many messages and copies had each status.
    delay_ns, longest_ns : sum and maximum of the delays of what was delivered [ns]; -1 before.
    substitutions : losses after which the substitute came into use.
    oldest_ns : largest age of a message when it was replaced [ns]; -1 before the first.
    """

    statuses: tuple[int, ...] = (0,) * len(REASONS)
    delay_ns: int = 0
    longest_ns: int = -1
    substitutions: int = 0
    oldest_ns: int = -1


class ArrivalLog:
    """A growing log of arrivals, of which the oldest can be forgotten.

    Attributes
    ----------
    forgotten : how many were.
    receiver : after the last one.
    counts : of those that were forgotten.
    """

    def __init__(self, rules: Rules) -> None:
        self._rules = rules
        self._columns = {name: array("q") for name in COLUMNS}
        self._before: Receiver | Reception = Receiver()
        self.receiver: Receiver | Reception = self._before
        self.forgotten, self.counts = 0, Counts()

    def receive(self, time_ns: int, arrival: Arrival) -> None:
        """Receive the next arrival in order of time, at one instant in order of sending."""
        on_medium = arrival.fate in ON_MEDIUM  # lost, to the receiver
        taken = arrival._replace(fate=LOST) if on_medium else arrival
        self.receiver = now = receive(self._rules, self.receiver, taken)
        status = arrival.fate if on_medium else now.status
        changes = now.status == DELIVERED or now.noticed
        row = (time_ns, arrival.sent_ns, arrival.message, status)
        after = (changes, now.sequence, now.origin_ns, now.delivered)
        for column, value in zip(self._columns.values(), row + after, strict=True):
            column.append(value)

    def extend(self, columns: Integers, receiver: Receiver | Reception) -> None:
        """Append arrivals that were received elsewhere, int64 (8, m), after which this is it."""
        for column, values in zip(self._columns.values(), columns, strict=True):
            column.frombytes(values.view(np.uint8).data)
        self.receiver = receiver

    def column(self, name: str) -> Integers:
        """Return one of `COLUMNS`, int64 (m,), valid until the next arrival."""
        return np.frombuffer(self._columns[name], np.int64)

    def up_to(self, times_ns: ArrayLike) -> NDArray[np.intp]:
        """Return how many arrivals there are up to each instant, it included."""
        times = np.asarray(times_ns, np.int64)
        return np.searchsorted(self.column("arrival_ns"), times, side="right")

    def after(self, name: str, counts: NDArray[np.intp]) -> Integers:
        """Return "used", "origin_ns" or "delivered" after so many arrivals."""
        before = self._before.sequence if name == "used" else getattr(self._before, name)
        values = self.column(name)
        if not values.size:
            return np.full(counts.shape, before, np.int64)
        return np.where(counts > 0, values[counts - 1], np.int64(before))

    def sent_in_use(self, counts: NDArray[np.intp]) -> Integers:
        """Return when the message in use after so many arrivals was sent [ns], or what else is."""
        used = self.after("used", counts)
        return np.where(used >= 0, self.after("origin_ns", counts), used)

    def changes(self, first: int, last: int) -> NDArray[np.intp]:
        """Return after how many arrivals, from `first` to `last`, another message is in use.

        Of several at one instant the last one.
        """
        places = np.flatnonzero(self.column("changes")[first:last]) + first
        times = self.column("arrival_ns")[places]
        last_there = np.ones(times.size, np.bool_)
        last_there[:-1] = times[1:] != times[:-1]
        return places[last_there] + 1

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return the state at each point."""
        points = np.asarray(points_ns, np.int64)
        counts = self.up_to(points)
        got, before = self.after("delivered", counts), self._before
        return LinkState(
            age_s=(points - self.after("origin_ns", counts)) / 1e9,
            sequence=self.after("used", counts),
            dropped=before.dropped + before.delivered + counts - got,
            delivered=got,
        )

    def arrivals(self, first: int) -> Arrivals:
        """Return the arrivals from the `first`-th on that is not forgotten, in their own arrays."""
        when, sent, sequence, status = (self.column(name)[first:] for name in COLUMNS[:4])
        return Arrivals(when.copy(), sent.copy(), sequence.copy(), status.astype(np.int8))

    def counted(self, last: int) -> Counts:
        """Return the counts with the first `last` arrivals; all of an instant come together."""
        earlier = self.counts
        status = self.column("status")[:last]
        statuses = np.bincount(status, minlength=len(REASONS)).tolist()
        arrived = status == DELIVERED
        delay = (self.column("arrival_ns")[:last] - self.column("sent_ns")[:last])[arrived]
        changes = self.changes(0, last)
        used_before = np.concatenate(([0], changes))[:-1]
        age = self.column("arrival_ns")[changes - 1] - self.after("origin_ns", used_before)
        age = age[self.after("used", used_before) >= 0]
        substituted = self.column("used")[changes - 1] == SUBSTITUTE
        return Counts(
            statuses=tuple(a + b for a, b in zip(earlier.statuses, statuses, strict=True)),
            delay_ns=earlier.delay_ns + _sum(delay),
            longest_ns=max(earlier.longest_ns, int(delay.max(initial=-1))),
            substitutions=earlier.substitutions + int(np.count_nonzero(substituted)),
            oldest_ns=max(earlier.oldest_ns, int(age.max(initial=-1))),
        )

    def forget(self, before_ns: int) -> None:
        """Drop the arrivals before an instant, and count them on."""
        count = bisect_left(self._columns["arrival_ns"], before_ns)
        if not count:
            return
        self.counts = self.counted(count)
        used, origin, got = (int(self._columns[name][count - 1]) for name in COLUMNS[-3:])
        missed = self._before.dropped + count - (got - self._before.delivered)
        # of the newest message nothing is asked here: the last receiver has it
        self._before = Receiver(used, used, origin, missed, got)
        self.forgotten += count
        for column in self._columns.values():
            del column[:count]


def _sum(values: Integers) -> int:
    """Return the sum of numbers from 0 up, exactly: 64 bits may not hold it."""
    return (int((values >> 32).sum()) << 32) + int((values & 0xFFFFFFFF).sum())
