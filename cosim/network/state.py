"""The state of a link as its receiver sees it, at any instant: for signals, and for the loop.

Before the first delivery the receiver has its initial value, which is as old as the run: its
age is the time since 0. While a substitute stands in for a lost message, the age is that of
the message in use before it: nothing newer is known.
"""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

NONE_YET = -1
"""Nothing has been delivered yet: the receiver has its initial value."""

SUBSTITUTE = -2
"""The newest message was lost and the receiver uses `PacketLink.substitute`."""


class LinkState(NamedTuple):
    """State of a link at each of some instants; arrays of their shape.

    Attributes
    ----------
    age_s : time since what the receiver has was sent [s], float64, never negative; see above
        for what it is before the first delivery and during a substitute.
    sequence : sequence number of the message in use, int64; `NONE_YET` (-1) before the first
        delivery, `SUBSTITUTE` (-2) while the substitute is in use.
    dropped : how many messages and copies were dropped so far, int64: a lost one (or one
        that the full queue refused) from the instant it was due, an overtaken one or a
        duplicate from its arrival.
    delivered : how many were delivered so far, int64.
    """

    age_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    dropped: NDArray[np.int64]
    delivered: NDArray[np.int64]


class Timeline(NamedTuple):
    """What the receiver knows after each arrival, in order of time; arrays of shape (m,).

    Of several at one instant, the last says what holds from there on.

    Attributes
    ----------
    time_ns : instant of the arrival, or at which a loss was due [ns], int64.
    used : index of the entry in use from then on, or `NONE_YET`, `SUBSTITUTE`, int64.
    sequence : its sequence number, or the same two, int64.
    origin_ns : instant of sending of the newest in use so far; 0 before the first [ns], int64.
    dropped, delivered : how many so far, int64.
    """

    time_ns: NDArray[np.int64]
    used: NDArray[np.int64]
    sequence: NDArray[np.int64]
    origin_ns: NDArray[np.int64]
    dropped: NDArray[np.int64]
    delivered: NDArray[np.int64]

    def in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Index of the entry in use at each point, or `NONE_YET`, `SUBSTITUTE`."""
        return _at(self.used, self._after(points_ns), NONE_YET)

    def state(self, points_ns: ArrayLike) -> LinkState:
        """State at each point."""
        points = np.asarray(points_ns, np.int64)
        after = self._after(points)
        return LinkState(
            age_s=(points - _at(self.origin_ns, after, 0)) / 1e9,
            sequence=_at(self.sequence, after, NONE_YET),
            dropped=_at(self.dropped, after, 0),
            delivered=_at(self.delivered, after, 0),
        )

    def _after(self, points_ns: ArrayLike) -> NDArray[np.intp]:
        """How many arrivals there are up to each point, it included."""
        return np.searchsorted(self.time_ns, np.asarray(points_ns, np.int64), side="right")


class GrowingTimeline:
    """A `Timeline` that is written as the run goes.

    Besides: `message` and `status` of each arrival, and `change_ns`, the instants at which what
    is in use changed.
    """

    def __init__(self) -> None:
        self.message, self.status = array("q"), array("b")
        self.time_ns, self.used, self.sequence = array("q"), array("q"), array("q")
        self.origin_ns, self.dropped, self.delivered = array("q"), array("q"), array("q")
        self.change_ns = array("q")

    def dropped_at(self, time_ns: int, message: int, status: int, *, substituted: bool) -> None:
        """Write that one was missed or discarded; whether the substitute takes over."""
        used, sequence, origin = self._last(self.used, self.sequence, self.origin_ns)
        if substituted:
            used = sequence = SUBSTITUTE
            self._changed(time_ns)
        self._add(time_ns, used, sequence, origin, delivered=0)
        self.message.append(message)
        self.status.append(status)

    def delivered_at(
        self, time_ns: int, message: int, status: int, *, entry: int, sent_ns: int
    ) -> None:
        """Write that one was delivered; its index, and when it was sent."""
        self._changed(time_ns)
        self._add(time_ns, entry, message, sent_ns, delivered=1)
        self.message.append(message)
        self.status.append(status)

    def timeline(self) -> Timeline:
        """What was written so far, as arrays that last until more is written."""
        return Timeline(*(np.frombuffer(a, np.int64) for a in self._columns()))

    def _columns(self) -> tuple[array[int], ...]:
        return (
            self.time_ns,
            self.used,
            self.sequence,
            self.origin_ns,
            self.dropped,
            self.delivered,
        )

    def _last(self, *columns: array[int]) -> tuple[int, ...]:
        return tuple(a[-1] for a in columns) if self.time_ns else (NONE_YET, NONE_YET, 0)

    def _changed(self, time_ns: int) -> None:
        if not self.change_ns or self.change_ns[-1] != time_ns:
            self.change_ns.append(time_ns)

    def _add(
        self, time_ns: int, used: int, sequence: int, origin_ns: int, *, delivered: int
    ) -> None:
        so_far = (self.dropped[-1], self.delivered[-1]) if self.time_ns else (0, 0)
        new = (time_ns, used, sequence, origin_ns, so_far[0] + 1 - delivered)
        for column, value in zip(self._columns(), (*new, so_far[1] + delivered), strict=True):
            column.append(value)


def _at(values: NDArray[np.int64], after: NDArray[np.intp], before: int) -> NDArray[np.int64]:
    """The value after so many arrivals; `before` where there was none."""
    return np.concatenate((np.array([before], np.int64), values))[after]
