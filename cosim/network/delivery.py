"""The delivery of a link's messages over a run: sent, on their way, received, as far as known.

Messages are sent one by one in order; what arrives waits until no earlier arrival can come
(`horizon_ns`), and is then received. Everything before the horizon is final, since no later message
can arrive before it is sent. Known delays are gone through up to an instant (`advance`), by the
compiled loop where there is one; a delay that follows a signal, or may be changed by a condition,
becomes known at the instant of sending, message by message (`resolve`). What lies behind the run
can be forgotten; the statistics count it on.

    known = Delivery(link, end_ns)
    for each block of points:
        known.advance(last point)
        known.sent_in_use(points)        # the instant of sending of what the receiver has
        known.forget(first point still in use)
    known.statistics(end_ns)

    live = Delivery(PacketLink("ranging", 10**9, delay=DelaySignal(1 / 1500)), end_ns)
    at each point t:
        while live.horizon_ns == t:
            live.resolve(live.message, range_in_metres)
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from copy import deepcopy
from heapq import heappop, heappush
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, distinct
from cosim.network import draws
from cosim.network.arrival_log import ArrivalLog
from cosim.network.arrivals import (
    DELIVERED,
    DUPLICATE,
    LATE,
    LOST,
    ON_MEDIUM,
    OVERTAKEN,
    QUEUE_FULL,
    REASONS,
    Arrivals,
)
from cosim.network.compiled_delivery import CompiledDelivery, LinkEnds
from cosim.network.delay_signal import DelaySignal
from cosim.network.packet import PacketLink
from cosim.network.sendings import NEVER, Sendings
from cosim.network.state import LinkState
from cosim.network.stepping import Arrival, Message, Sender, Sending, rules_of, send

Integers = NDArray[np.int64]
Statistics = dict[str, int | float | None]

FEW: Final = 16
"""Fewer messages than this are sooner sent in Python than handed over to the compiled loop."""


class Delivery:
    """The delivery of a packet link's messages over [0, end_ns].

    Parameters
    ----------
    link : any packet link with a way of its own (over a medium: `begin_deliveries`).
    end_ns : end of the run [ns].
    step_ns : None: instants stay as they are. Else sendings and arrivals are rounded up to its
        multiples, and to the end [ns].
    compiled : the loop over messages as machine code; None: all in Python, with the same results.

    Attributes
    ----------
    message : number of the message to be sent next.
    horizon_ns : the instant before which everything is final [ns]; 2**63 - 1 when all is. Of a live
        link the instant of sending of the message to be resolved next.
    oldest_ns : the first instant that can still be asked for [ns].

    Raises
    ------
    InputError : as `Sendings`.
    """

    def __init__(
        self,
        link: PacketLink,
        end_ns: int,
        step_ns: int | None = None,
        compiled: CompiledDelivery | None = None,
    ) -> None:
        if link.hop is not None and type(self) is Delivery:
            raise InputError(
                "what becomes of a message on a medium depends on the other links over it",
                where=f"link {link.name!r}",
                expected="a link of its own",
                got=f"medium {link.hop.medium.name!r}",
                hint="begin_deliveries() takes all links over the medium together",
            )
        self._sendings = Sendings(link, end_ns, 1 if step_ns is None else step_ns)
        self._compiled = compiled
        self.link, self.end_ns, self.is_live = link, int(end_ns), link.is_live
        self.message = self.oldest_ns = 0
        self.horizon_ns = self._sendings.instant(0) if self.is_live else 0
        self._rules = rules_of(link)
        self._sender: Sender | Sending = Sender()
        self._due: list[tuple[int, int, Arrival]] = []  # a heap: when, turn at that instant, what
        self._copies = array("q")  # when those not forgotten were sent [ns]
        self._copies_forgotten = 0
        self._log = ArrivalLog(self._rules)

    @property
    def sending_link(self) -> str:
        """Name of the link whose message is to be resolved next."""
        return self.link.name

    # -- going on

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final; the end is as far as it goes.

        Raises
        ------
        InputError : a message of a live link that was sent by then is not resolved.
        """
        until = min(int(until_ns), self.end_ns)
        if until < self.horizon_ns:
            return
        if self.is_live:
            self._check_final(until)
        last = self._sendings.until(until)
        while self.message < last:
            block = self._sendings.block(self.message, last)
            if self._compiled is not None and len(block) >= FEW:
                self._send_block(block, until, self._compiled)
                continue
            for row in block.tolist():
                self._send(Message._make(row))
        self.settle(until + 1 if until < self.end_ns else NEVER)

    def _send_block(self, block: Integers, until: int, compiled: CompiledDelivery) -> None:
        """Send many messages, and receive what arrives up to an instant before the next one."""
        horizon = min(self._sendings.instant(self.message + len(block)), until + 1)
        before = LinkEnds(self._sender, self._log.receiver, self._due)
        after, columns, copies = compiled.deliver(
            self._rules, self._sendings.points, before, self.message, block, horizon
        )
        self._sender, _, self._due = after
        self._log.extend(columns, after.receiver)
        self._copies.frombytes(copies.view(np.uint8).data)
        self.message += len(block)

    def resolve(
        self,
        message: int,
        value: Any = None,
        *,
        delay_ns: int | None = None,
        loss: float | None = None,
    ) -> int:
        """Send the next message of a live link.

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
        k, last = self.message, self._sendings.count
        where = self._where(message)
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
        if delay_ns is None and isinstance(self.link.delay, DelaySignal):
            delay_ns = self.link.delay.delay_ns(value, where=where)
        arrival_ns = self._send(self.adjusted(k, delay_ns, loss))
        self.settle(self._sendings.instant(self.message))
        return arrival_ns

    def check_value(self, value: Any) -> None:
        """Raise what `resolve` raises where the value gives no valid delay to the next message."""
        if isinstance(self.link.delay, DelaySignal):
            self.link.delay.delay_ns(value, where=self._where(self.message))

    def _where(self, message: int) -> str:
        return f"link {self.link.name!r}, message {message}"

    def adjusted(self, number: int, delay_ns: int | None, loss: float | None) -> Message:
        """Return a message, with another delay or loss than the link's if these are given."""
        one = self._sendings.message(number)
        if delay_ns is not None:
            one = one._replace(delay_ns=delay_ns)
        if loss is not None:  # the same number decides as with the link's own loss
            drawn = draws.lost(loss, self.link.seed, self.link.name, 1, number)
            one = one._replace(lost=int(drawn[0]))
        return one

    def _send(self, one: Message) -> int:
        """Send the next message; return when it arrives, or would [ns]."""
        k, self.message = self.message, self.message + 1
        self._sender = sending = send(self._rules, self._sender, one)
        if sending.copies:
            copy = Arrival(k, one.sent_ns, sending.copy_fate)
            self.expect(sending.copy_arrival_ns, 2 * k + 1, copy)
            self._copies.append(one.sent_ns)
        return self.expect(sending.arrival_ns, 2 * k, Arrival(k, one.sent_ns, sending.fate))

    def expect(self, time_ns: int, turn: int, arrival: Arrival) -> int:
        """Expect an arrival at an instant, rounded up to a point; return which it is [ns].

        `turn` : of those at one instant the least comes first.
        """
        time_ns = self._sendings.up(time_ns)
        if time_ns <= self.end_ns:
            heappush(self._due, (time_ns, turn, arrival))
        return time_ns

    def settle(self, horizon_ns: int) -> None:
        """Receive what is due before an instant, which is the horizon from now on."""
        self.horizon_ns, due, log = horizon_ns, self._due, self._log
        while due and due[0][0] < horizon_ns:
            time_ns, _, arrival = heappop(due)
            log.receive(time_ns, arrival)

    def forget(self, before_ns: int) -> None:
        """Drop what concerns only instants before this one, or before the horizon if that is less.

        Later instants are answered as if nothing had been dropped, and the statistics count it.
        """
        before = min(int(before_ns), self.horizon_ns)
        if before <= self.oldest_ns:
            return
        self.oldest_ns = before
        self._log.forget(before)
        copies = bisect_left(self._copies, before)
        self._copies_forgotten += copies
        del self._copies[:copies]

    # -- questions

    def sendings(self, after_ns: int, until_ns: int) -> Integers:
        """Return the distinct instants of sending in (after, until] [ns], int64 (n,).

        They are known from the start, also those after the horizon.
        """
        first, last = self._sendings.until(int(after_ns)), self._sendings.until(int(until_ns))
        return distinct(self._sendings.instants(first, last))

    def changes(self, after_ns: int, until_ns: int) -> tuple[Integers, Integers]:
        """Return the instants in (after, until] at which the message in use changes, and it.

        Two int64 arrays of shape (n,): the instants [ns], strictly increasing, and the
        instants of sending of the message then in use, as `sent_in_use`.

        Raises
        ------
        InputError : an instant that is not final yet, or was forgotten.
        """
        self._check_known(int(after_ns) + 1, int(until_ns))
        first, last = self._log.up_to([after_ns, until_ns]).tolist()
        counts = self._log.changes(first, last)
        return self._log.column("arrival_ns")[counts - 1], self._log.sent_in_use(counts)

    def sent_in_use(self, points_ns: ArrayLike) -> Integers:
        """Return the instant of sending of the message in use at each point [ns], int64.

        `NONE_YET` (-1) before the first delivery, `SUBSTITUTE` (-2) while the link's `on_loss`
        value stands in for a lost message.

        Raises
        ------
        InputError : a point that is not final yet, or was forgotten.
        """
        return self._log.sent_in_use(self._counts_at(points_ns))

    def runs_in_use(self, points_ns: Integers) -> tuple[Integers, Integers]:
        """Return the instants of `sent_in_use`, each once in a run of equal ones, and its length.

        `points_ns` : in order, at least one.

        Raises
        ------
        InputError : as `sent_in_use`.
        """
        # among many points there are few arrivals: their places are quicker to find
        first, last = self._counts_at(points_ns[[0, -1]]).tolist()
        ends = np.searchsorted(points_ns, self._log.column("arrival_ns")[first:last])
        repeats = np.diff(ends, prepend=0, append=points_ns.size)
        return self._log.sent_in_use(np.arange(first, last + 1)), repeats

    def state(self, points_ns: ArrayLike, *, broken_off: bool = False) -> LinkState:
        """Return age, sequence number, and how many were dropped and delivered, at each point.

        `broken_off` : also at the horizon of a live link, of what was sent by then.

        Raises
        ------
        InputError : as `sent_in_use`.
        """
        points = np.asarray(points_ns, np.int64)
        first = int(points.min(initial=self.horizon_ns))
        last = int(points.max(initial=self.oldest_ns - 1))
        if not (broken_off and self.is_live):
            self._check_known(first, last)
        self._check_remembered(first)
        return self._received_by(last).state(points)

    def in_flight(self, points_ns: ArrayLike) -> Integers:
        """Return how many messages and copies were sent and neither came nor were dropped, int64.

        Also at the horizon of a live link, as `state` of a run that is broken off.

        Raises
        ------
        InputError : as `state`.
        """
        state, points = self.state(points_ns, broken_off=True), np.asarray(points_ns).tolist()
        sent = [self._sendings.until(time) + self._copied(time) for time in points]
        return np.array(sent, np.int64) - state.delivered - state.dropped

    def oldest_awaited_ns(self, time_ns: int) -> int:
        """When the oldest message was sent that is in use at an instant, or arrives later [ns].

        That instant itself if there is none.

        Raises
        ------
        InputError : an instant that is not final yet, or was forgotten.
        """
        used, log = int(self.sent_in_use([time_ns])[0]), self._log
        sent = [time_ns, *self._waiting(), *(arrival.sent_ns for _, _, arrival in self._due)]
        sent += log.column("sent_ns")[int(log.up_to(time_ns)) :].tolist()
        return min([*sent, used] if used >= 0 else sent)

    def _waiting(self) -> Iterable[int]:
        """Return when those messages were sent that wait for a medium [ns]."""
        return ()

    def arrivals(self, first: int = 0) -> Arrivals:
        """Return the arrivals and drops that are final, from the `first`-th of the run on.

        Raises
        ------
        InputError : the `first`-th was forgotten.
        """
        forgotten = self._log.forgotten
        if first < forgotten:
            raise InputError(
                "these arrivals were forgotten",
                where=f"link {self.link.name!r}",
                expected=f"arrivals from the {forgotten}th on",
                got=f"from the {first}th on",
            )
        return self._log.arrivals(first - forgotten)

    def statistics(self, end_ns: int, *, broken_off: bool = False) -> Statistics:
        """Return the statistics of a run that ended at an instant, JSON-safe.

        sent + duplicated = delivered + dropped + in_flight, and dropped = lost + overtaken + late +
        queue_full + discarded_copies, and what a medium makes of messages.

        Parameters
        ----------
        broken_off : messages of a live link due at the end itself that were never resolved are left
            out.

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

        Raises
        ------
        InputError : a message was sent by then and never resolved, the end is not final yet or
            lies after that of the run or between two points, or an instant after it was forgotten.
        """
        end, link = int(end_ns), self.link
        self._check_end(end)
        self._check_resolved(end, broken_off=broken_off)
        self._check_remembered(end + 1)
        log = self._received_by(end)
        last = int(log.up_to(end))
        counts, copies = log.counted(last), self._copied(end)
        by, delivered = counts.statuses, counts.statuses[DELIVERED]
        used, origin = (int(log.after(name, np.array(last))) for name in ("used", "origin_ns"))
        oldest = max(counts.oldest_ns, end - origin if used >= 0 else -1)
        sent = self._sent(end, broken_off=broken_off)
        # links with a way of their own have the keys that they had before there were media
        on_medium = () if link.hop is None else ON_MEDIUM
        return {
            "sent": sent,
            "duplicated": copies if link.duplicate > 0 else None,
            "delivered": delivered,
            "dropped": sum(by) - delivered,
            "lost": by[LOST],
            "overtaken": by[OVERTAKEN],
            "late": by[LATE] if link.playout_ns else None,
            "queue_full": by[QUEUE_FULL] if link.queue_limit is not None else None,
            **{REASONS[fate].replace(" ", "_"): by[fate] for fate in on_medium},
            "discarded_copies": by[DUPLICATE] if link.duplicate > 0 else None,
            "in_flight": sent + copies - sum(by),
            "substitutions": counts.substitutions,
            "mean_delay_s": counts.delay_ns / delivered / 1e9 if delivered else None,
            "max_delay_s": counts.longest_ns / 1e9 if delivered else None,
            "max_age_s": oldest / 1e9 if oldest >= 0 else None,
        }

    # -- what is known

    def _sent(self, time_ns: int, *, broken_off: bool) -> int:
        """Return how many messages a run that ended then sent; broken off: of those resolved."""
        count = self._sendings.until(time_ns)
        if broken_off and self.is_live:
            return max(self._sendings.until(time_ns - 1), min(count, self.message))
        return count

    def _copied(self, time_ns: int) -> int:
        return self._copies_forgotten + bisect_right(self._copies, time_ns)

    def _received_by(self, time_ns: int) -> ArrivalLog:
        """Return what is received by an instant, and later of what was sent before it."""
        if self.horizon_ns > time_ns:
            return self._log
        log = deepcopy(self._log)
        for due_ns, _, arrival in sorted(self._due):
            log.receive(due_ns, arrival)
        return log

    def _counts_at(self, points_ns: ArrayLike) -> NDArray[np.intp]:
        """Return how many arrivals there are at points, after checking that they are known."""
        points = np.asarray(points_ns, np.int64)
        if points.size:
            self._check_known(int(points.min()), int(points.max()))
        return self._log.up_to(points)

    def _check_end(self, end: int) -> None:
        where = f"link {self.link.name!r}: end_ns"
        if not 0 <= end <= self.end_ns:
            raise InputError(
                "the end lies outside the run",
                where=where,
                expected=f"0 to {self.end_ns} ns",
                got=f"{end} ns",
            )
        if self._sendings.down(end) != end:
            raise InputError(
                "the run ends between two communication points", where=where, got=f"{end} ns"
            )

    def _check_resolved(self, end: int, *, broken_off: bool) -> None:
        if not self.is_live:
            self._check_final(end)
        elif (count := self._sent(end, broken_off=broken_off)) > self.message:
            raise InputError(
                "a message was sent and never resolved",
                where=f"link {self.link.name!r}, message {self.message}",
                expected=f"resolve() of every message up to {count - 1}",
                got=f"sent at {self._sendings.instant(self.message)} ns, end at {end} ns",
            )

    def _check_known(self, first_ns: int, last_ns: int) -> None:
        self._check_remembered(first_ns)
        self._check_final(last_ns)

    def _check_remembered(self, time_ns: int) -> None:
        if time_ns < self.oldest_ns:
            raise InputError(
                "the state of the link was forgotten",
                where=f"link {self.link.name!r}",
                expected=f"an instant from {self.oldest_ns} ns on",
                got=f"{time_ns} ns",
                hint="forget() only what is not needed any more",
            )

    def _check_final(self, time_ns: int) -> None:
        if time_ns < self.horizon_ns:
            return
        when, hint = "", "advance() to that instant first"
        if self.is_live:
            when = f", when message {self.message} is sent"
            hint = "resolve() the messages sent up to that instant first"
        raise InputError(
            "the state of the link is not known yet",
            where=f"link {self.link.name!r}",
            expected=f"an instant before {self.horizon_ns} ns{when}",
            got=f"{time_ns} ns",
            hint=hint,
        )
