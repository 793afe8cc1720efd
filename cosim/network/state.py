"""The state of a link as its receiver sees it, at any instant.

Before the first delivery the receiver has its initial value, whose age is the time since 0.
While a substitute replaces a lost message, the age is that of the message in use before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
        one or a duplicate from its arrival, a late one from the instant of its play-out.
    delivered : how many were delivered so far, int64.
    """

    age_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    dropped: NDArray[np.int64]
    delivered: NDArray[np.int64]
