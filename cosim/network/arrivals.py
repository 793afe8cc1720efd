"""What becomes of the messages of a link, and the record of it in order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

DELIVERED = 0
"""Status of a message that the receiver accepted (`Arrivals.status`)."""

LOST = 1
"""Status of a message that the channel lost."""

OVERTAKEN = 2
"""Status of a message that came after a newer one."""

IN_FLIGHT = 3
"""Status of a message that had not arrived when the run ended."""

QUEUE_FULL = 4
"""Status of a message that found the queue of its sender full."""

DUPLICATE = 5
"""Status of a second copy of a message."""

LATE = 6
"""Status of a message that came after its play-out."""

COLLIDED = 7
"""Status of a message on a medium that overlapped with another one at its receiver."""

RECEIVER_SENDING = 8
"""Status of a message on a medium whose receiver was sending, or had just sent."""

OUT_OF_RANGE = 9
"""Status of a message on a medium that was sent too far away from its receiver."""

ON_MEDIUM = (COLLIDED, RECEIVER_SENDING, OUT_OF_RANGE)
"""What a medium makes of messages beside losing them; to the receiver they are lost."""

NOT_RECEIVED = (LOST, QUEUE_FULL, LATE, *ON_MEDIUM)
"""What became of messages that the receiver missed, though no newer one made them useless."""

REASONS = (
    *("delivered", "lost", "overtaken", "in flight", "queue full", "duplicate", "late"),
    *("collided", "receiver sending", "out of range"),
)
"""Names of the values of `status`."""


class Arrivals(NamedTuple):
    """Messages that the receiver got or missed, in order of time; arrays of shape (m,).

    Attributes
    ----------
    arrival_ns : instant at which each arrived, was released (`playout`), was due, or was refused
        [ns], int64, never decreasing.
    sent_ns : instant of sending [ns], int64.
    sequence : sequence number, int64.
    status : what became of each, one of those above, int8.
    """

    arrival_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    status: NDArray[np.int8]

    def select(self, which: slice | NDArray[np.intp]) -> Arrivals:
        """Return some of the entries."""
        return Arrivals._make(column[which] for column in self)
