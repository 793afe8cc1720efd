"""The state of a link as its receiver sees it, at any instant.

Before the first delivery the receiver has its initial value, whose age is the time since 0.
While a substitute replaces a lost message, the age is that of the message in use before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

NONE_YET = -1
"""Nothing has been delivered yet: the receiver has its initial value."""

SUBSTITUTE = -2
"""The newest message was lost and the receiver uses `PacketLink.substitute`."""


class LinkState(NamedTuple):
    """State of a link at each of some instants; arrays of their shape.

    Attributes
    ----------
    age_s : time since the message in use was sent [s], float64, never negative; see the
        module for the time before the first delivery and for substitutes.
    sequence : sequence number of the message in use, int64; `NONE_YET` (-1) before the first
        delivery, `SUBSTITUTE` (-2) while the substitute is in use.
    dropped : how many messages and copies were dropped so far, int64: one that the queue
        refused counts from its sending, a lost one from the instant it was due, an overtaken
        one or a duplicate from its arrival.
    delivered : how many were delivered so far, int64.
    """

    age_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    dropped: NDArray[np.int64]
    delivered: NDArray[np.int64]


class Timeline(NamedTuple):
    """What the receiver has after each arrival, in order of time; arrays of shape (m,).

    Of several at one instant the last one counts.

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
        """Return the index of the entry in use at each point, or `NONE_YET`, `SUBSTITUTE`."""
        return _at(self.used, self._after(points_ns), NONE_YET)

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return the state at each point."""
        points = np.asarray(points_ns, np.int64)
        after = self._after(points)
        return LinkState(
            age_s=(points - _at(self.origin_ns, after, 0)) / 1e9,
            sequence=_at(self.sequence, after, NONE_YET),
            dropped=_at(self.dropped, after, 0),
            delivered=_at(self.delivered, after, 0),
        )

    def _after(self, points_ns: ArrayLike) -> NDArray[np.intp]:
        """Return how many arrivals there are up to each point, it included."""
        return np.searchsorted(self.time_ns, np.asarray(points_ns, np.int64), side="right")


def _at(values: NDArray[np.int64], after: NDArray[np.intp], before: int) -> NDArray[np.int64]:
    """Return the value after so many arrivals; `before` where there was none."""
    return np.concatenate((np.array([before], np.int64), values))[after]
