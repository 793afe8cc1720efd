"""The schedule of a packet link over a run: when each message is sent and what becomes of it.

The loop keeps the values sent at point k in row k, and the receiver reads the row that the
schedule names. All times are integer nanoseconds; a run is [0, end_ns], both ends included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.network.messages import Messages
from cosim.network.packet import PacketLink
from cosim.network.state import NONE_YET, SUBSTITUTE, LinkState, Timeline

DELIVERED, LOST, OVERTAKEN, IN_FLIGHT, QUEUE_FULL, DUPLICATE = 0, 1, 2, 3, 4, 5
"""What became of a message by the end of the run (`PacketSchedule.status`)."""

REASONS = ("delivered", "lost", "overtaken", "in flight", "queue full", "duplicate")
"""Names of the values of `status`."""


class Arrivals(NamedTuple):
    """Messages that the receiver got or missed, in order of time; arrays of shape (m,).

    Attributes
    ----------
    arrival_ns : instant at which each arrived, was due, or was refused [ns], int64, never
        decreasing.
    sent_ns : instant of sending [ns], int64.
    sequence : sequence number, int64.
    status : as in `PacketSchedule`, IN_FLIGHT excepted, int8.
    """

    arrival_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    status: NDArray[np.int8]

    def select(self, which: slice | NDArray[np.intp]) -> Arrivals:
        """Return some of the entries."""
        return Arrivals._make(column[which] for column in self)


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
        where the queue refuses it, that of sending.
    delivered_ns : instant of delivery [ns], int64 (n,); -1 if not delivered in the run.
    sequence : sequence number, int64 (n,).
    status : DELIVERED, LOST, OVERTAKEN, IN_FLIGHT, QUEUE_FULL or DUPLICATE, int8 (n,). What
        arrives, or would, after the end is in flight.
    lost : which messages the channel loses, bool (n,); drawn for all, also those in flight at
        the end or refused by the queue.
    copy : which are copies, bool (n,).
    messages : the instants, delays and random draws it was computed from.
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

    def in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the message in use at each point, one delivered there included.

        `NONE_YET` (-1) before the first delivery; `SUBSTITUTE` (-2) where the link's `on_loss`
        value stands in for a lost message (never when it is "hold").
        """
        return self._timeline().in_use(points_ns)

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
        return self._timeline().state(points_ns)

    def statistics(self) -> dict[str, int | float | None]:
        """Return the statistics of the link over the run, JSON-safe.

        sent + duplicated = delivered + dropped + in_flight, and
        dropped = lost + overtaken + queue_full + discarded_copies.

        Returns
        -------
        Keys: `sent` (copies not counted); `delivered`; `dropped`; `lost`; `overtaken`;
        `in_flight` (arrival after the end); `substitutions` (losses after which the `on_loss`
        value came into use); `mean_delay_s`, `max_delay_s` of what was delivered [s];
        `max_age_s` [s], the largest age of a message in use, taken just before it is replaced
        or at the end of the run. The last three are None when nothing was delivered
        (`max_age_s` also when nothing delivered was ever in use). `duplicated` (copies made)
        and `discarded_copies` (second arrivals of a message) are None on a link without
        `duplicate`, `queue_full` on one without `queue_limit`: 0 in both sums.
        """
        counts = np.bincount(self.status, minlength=len(REASONS)).tolist()
        arrived = self.status == DELIVERED
        delay = self.delivered_ns[arrived] - self.sent_ns[arrived]
        times, used = self.changes()
        until = np.append(times, self.end_ns)[1:]
        real = used >= 0
        age = until[real] - self.sent_ns[used[real]]
        copies, has_queue_limit = self.link.duplicate > 0, self.link.queue_limit is not None
        return {
            "sent": self.messages.sent_ns.size,
            "duplicated": int(np.count_nonzero(self.copy)) if copies else None,
            "delivered": counts[DELIVERED],
            "dropped": sum(counts) - counts[DELIVERED] - counts[IN_FLIGHT],
            "lost": counts[LOST],
            "overtaken": counts[OVERTAKEN],
            "queue_full": counts[QUEUE_FULL] if has_queue_limit else None,
            "discarded_copies": counts[DUPLICATE] if copies else None,
            "in_flight": counts[IN_FLIGHT],
            "substitutions": int(np.count_nonzero(used == SUBSTITUTE)),
            "mean_delay_s": sum(delay.tolist()) / delay.size / 1e9 if delay.size else None,
            "max_delay_s": int(delay.max()) / 1e9 if delay.size else None,
            "max_age_s": int(age.max()) / 1e9 if age.size else None,
        }

    def changes(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the instants [ns] at which the message in use changes, and the new `in_use`.

        Two arrays of shape (m,), the instants strictly increasing.
        """
        delivered, noticed = self.status == DELIVERED, self._noticed()
        entries = np.flatnonzero(delivered | noticed)
        times = self.arrival_ns[entries]
        order = np.argsort(times, kind="stable")  # at one instant, the later sent comes last
        entries, times = entries[order], times[order]
        last = np.append(times[1:] != times[:-1], np.ones(min(times.size, 1), np.bool_))
        entries, times = entries[last], times[last]
        return times, np.where(noticed[entries], SUBSTITUTE, entries)

    def arrivals(self) -> Arrivals:
        """Return deliveries and drops in order of time, at one instant in order of sending."""
        entries = Arrivals(self.arrival_ns, self.sent_ns, self.sequence, self.status)
        return entries.select(self._entries_by_arrival())

    def _entries_by_arrival(self) -> NDArray[np.intp]:
        entries = np.flatnonzero(self.status != IN_FLIGHT)
        return entries[np.argsort(self.arrival_ns[entries], kind="stable")]

    def _noticed(self) -> NDArray[np.bool_]:
        """Return the losses that bring the substitute into use: nothing newer came before."""
        if self.link.on_loss == "hold":
            return np.zeros(self.status.size, np.bool_)
        newer = earliest_newer(self.arrival_ns, self.copy, self.status == DELIVERED)
        result: NDArray[np.bool_] = (self.status == LOST) & (newer > self.arrival_ns)
        return result

    def _timeline(self) -> Timeline:
        entries = self._entries_by_arrival()
        delivered, noticed = (self.status == DELIVERED)[entries], self._noticed()[entries]
        used = _last_values(np.where(noticed, SUBSTITUTE, entries), delivered | noticed, NONE_YET)
        return Timeline(
            time_ns=self.arrival_ns[entries],
            used=used,
            sequence=np.where(used >= 0, np.append(self.sequence, 0)[used], used),
            origin_ns=_last_values(self.sent_ns[entries], delivered, 0),
            dropped=np.cumsum(~delivered, dtype=np.int64),
            delivered=np.cumsum(delivered, dtype=np.int64),
        )


def earliest_newer(
    arrival_ns: NDArray[np.int64], copy: NDArray[np.bool_], counts: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the earliest arrival of a newer message that counts [ns]; 2**63 - 1 for none."""
    never = np.iinfo(np.int64).max
    earliest = np.minimum.accumulate(np.where(counts, arrival_ns, never)[::-1])[::-1]
    following = np.arange(1, copy.size + 1)
    following[:-1] += copy[1:]  # the copy of a message is not newer than itself
    return np.append(earliest, never)[following]


def _last_values(
    values: NDArray[np.int64], there: NDArray[np.bool_], before: int
) -> NDArray[np.int64]:
    """Return at each place the last value that is there; `before` ahead of the first."""
    last = np.maximum.accumulate(np.where(there, np.arange(1, values.size + 1), 0))
    return np.concatenate((np.array([before], np.int64), values))[last]
