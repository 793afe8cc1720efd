"""The schedule of a packet link over a run: when each message is sent and what becomes of it.

The loop keeps the values sent at point k in row k, and the receiver reads the row that the
schedule names. All times are integer nanoseconds; a run is [0, end_ns], both ends included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.network.arrivals import DELIVERED, Arrivals
from cosim.network.messages import Messages
from cosim.network.packet import PacketLink
from cosim.network.received import Received
from cosim.network.state import NONE_YET, SUBSTITUTE, LinkState
from cosim.network.tally import Statistics, Tally


@dataclass(frozen=True, slots=True, eq=False)
class PacketSchedule:
    """The messages of a link and their copies: instants, and what becomes of each.

    Without copies message k has index k in every array; a copy stands at the index after its
    original. `sequence` is the number of the message either way.

    Parameters
    ----------
    link : the link.
    end_ns : end of the run [ns].
    sent_ns : instant of sending [ns], int64 (n,); that of its original for a copy.
    transit_ns : delay + jitter [ns], int64 (n,), also of those that are lost.
    arrival_ns : instant at which the message arrives or would have [ns], int64 (n,): sending,
        the sender's queue (`data_rate`), transit, and under fifo waiting for its predecessors;
        with `playout`, that at which it is released or missed; where the queue refuses it, that
        of sending.
    delivered_ns : instant of delivery [ns], int64 (n,); -1 if not delivered in the run.
    sequence : sequence number, int64 (n,).
    status : DELIVERED, LOST, OVERTAKEN, IN_FLIGHT, QUEUE_FULL, DUPLICATE or LATE, int8 (n,).
        What arrives, or would, after the end is in flight.
    lost : which messages the channel loses, bool (n,); drawn for all, also those in flight at
        the end or refused by the queue.
    copy : which are copies, bool (n,).
    messages : the instants, delays and random draws it was computed from.
    received : all but those in flight, in order of time; `order` : their indices, int (m,).
    """

    link: PacketLink
    end_ns: int
    sent_ns: NDArray[np.int64]
    transit_ns: NDArray[np.int64]
    arrival_ns: NDArray[np.int64]
    delivered_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    status: NDArray[np.int8]
    lost: NDArray[np.bool_]
    copy: NDArray[np.bool_]
    messages: Messages
    received: Received
    order: NDArray[np.intp]

    def in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the message in use at each point, one delivered there included.

        `NONE_YET` (-1) before the first delivery; `SUBSTITUTE` (-2) where the link's `on_loss`
        value stands in for a lost message (never when it is "hold").
        """
        times, used = self.changes()
        place = np.searchsorted(times, np.asarray(points_ns, np.int64), side="right")
        return np.append(NONE_YET, used)[place]

    def rows(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the sender's row in use at each point, -1 and -2 as in `in_use`.

        Row k of the sender belongs to points_ns[k].

        Raises
        ------
        InputError : a message is sent between two points; `align` first.
        """
        points = np.asarray(points_ns, np.int64)
        sent_rows = np.searchsorted(points, self.sent_ns)
        found = np.append(points, -1)[sent_rows] == self.sent_ns
        if not found.all():
            k = int(np.argmin(found))
            raise InputError(
                "a message is sent between two communication points",
                where=f"link {self.link.name!r}, message {self.sequence[k]}",
                expected="a communication point at the instant of sending",
                got=f"{self.sent_ns[k]} ns",
                hint="call align() with the points and use the schedules it returns",
            )
        rows = self.in_use(points)
        rows[rows >= 0] = sent_rows[rows[rows >= 0]]
        return rows

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return age, sequence number, and how many were dropped and delivered, at each point."""
        return self.received.state(points_ns)

    def statistics(self) -> Statistics:
        """Return the statistics of the link over the run, JSON-safe.

        sent + duplicated = delivered + dropped + in_flight, and
        dropped = lost + overtaken + late + queue_full + discarded_copies.

        Returns
        -------
        Keys: `sent` (copies not counted); `delivered`; `dropped`; `lost`; `overtaken`;
        `in_flight` (arrival after the end); `substitutions` (losses after which the `on_loss`
        value came into use); `mean_delay_s`, `max_delay_s` of what was delivered [s];
        `max_age_s` [s], the largest age of a message in use, taken just before it is replaced
        or at the end of the run. The last three are None when nothing was delivered
        (`max_age_s` also when nothing delivered was ever in use). `duplicated` (copies made)
        and `discarded_copies` (second arrivals of a message) are None on a link without
        `duplicate`, `late` on one without `playout`, `queue_full` on one without `queue_limit`: 0
        in both sums.
        """
        sent, copies = self.messages.sent_ns.size, int(np.count_nonzero(self.copy))
        last = self.received.after(self.received.message.size)
        tally = Tally().counted(self.received)
        return tally.statistics(self.link, sent, copies, self.end_ns, last)

    def changes(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the instants [ns] at which the message in use changes, and the new `in_use`.

        Two arrays of shape (m,), the instants strictly increasing.
        """
        received, places = self.received, self.received.changes()
        delivered = received.status[places] == DELIVERED
        return received.arrival_ns[places], np.where(delivered, self.order[places], SUBSTITUTE)

    def arrivals(self) -> Arrivals:
        """Return deliveries and drops in order of time, at one instant in order of sending."""
        return self.received.arrivals()
