"""The schedule of a packet link during a run, in blocks, with as much memory as a block needs.

Known delays are computed for all messages of a block at once (`advance`); a delay that follows a
signal becomes known at the instant of sending, message by message (`resolve`). Everything before
`horizon_ns` is final, since no later message can arrive before it is sent. What lies behind the
run can be forgotten; the statistics count it on.

    known = GrowingSchedule(link, end_ns)
    for each block of points:
        known.advance(last point)
        known.sent_in_use(points)        # the instant of sending of what the receiver has
        known.forget(first point still in use)
    known.statistics(end_ns)

    live = GrowingSchedule(PacketLink("ranging", 10**9, delay=DelaySignal(1 / 1500)), end_ns)
    at each point t:
        while live.horizon_ns == t:
            live.resolve(live.message, range_in_metres)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import Arrivals, PacketSchedule
from cosim.network.state import LinkState


class GrowingSchedule:
    """The schedule of a packet link over [0, end_ns], as far as it is known and remembered.

    Parameters
    ----------
    link : any packet link.
    end_ns : end of the run [ns].
    points_ns : None: instants stay as they are ("align" of `align`). The step of a uniform grid
        [ns], or communication points: sendings and arrivals are rounded up to them ("grid"). Of
        a step no array of points is made.

    Raises
    ------
    InputError : as `sending_instants` and `align`.
    """

    def __init__(
        self, link: PacketLink, end_ns: int, points_ns: int | ArrayLike | None = None
    ) -> None:
        raise NotImplementedError

    @property
    def is_live(self) -> bool:
        """Whether the delay follows a signal, so that messages are resolved one by one."""
        raise NotImplementedError

    @property
    def message(self) -> int:
        """Number of the message to be sent next; the number of all messages when none is left."""
        raise NotImplementedError

    @property
    def horizon_ns(self) -> int:
        """The instant before which everything is final [ns]; 2**63 - 1 when all is.

        Of a live link the instant of sending of the message to be resolved next.
        """
        raise NotImplementedError

    @property
    def oldest_ns(self) -> int:
        """The first instant that can still be asked for [ns]."""
        raise NotImplementedError

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final."""
        raise NotImplementedError

    def resolve(self, message: int, value: float) -> int:
        """Resolve the next message of a live link; return when it arrives [ns]."""
        raise NotImplementedError

    def sendings(self, after_ns: int, until_ns: int) -> NDArray[np.int64]:
        """Return the distinct instants of sending in (after, until] [ns], int64 (n,)."""
        raise NotImplementedError

    def changes(self, after_ns: int, until_ns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the instants in (after, until] at which the message in use changes, and it."""
        raise NotImplementedError

    def sent_in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the instant of sending of the message in use at each point [ns], int64."""
        raise NotImplementedError

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return age, sequence number, and how many were dropped and delivered, at each point."""
        raise NotImplementedError

    def arrivals(self, first: int = 0) -> Arrivals:
        """Return the arrivals and drops that are final, from the `first`-th of the run on."""
        raise NotImplementedError

    def forget(self, before_ns: int) -> None:
        """Drop what concerns only instants before this one."""
        raise NotImplementedError

    def statistics(
        self, end_ns: int, *, broken_off: bool = False
    ) -> dict[str, int | float | None]:
        """Return the statistics of the run that ended at `end_ns`."""
        raise NotImplementedError

    def finish(self, end_ns: int | None = None, *, broken_off: bool = False) -> PacketSchedule:
        """Return the schedule of the run, or of one that ended at `end_ns`."""
        raise NotImplementedError

    def copy(self) -> GrowingSchedule:
        """Return a copy that goes on independently."""
        raise NotImplementedError
