"""A packet link whose schedule is computed during the run, for delays that follow a signal.

Every instant of sending is known beforehand. At each of them the loop passes the value that
decides the delay; everything the receiver sees before the next sending is then final, since no
later message can arrive earlier. At the end the messages make an ordinary `PacketSchedule`.

    link = PacketLink("ranging", sample_time_ns=10**9, delay=DelaySignal(1 / 1500))
    live = LiveSchedule(link, end_ns)
    points: the grid and live.sent_ns; during the run also live.next_change_ns()
    at each point t:
        while live.message < live.sent_ns.size and live.sent_ns[live.message] == t:
            live.resolve(live.message, range_in_metres)
        live.until(t)            # the message whose value the receiver has
    result = live.finish()

A message costs O(log n), with n messages in flight.
"""

from __future__ import annotations

from bisect import bisect_right
from heapq import heappop, heappush

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.network.alignment import communication_points
from cosim.network.delay_signal import DelaySignal
from cosim.network.messages import delays, draw_messages, sending_instants
from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import DELIVERED, Arrivals, PacketSchedule
from cosim.network.receiver import ReceiverRecord
from cosim.network.scheduling import resolve_messages, rounded_up
from cosim.network.state import NONE_YET, LinkState, Timeline
from cosim.network.stepping import Arrival, Message, Sender, Sending, rules_of, send

_NEVER = 2**63 - 1


