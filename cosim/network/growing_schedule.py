"""The schedule of a packet link during a run, in blocks, with as much memory as a block needs.

Known delays are computed for all messages of a block at once (`advance`); a delay that follows a
signal, or may be changed by a condition, becomes known at the instant of sending, message by
message (`resolve`). Everything before
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

from array import array
from bisect import bisect_left, bisect_right
from copy import copy
from heapq import heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, distinct
from cosim.network import draws
from cosim.network.arrivals import Arrivals
from cosim.network.block_stepping import NONE_SENT, receive_block, send_block
from cosim.network.delay_signal import DelaySignal
from cosim.network.messages import MAX_STREAMED, MessageStream, Sendings
from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import PacketSchedule
from cosim.network.received import Received, ReceivedRecord
from cosim.network.scheduling import resolve_messages, shares_medium
from cosim.network.state import LinkState
from cosim.network.stepping import Arrival, Message, Sender, Sending, rules_of, send
from cosim.network.tally import Statistics, Tally

_NEVER = 2**63 - 1


class GrowingSchedule:
    """The schedule of a packet link over [0, end_ns], as far as it is known and remembered.

    Parameters
    ----------
    link : any packet link with a channel of its own (over a medium: `growing_schedules`).
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
        if link.hop is not None and type(self) is GrowingSchedule:
            raise shares_medium(link)
        self._sendings = Sendings(link, end_ns, points_ns, MAX_STREAMED)
        self._messages = MessageStream(link, self._sendings)
        self._link, self._end_ns = link, int(end_ns)
        self._rules = rules_of(link)
        self._sender: Sender | Sending = Sender()
        self._record = ReceivedRecord(self._rules)
        self._tally = Tally()  # of what was forgotten
        self._copies = array("q")  # when those not forgotten were sent [ns]
        self._copies_forgotten = 0
        self._pending = NONE_SENT  # known delays: in order of sending
        self._due: list[tuple[int, int, Arrival]] = []  # live ones: when, entry, what
        self._oldest_ns = 0
        self._horizon_ns = self._next_sending() if self.is_live else 0

    @property
    def link(self) -> PacketLink:
        """The link."""
        return self._link

    @property
    def end_ns(self) -> int:
        """End of the run [ns]."""
        return self._end_ns

    @property
    def is_live(self) -> bool:
        """Whether messages are resolved one by one (`PacketLink.is_live`)."""
        return self._link.is_live

    @property
    def sending_link(self) -> str:
        """Name of the link whose message is to be resolved next."""
        return self._link.name

    @property
    def message(self) -> int:
        """Number of the message to be sent next; the number of all messages when none is left."""
        return self._messages.next

    @property
    def horizon_ns(self) -> int:
        """The instant before which everything is final [ns]; 2**63 - 1 when all is.

        Of a live link the instant of sending of the message to be resolved next.
        """
        return self._horizon_ns

    @property
    def oldest_ns(self) -> int:
        """The first instant that can still be asked for [ns]."""
        return self._oldest_ns

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final; the end is as far as it goes.

        Raises
        ------
        InputError : a message of a live link that was sent by then is not resolved.
        """
        until = min(int(until_ns), self._end_ns)
        if until < self._horizon_ns:
            return
        if self.is_live:
            self._check_final(until)
        first = self._messages.next
        block = self._messages.take(self._sendings.until(until) - first)
        sent = send_block(self._rules, self._sender, block, first)
        self._sender = sent.sender
        self._copies.frombytes(sent.entries.sent_ns[sent.copy].tobytes())
        fresh = sent.entries._replace(arrival_ns=self._sendings.grid.up(sent.entries.arrival_ns))
        entries = self._pending.followed_by(fresh)
        arrived = entries.select(entries.by_arrival(until))
        self._record.extend(*receive_block(self._rules, self._record.receiver, arrived))
        later = (entries.arrival_ns > until) & (entries.arrival_ns <= self._end_ns)
        self._pending = entries.select(later)
        self._horizon_ns = until + 1 if until < self._end_ns else _NEVER

    def resolve(
        self,
        message: int,
        value: float | None = None,
        *,
        delay_ns: int | None = None,
        loss: float | None = None,
    ) -> int:
        """Resolve the next message of a live link.

        Parameters
        ----------
        message : its number; messages come in order.
        value : of the signal that the link's `DelaySignal` follows, at the instant of sending;
            None if it has none.
        delay_ns, loss : in place of those of the link, if it is adjustable.

        Returns
        -------
        Instant at which it arrives or is released [ns], or would be if it is lost or late; that
        of sending if it is refused.

        Raises
        ------
        InputError : a message out of order, a value that gives no valid delay, a delay that is
            known without it.
        """
        k, last = self._messages.next, self._sendings.count
        where = f"link {self._link.name!r}, message {message}"
        if not self.is_live:
            raise InputError(
                "the delay of this link follows no signal",
                where=where,
                expected="advance()",
                got=f"the value {value!r}",
            )
        if message != k or k >= last:
            raise InputError(
                "messages must be resolved in order of sending",
                where=where,
                expected=f"message {k}" if k < last else "no more messages",
                got=f"message {message}",
            )
        if delay_ns is None and isinstance(self._link.delay, DelaySignal):
            delay_ns = self._link.delay.delay_ns(value, where=where)
        drawn = self._messages.take(1)
        if delay_ns is not None:
            drawn.delay_ns[0] = delay_ns
        if loss is not None:  # the same number decides as with the link's own loss
            drawn.lost[:] = draws.lost(loss, self._link.seed, self._link.name, 1, k)
        self._sender = found = send(
            self._rules, self._sender, Message._make(int(column[0]) for column in drawn)
        )
        sent = self._horizon_ns
        arrival = self._due_at(found.arrival_ns, 2 * k, Arrival(k, sent, found.fate))
        if found.copies:
            self._due_at(found.copy_arrival_ns, 2 * k + 1, Arrival(k, sent, found.copy_fate))
            self._copies.append(sent)
        self._settle(self._next_sending())
        return arrival

    def _settle(self, horizon_ns: int) -> None:
        """Receive what is due before an instant, which is the horizon from now on."""
        self._horizon_ns = horizon_ns
        while self._due and self._due[0][0] < horizon_ns:
            time_ns, _, what = heappop(self._due)
            self._record.receive(time_ns, what)

    def sendings(self, after_ns: int, until_ns: int) -> NDArray[np.int64]:
        """Return the distinct instants of sending in (after, until] [ns], int64 (n,).

        They are known from the start, also those after the horizon.
        """
        first, last = self._sendings.until(int(after_ns)), self._sendings.until(int(until_ns))
        return distinct(self._sendings.instants(first, last))

    def changes(self, after_ns: int, until_ns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the instants in (after, until] at which the message in use changes, and it.

        Two int64 arrays of shape (n,): the instants [ns], strictly increasing, and the
        instants of sending of the message then in use, as `sent_in_use`.

        Raises
        ------
        InputError : an instant that is not final yet, or was forgotten.
        """
        self._check_known(int(after_ns) + 1, int(until_ns))
        received = self._record.received()
        first, last = received.up_to([after_ns, until_ns]).tolist()
        places = received.changes(first, last)
        used = received.sequence[places]
        return received.arrival_ns[places], np.where(used >= 0, received.origin_ns[places], used)

    def sent_in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the instant of sending of the message in use at each point [ns], int64.

        `NONE_YET` (-1) before the first delivery, `SUBSTITUTE` (-2) while the link's `on_loss`
        value stands in for a lost message.

        Raises
        ------
        InputError : a point that is not final yet, or was forgotten.
        """
        return self._received_at(points_ns).sent_in_use(points_ns)

    def runs_in_use(self, points_ns: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the instants of `sent_in_use`, each once in a run of equal ones, and its length.

        `points_ns` : in order, at least one.

        Raises
        ------
        InputError : as `sent_in_use`.
        """
        return self._received_at(points_ns).runs_in_use(points_ns)

    def state(self, points_ns: ArrayLike, *, broken_off: bool = False) -> LinkState:
        """Return age, sequence number, and how many were dropped and delivered, at each point.

        `broken_off` : also at the horizon of a live link, as in `finish`.

        Raises
        ------
        InputError : a point that is not final yet, or was forgotten.
        """
        if not broken_off or not self.is_live:
            return self._received_at(points_ns).state(points_ns)
        points = np.asarray(points_ns, np.int64)
        self._check_remembered(int(points.min(initial=self._horizon_ns)))
        return self._received_by(int(points.max(initial=0))).received().state(points)

    def in_flight(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return how many messages and copies were sent and neither came nor were dropped, int64.

        Also at the horizon of a live link, as `state` of a run that is broken off.

        Raises
        ------
        InputError : as `state`.
        """
        points = np.asarray(points_ns, np.int64)
        state = self.state(points, broken_off=True)
        sent = [
            self._sendings.until(time) + self._copies_forgotten + bisect_right(self._copies, time)
            for time in points.tolist()
        ]
        return np.array(sent, np.int64) - state.delivered - state.dropped

    def oldest_awaited_ns(self, time_ns: int) -> int:
        """When the oldest message was sent that is in use at an instant, or arrives later [ns].

        That instant itself if there is none.

        Raises
        ------
        InputError : an instant that is not final yet, or was forgotten.
        """
        used = int(self.sent_in_use([time_ns])[0])
        received = self._record.received()
        sent = [
            time_ns if used < 0 else used,
            *received.arrivals(int(received.up_to(time_ns))).sent_ns.tolist(),
            *self._pending.sent_ns.tolist(),
            *(what.sent_ns for _, _, what in self._due),
        ]
        return int(min(sent))

    def arrivals(self, first: int = 0) -> Arrivals:
        """Return the arrivals and drops that are final, from the `first`-th of the run on.

        Raises
        ------
        InputError : the `first`-th was forgotten.
        """
        forgotten = self._record.forgotten
        if first < forgotten:
            raise InputError(
                "these arrivals were forgotten",
                where=f"link {self._link.name!r}",
                expected=f"arrivals from the {forgotten}th on",
                got=f"from the {first}th on",
            )
        return self._record.received().arrivals(first - forgotten)

    def forget(self, before_ns: int) -> None:
        """Drop what concerns only instants before this one, or before the horizon if that is less.

        Later instants are answered as if nothing had been dropped, and the statistics still
        count it; but `finish` cannot return it any more.
        """
        before = min(int(before_ns), self._horizon_ns)
        if before <= self._oldest_ns:
            return
        self._oldest_ns = before
        received = self._record.received()
        self._tally = self._tally.counted(received.first(int(received.up_to(before - 1))))
        del received  # it holds the arrays that shrink
        self._record.forget(before)
        copies = bisect_left(self._copies, before)
        self._copies_forgotten += copies
        del self._copies[:copies]
        self._messages.forget()

    def statistics(self, end_ns: int, *, broken_off: bool = False) -> Statistics:
        """Return the statistics of the run that ended at `end_ns`, as `PacketSchedule` does.

        `broken_off` : as in `finish`.

        Raises
        ------
        InputError : as `finish`, or an instant after the end was forgotten.
        """
        end = int(end_ns)
        sent = self._sent_by(end, broken_off=broken_off)
        self._check_remembered(end + 1)
        received = self._received_by(end).received()
        received = received.first(int(received.up_to(end)))
        copies = self._copies_forgotten + bisect_right(self._copies, end)
        last = received.after(received.message.size)
        return self._tally.counted(received).statistics(self._link, sent, copies, end, last)

    def finish(self, end_ns: int | None = None, *, broken_off: bool = False) -> PacketSchedule:
        """Return the schedule of the run, or of one that ended at `end_ns` [ns].

        `broken_off` : messages of a live link due at the end itself that were never resolved
        are left out.

        Raises
        ------
        InputError : a message was sent by then and never resolved, the end is not final yet or
            lies after that of the run or, on a grid, between two points; or something was
            forgotten.
        """
        end = self._end_ns if end_ns is None else int(end_ns)
        messages = self._messages.first(self._sent_by(end, broken_off=broken_off))
        return resolve_messages(self._link, end, messages, self._sendings.grid.cut(end))

    def copy(self) -> GrowingSchedule:
        """Return a copy that goes on independently."""
        twin = copy(self)
        vars(twin).update(
            _messages=self._messages.copy(),
            _record=self._record.copy(),
            _due=self._due[:],
            _copies=self._copies[:],
        )
        return twin

    def _received_by(self, end: int) -> ReceivedRecord:
        """Return what is received by an instant, and later of what was sent before it."""
        record = self._record
        if self._horizon_ns <= end:
            record = record.copy()
            for time_ns, _, what in sorted(self._due):
                record.receive(time_ns, what)
        return record

    def _sent_by(self, end: int, *, broken_off: bool) -> int:
        """Return how many messages a run that ended at `end` sent; check that they are known."""
        self._check_end(end)
        if not self.is_live:
            self._check_final(end)
        resolved = self._messages.next
        before, count = self._sendings.until(end - 1), self._sendings.until(end)
        if broken_off:
            count = max(before, min(count, resolved))
        if self.is_live and count > resolved:
            raise InputError(
                "a message was sent and never resolved",
                where=f"link {self._link.name!r}, message {resolved}",
                expected=f"resolve() of every message up to {count - 1}",
                got=f"sent at {self._sendings.instant(resolved)} ns, end at {end} ns",
            )
        return count

    def _check_end(self, end: int) -> None:
        where = f"link {self._link.name!r}: end_ns"
        if not 0 <= end <= self._end_ns:
            raise InputError(
                "the end lies outside the run",
                where=where,
                expected=f"0 to {self._end_ns} ns",
                got=f"{end} ns",
            )
        if self._sendings.grid.down(end) != end:
            raise InputError(
                "the run ends between two communication points", where=where, got=f"{end} ns"
            )

    def _next_sending(self) -> int:
        k = self._messages.next
        return self._sendings.instant(k) if k < self._sendings.count else _NEVER

    def _due_at(self, time_ns: int, entry: int, arrival: Arrival) -> int:
        """Expect an entry at this instant, on a grid at the next point; return which it is.

        `entry` : of those at one instant the least comes first.
        """
        time_ns = self._sendings.grid.up_one(time_ns)
        if time_ns <= self._end_ns:
            heappush(self._due, (time_ns, entry, arrival))
        return time_ns

    def _received_at(self, points_ns: ArrayLike) -> Received:
        """Return what was received, after checking that it tells of these points."""
        points = np.asarray(points_ns, np.int64)
        if points.size:
            self._check_known(int(points.min()), int(points.max()))
        return self._record.received()

    def _check_known(self, first_ns: int, last_ns: int) -> None:
        self._check_remembered(first_ns)
        self._check_final(last_ns)

    def _check_remembered(self, time_ns: int) -> None:
        if time_ns < self._oldest_ns:
            raise InputError(
                "the state of the link was forgotten",
                where=f"link {self._link.name!r}",
                expected=f"an instant from {self._oldest_ns} ns on",
                got=f"{time_ns} ns",
                hint="forget() only what is not needed any more",
            )

    def _check_final(self, time_ns: int) -> None:
        if time_ns < self._horizon_ns:
            return
        when, hint = "", "advance() to that instant first"
        if self.is_live:
            when = f", when message {self._messages.next} is sent"
            hint = "resolve() the messages sent up to that instant first"
        raise InputError(
            "the state of the link is not known yet",
            where=f"link {self._link.name!r}",
            expected=f"an instant before {self._horizon_ns} ns{when}",
            got=f"{time_ns} ns",
            hint=hint,
        )
