"""The traffic of a packet link over a whole run, known before the run starts.

Delay, jitter and loss do not depend on the values sent, so neither does the schedule: which
message is sent, which arrives, and when. The loop keeps every value sent in row k of an array
and the receiver reads the row that the schedule names: the trace is the delay line.

All times are integer nanoseconds; a run is [0, end_ns], both ends included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.network import draws
from cosim.network.packet import PacketLink, check_duration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

DELIVERED, LOST, OVERTAKEN, IN_FLIGHT = 0, 1, 2, 3
"""What became of a message by the end of the run (`PacketSchedule.status`)."""

REASONS = ("delivered", "lost", "overtaken", "in flight")
"""`status` in words."""

NONE_YET = -1
"""Nothing has been delivered yet: the receiver has its initial value."""

SUBSTITUTE = -2
"""The newest message was lost and the receiver uses `PacketLink.substitute`."""

MAX_MESSAGES = 50_000_000
"""More messages than this on one link is taken for a mistake in the units."""


@dataclass(frozen=True, slots=True, eq=False)
class PacketSchedule:
    """What happens to each message of a link; message k has index k in every array.

    Parameters
    ----------
    link : the link.
    end_ns : end of the run [ns].
    sent_ns : instant of sending [ns], int64 (n,).
    transit_ns : delay + jitter [ns], int64 (n,), also of those that are lost.
    arrival_ns : instant at which the message arrives or would have [ns], int64 (n,): sending,
        the sender's queue (`data_rate`), transit, and under fifo waiting for its predecessors.
    delivered_ns : instant of delivery [ns], int64 (n,); -1 if it was not delivered in the run
        (lost, overtaken, or in flight at the end).
    sequence : sequence number, int64 (n,).
    status : DELIVERED, LOST, OVERTAKEN or IN_FLIGHT, int8 (n,). A message whose arrival lies
        after the end is in flight, whatever would have become of it.
    lost : which messages the channel loses, bool (n,), in flight at the end or not.
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

    def in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Index of the message in use at each point; a message delivered at t is in use at t.

        `NONE_YET` (-1) before the first delivery; `SUBSTITUTE` (-2) where the link's `on_loss`
        value stands in for a lost message (never when it is "hold").
        """
        times, messages = self.changes()
        place = np.searchsorted(times, np.asarray(points_ns, np.int64), side="right")
        return np.concatenate(([NONE_YET], messages))[place]

    def rows(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Row of the sender's array that is in use at each point, -1 and -2 as in `in_use`.

        Row k of the sender belongs to points_ns[k].

        Raises
        ------
        InputError : a message is sent between two points; `align` first.
        """
        used = self.in_use(points_ns)
        sent_rows = self.sent_rows(points_ns)
        rows = used.copy()
        rows[used >= 0] = sent_rows[used[used >= 0]]
        return rows

    def sent_rows(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Row (index of the communication point) at which each message is sent, int64 (n,).

        Raises
        ------
        InputError : a message is sent between two points; `align` first.
        """
        points = np.asarray(points_ns, np.int64)
        rows = np.searchsorted(points, self.sent_ns)
        found = np.append(points, -1)[rows] == self.sent_ns
        if not found.all():
            k = int(np.argmin(found))
            raise InputError(
                "a message is sent between two communication points",
                where=f"link {self.link.name!r}, message {k}",
                expected="a communication point at the instant of sending",
                got=f"{self.sent_ns[k]} ns",
                hint="call align() with the points and use the schedules it returns",
            )
        return rows

    def age_ns(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Time since the message in use was sent [ns]; -1 where none is in use."""
        points = np.asarray(points_ns, np.int64)
        used = self.in_use(points)
        age = np.full(points.shape, -1, np.int64)
        age[used >= 0] = points[used >= 0] - self.sent_ns[used[used >= 0]]
        return age

    def statistics(self) -> dict[str, int | float | None]:
        """Figures of the link over the run, JSON-safe.

        sent = delivered + dropped + in_flight. Keys: `sent`; `delivered`; `dropped` = `lost` +
        `overtaken`; `in_flight` (arrival after the end); `substitutions` (losses after which
        the `on_loss` value came into use); `mean_delay_s`, `max_delay_s` of the delivered
        messages [s]; `max_age_s` [s], the largest age of a message in use, taken just before
        it is replaced or at the end of the run. The last three are None when nothing was
        delivered (`max_age_s` also when nothing delivered was ever in use).
        """
        counts = np.bincount(self.status, minlength=4)
        arrived = self.status == DELIVERED
        delay = self.delivered_ns[arrived] - self.sent_ns[arrived]
        times, messages = self.changes()
        until = np.append(times, self.end_ns)[1:]
        real = messages >= 0
        age = until[real] - self.sent_ns[messages[real]]
        return {
            "sent": int(self.sent_ns.size),
            "delivered": int(counts[DELIVERED]),
            "dropped": int(counts[LOST] + counts[OVERTAKEN]),
            "lost": int(counts[LOST]),
            "overtaken": int(counts[OVERTAKEN]),
            "in_flight": int(counts[IN_FLIGHT]),
            "substitutions": int(np.count_nonzero(messages == SUBSTITUTE)),
            "mean_delay_s": sum(delay.tolist()) / delay.size / 1e9 if delay.size else None,
            "max_delay_s": int(delay.max()) / 1e9 if delay.size else None,
            "max_age_s": int(age.max()) / 1e9 if age.size else None,
        }

    def changes(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Instants [ns] at which what is in use changes, and to what (as in `in_use`).

        Two arrays of shape (m,), the instants strictly increasing.
        """
        counts = self.status == DELIVERED
        if self.link.on_loss != "hold":
            counts = counts | _noticed(self)
        messages = np.flatnonzero(counts)
        times = self.arrival_ns[messages]
        order = np.argsort(times, kind="stable")  # at one instant, the later sent comes last
        messages, times = messages[order], times[order]
        last = np.append(times[1:] != times[:-1], np.ones(min(times.size, 1), np.bool_))
        messages, times = messages[last], times[last]
        return times, np.where(self.status[messages] == LOST, SUBSTITUTE, messages)


class Alignment(NamedTuple):
    """Communication points, and the schedules whose sends and deliveries all lie on them."""

    points_ns: NDArray[np.int64]
    schedules: tuple[PacketSchedule, ...]


def schedule(link: PacketLink, end_ns: int) -> PacketSchedule:
    """Schedule of every message sent in [0, end_ns], in exact integer nanoseconds.

    A longer run begins with the same messages, delays and losses.

    Raises
    ------
    InputError : `end_ns` is no duration, or so many messages that the units must be wrong.
    """
    check_duration(f"link {link.name!r}: end_ns", end_ns)
    count = max(0, (int(end_ns) - int(link.offset_ns)) // int(link.sample_time_ns) + 1)
    if count > MAX_MESSAGES:
        raise InputError(
            "too many messages",
            where=f"link {link.name!r}",
            expected=f"at most {MAX_MESSAGES} in a run",
            got=f"{count}: one each {link.sample_time_ns} ns up to {end_ns} ns",
            hint="times are in nanoseconds",
        )
    sent = link.offset_ns + np.arange(count, dtype=np.int64) * link.sample_time_ns
    transit = link.delay_ns + draws.jitter_ns(link.jitter, link.seed, link.name, count)
    if count * link.frame_ns >= 2**62:
        raise InputError(
            "the messages take longer to send than can be counted",
            where=f"link {link.name!r}: data_rate",
            expected="less than 2**62 ns for all messages of the run",
            got=f"{count} messages of {link.frame_ns} ns",
            hint="data_rate is in bit/s, frame_size in bits",
        )
    lost = draws.lost(link.loss, link.seed, link.name, count)
    return _resolve(link, int(end_ns), sent, transit, lost)


def align(
    schedules: Sequence[PacketSchedule],
    points_ns: int | ArrayLike,
    policy: Literal["align", "grid"] = "align",
) -> Alignment:
    """Bring communication points and schedules together.

    Parameters
    ----------
    schedules : of all the links of one run (same end_ns).
    points_ns : communication points [ns], strictly increasing from 0 to end_ns; or the step
        [ns] of a uniform grid (its multiples up to end_ns, and end_ns itself).
    policy : "align": every instant of sending, of delivery and of a noticed loss (`on_loss`
        other than "hold") becomes a point, and the schedules stay as they are. "grid": the
        points stay; a message is sent at the first point at or after its instant, and arrives
        at the first point at or after that plus delay plus jitter, so that it is never early.

    Raises
    ------
    InputError : unknown policy, schedules of different runs, points out of order.
    """
    if policy not in ("align", "grid"):
        raise InputError(
            "unknown policy", where="align", expected="align or grid", got=repr(policy)
        )
    ends = {s.end_ns for s in schedules}
    if len(ends) > 1:
        raise InputError(
            "the schedules belong to runs of different length",
            where="align",
            expected="one end_ns",
            got=", ".join(f"{s.link.name}: {s.end_ns} ns" for s in schedules),
        )
    points = _points(points_ns, ends.pop() if ends else None)
    if policy == "grid":
        return Alignment(points, tuple(_on_grid(s, points) for s in schedules))
    instants = [points]
    for s in schedules:
        instants += [s.sent_ns, s.changes()[0]]
    return Alignment(np.unique(np.concatenate(instants)), tuple(schedules))


def _points(points_ns: int | ArrayLike, end_ns: int | None) -> NDArray[np.int64]:
    if isinstance(points_ns, (int, np.integer)):
        check_duration("align: step", points_ns, minimum=1)
        if end_ns is None:
            raise InputError(
                "a step alone does not say where the run ends",
                where="align",
                expected="at least one schedule, or the points themselves",
                got="no schedule",
            )
        return np.append(np.arange(0, end_ns, points_ns, dtype=np.int64), end_ns)
    points = np.asarray(points_ns)
    right = points.ndim == 1 and points.size > 0 and np.issubdtype(points.dtype, np.integer)
    if not right or points[0] != 0 or (np.diff(points) <= 0).any():
        raise InputError(
            "communication points out of order",
            where="align",
            expected="integers [ns], strictly increasing from 0",
            got=f"array of {points.dtype}, shape {points.shape}",
        )
    if end_ns is not None and points[-1] != end_ns:
        raise InputError(
            "the communication points do not end where the schedules do",
            where="align",
            expected=f"last point {end_ns} ns",
            got=f"{points[-1]} ns",
        )
    return points.astype(np.int64)


def _on_grid(s: PacketSchedule, points: NDArray[np.int64]) -> PacketSchedule:
    sent = _up(s.sent_ns, points)
    return _resolve(s.link, s.end_ns, sent, s.transit_ns, s.lost, points=points)


def _up(times: NDArray[np.int64], points: NDArray[np.int64]) -> NDArray[np.int64]:
    """First point at or after each time; times after the last point stay as they are."""
    place = np.searchsorted(points, times)
    return np.where(place < points.size, np.append(points, 0)[place], times)


def _resolve(
    link: PacketLink,
    end_ns: int,
    sent: NDArray[np.int64],
    transit: NDArray[np.int64],
    lost: NDArray[np.bool_],
    *,
    points: NDArray[np.int64] | None = None,
) -> PacketSchedule:
    """Apply order and loss to messages already drawn."""
    arrival = _transmitted(link, sent) + transit
    if points is not None:
        arrival = _up(arrival, points)
    if link.order == "fifo":
        # What is lost holds nobody up, but is itself not missed before its predecessors are in.
        arrival = np.maximum(arrival, np.maximum.accumulate(np.where(lost, 0, arrival)))
    status = np.full(sent.size, DELIVERED, np.int8)
    if link.order == "newest-wins":
        status[_overtaken(arrival, lost)] = OVERTAKEN
    status[lost] = LOST
    status[arrival > end_ns] = IN_FLIGHT
    return PacketSchedule(
        link=link,
        end_ns=end_ns,
        sent_ns=sent,
        transit_ns=transit,
        arrival_ns=arrival,
        delivered_ns=np.where(status == DELIVERED, arrival, -1),
        sequence=np.arange(sent.size, dtype=np.int64),
        status=status,
        lost=lost,
    )


def _transmitted(link: PacketLink, sent: NDArray[np.int64]) -> NDArray[np.int64]:
    """Instant at which the sender has put each message on the link.

    One after the other: out[k] = max(sent[k], out[k-1]) + frame, which unrolls into
    frame (k + 1) + max over j <= k of (sent[j] - frame j).
    """
    before = link.frame_ns * np.arange(sent.size, dtype=np.int64)
    queued: NDArray[np.int64] = np.maximum.accumulate(sent - before) + before
    return queued + np.int64(link.frame_ns)


def _overtaken(arrival: NDArray[np.int64], lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Messages that arrive after a newer one which is not lost."""
    never = np.iinfo(np.int64).max
    earliest = np.minimum.accumulate(np.where(lost, never, arrival)[::-1])[::-1]
    newer: NDArray[np.int64] = np.append(earliest[1:], [never])[: arrival.size]
    return newer < arrival


def _noticed(s: PacketSchedule) -> NDArray[np.bool_]:
    """Losses that no newer delivery has made irrelevant by the time they are due."""
    never = np.iinfo(np.int64).max
    delivered = np.where(s.status == DELIVERED, s.arrival_ns, never)
    earliest = np.minimum.accumulate(delivered[::-1])[::-1]
    newer: NDArray[np.int64] = np.append(earliest[1:], [never])[: s.sent_ns.size]
    noticed: NDArray[np.bool_] = (s.status == LOST) & (newer > s.arrival_ns)
    return noticed