class LiveSchedule:
    """The schedule of a link over [0, end_ns], as far as its delays are known.

    Parameters
    ----------
    link : any packet link; one without a `DelaySignal` is resolved without values.
    end_ns : end of the run [ns].
    points_ns : None: instants stay as they are ("align" of `align`). Communication points, or
        the step of a uniform grid [ns]: sendings and arrivals are rounded up to them ("grid").

    Raises
    ------
    InputError : as `schedule` and `align`.
    """

    def __init__(
        self, link: PacketLink, end_ns: int, points_ns: int | ArrayLike | None = None
    ) -> None:
        sent = sending_instants(link, end_ns)
        self._points = None if points_ns is None else communication_points(points_ns, end_ns)
        if self._points is not None:
            sent = rounded_up(sent, self._points)
        waits = isinstance(link.delay, DelaySignal)
        known = np.zeros(sent.size, np.int64) if waits else delays(link, sent)
        self._link, self._end_ns = link, int(end_ns)
        self._messages = draw_messages(link, sent, known)
        self._next = 0  # message
        self._entry = 0
        self._rules = rules_of(link)
        self._sender: Sender | Sending = Sender()
        self._due: list[tuple[int, int, Arrival]] = []  # when, entry, what
        self._receiver = ReceiverRecord(self._rules)
        self._settle()

    @property
    def link(self) -> PacketLink:
        """The link."""
        return self._link

    @property
    def sent_ns(self) -> NDArray[np.int64]:
        """Instant of sending of each message [ns], int64 (n,)."""
        return self._messages.sent_ns

    @property
    def message(self) -> int:
        """Number of the message to be resolved next; n when there is none."""
        return self._next

    @property
    def horizon_ns(self) -> int:
        """The instant before which everything is final [ns]; 2**63 - 1 when no message is left."""
        return self._horizon_ns

    def resolve(self, message: int, value: float | None = None) -> int:
        """Resolve the next message with the value of its delay signal at the instant of sending.

        Parameters
        ----------
        message : its number; messages come in order.
        value : of the signal that the link's `DelaySignal` follows; None for any other link.

        Returns
        -------
        Instant at which it arrives [ns], or would if it is lost; that of sending if it is refused.

        Raises
        ------
        InputError : a message out of order, a value that gives no valid delay.
        """
        k, messages = self._next, self._messages
        where = f"link {self._link.name!r}, message {message}"
        if message != k or k >= messages.sent_ns.size:
            raise InputError(
                "messages must be resolved in order of sending",
                where=where,
                expected=f"message {k}" if k < messages.sent_ns.size else "no more messages",
                got=f"message {message}",
            )
        if isinstance(self._link.delay, DelaySignal):
            messages.delay_ns[k] = self._link.delay.delay_ns(value, where=where)
        elif value is not None:
            raise InputError(
                "the delay of this link follows no signal",
                where=where,
                expected="no value",
                got=repr(value),
            )
        sent = int(messages.sent_ns[k])
        drawn = Message._make(int(column[k]) for column in messages)
        found = send(self._rules, self._sender, drawn)
        self._sender = found
        arrival = self._due_at(found.arrival_ns, Arrival(k, sent, found.fate))
        if found.copies:
            self._due_at(found.copy_arrival_ns, Arrival(k, sent, DELIVERED))
        self._next += 1
        self._settle()
        return arrival

    def until(self, time_ns: int) -> int:
        """Return the number of the message in use at an instant before the horizon.

        `NONE_YET` (-1) before the first delivery, `SUBSTITUTE` (-2) as in `PacketSchedule`.

        Raises
        ------
        InputError : an instant that is not final yet.
        """
        self._check_final(time_ns)
        place = bisect_right(self._receiver.time_ns, time_ns)
        return self._receiver.sequence[place - 1] if place else NONE_YET

    def in_use(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return as `PacketSchedule.in_use` does; `InputError` for a point not final yet."""
        return self._timeline(points_ns).in_use(points_ns)

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return as `PacketSchedule.state` does; `InputError` for a point not final yet."""
        return self._timeline(points_ns).state(points_ns)

    def next_change_ns(self, after_ns: int) -> int | None:
        """Return the first instant after this one at which the message in use changes [ns].

        None when there is none before the horizon.
        """
        place = bisect_right(self._receiver.change_ns, after_ns)
        return self._receiver.change_ns[place] if place < len(self._receiver.change_ns) else None

    def arrivals(self, first: int = 0) -> Arrivals:
        """Return as `PacketSchedule.arrivals` those before the horizon, from the `first`-th on."""
        message = np.array(self._receiver.message[first:], np.int64)
        return Arrivals(
            arrival_ns=np.array(self._receiver.time_ns[first:], np.int64),
            sent_ns=self._messages.sent_ns[message],
            sequence=message,
            status=np.array(self._receiver.status[first:], np.int8),
        )

    def finish(self, end_ns: int | None = None, *, broken_off: bool = False) -> PacketSchedule:
        """Return the schedule of the run, or of one that ended at `end_ns` [ns].

        `broken_off` : messages due at the end itself that were never resolved are left out.

        Raises
        ------
        InputError : a message was sent by then and never resolved, the end lies after that
            of the run, or, on a grid, between two points.
        """
        end = self._end_ns if end_ns is None else int(end_ns)
        where = f"link {self._link.name!r}: end_ns"
        if not 0 <= end <= self._end_ns:
            raise InputError(
                "the end lies outside the run",
                where=where,
                expected=f"0 to {self._end_ns} ns",
                got=f"{end} ns",
            )
        if self._points is not None and end not in self._points:
            raise InputError(
                "the run ends between two communication points", where=where, got=f"{end} ns"
            )
        before, count = np.searchsorted(self._messages.sent_ns, [end, end + 1]).tolist()
        count = max(before, min(count, self._next)) if broken_off else count
        if count > self._next:
            raise InputError(
                "a message was sent and never resolved",
                where=f"link {self._link.name!r}, message {self._next}",
                expected=f"resolve() of every message up to {count - 1}",
                got=f"sent at {self._messages.sent_ns[self._next]} ns, end at {end} ns",
            )
        points = None if self._points is None else self._points[self._points <= end]
        return resolve_messages(self._link, end, self._messages.first(count), points)

    def _due_at(self, time_ns: int, arrival: Arrival) -> int:
        """Expect an entry at this instant, on a grid at the next point; return which it is."""
        if self._points is not None:
            place = int(self._points.searchsorted(time_ns))
            time_ns = int(self._points[place]) if place < self._points.size else time_ns
        if time_ns <= self._end_ns:
            heappush(self._due, (time_ns, self._entry, arrival))
        self._entry += 1
        return time_ns

    def _settle(self) -> None:
        """Pass to the receiver all entries that arrive before the next sending."""
        sent = self._messages.sent_ns
        self._horizon_ns = int(sent[self._next]) if self._next < sent.size else _NEVER
        while self._due and self._due[0][0] < self._horizon_ns:
            self._receiver.receive(*heappop(self._due))

    def _check_final(self, time_ns: int) -> None:
        if time_ns >= self._horizon_ns:
            raise InputError(
                "the state of the link is not known yet",
                where=f"link {self._link.name!r}",
                expected=f"an instant before {self._horizon_ns} ns, "
                f"when message {self._next} is sent",
                got=f"{time_ns} ns",
                hint="resolve() the messages sent up to that instant first",
            )

    def _timeline(self, points_ns: ArrayLike) -> Timeline:
        points = np.asarray(points_ns, np.int64)
        if points.size:
            self._check_final(int(points.max()))
        return self._receiver.timeline()
