"""What becomes of the packets on a medium, event by event, in integer nanoseconds.

At one instant receptions end first, then play-out buffers release, then nodes begin to send, then
links offer messages, in the order of links. All intervals are half open: packets that meet end to
end do not disturb each other. So the order of the nodes has no effect.

    schedules = growing_schedules(links, end_ns, points)
    for each link of fixed nodes: schedules[name].advance(until)    # of all links of its medium
    traffic = schedules[name].traffic                               # nodes that move
    at each point t:
        while traffic.horizon_ns == t:
            traffic.resolve(traffic.message, coordinates)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from copy import deepcopy
from heapq import heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.network.arrivals import (
    COLLIDED,
    DELIVERED,
    LATE,
    LOST,
    ON_MEDIUM,
    OUT_OF_RANGE,
    QUEUE_FULL,
    RECEIVER_SENDING,
)
from cosim.network.block_stepping import Entries, Sent
from cosim.network.growing_schedule import GrowingSchedule
from cosim.network.medium import Hop, Medium, distance
from cosim.network.messages import known_delays
from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import PacketSchedule
from cosim.network.scheduling import received_schedule
from cosim.network.single_draws import single_uniform
from cosim.network.stepping import NO_LIMIT, Arrival, Message, Sender, rules_of, send

_NEVER = 2**63 - 1
_UNKNOWN = 2**62  # arrival of a message that is not received in the run
_OVER, _RELEASE, _BEGIN, _OFFER = range(4)  # events of one instant, in order


class _Heard:
    """A packet as a node hears it in [begin, end)."""

    __slots__ = ("begin", "collided", "deaf", "end")

    def __init__(self, begin: int, end: int) -> None:
        self.begin, self.end = begin, end
        self.collided = self.deaf = False


class _Modem:
    """What a node does: until when it sends, and is deaf; what waits; what it hears."""

    def __init__(self) -> None:
        self.free = self.deaf_until = 0
        self.waiting: deque[tuple[MediumSchedule, int]] = deque()
        self.heard: list[_Heard] = []
        self.tries = 0  # of the first that waits


class MediumTraffic:
    """The packets on a medium over [0, end_ns], as far as they are known.

    Made by `growing_schedules`, which makes the schedules of its links.

    Attributes
    ----------
    medium : the medium.
    """

    def __init__(self, medium: Medium, schedules: Sequence[MediumSchedule], end_ns: int) -> None:
        self.medium, self._schedules, self._end_ns = medium, schedules, end_ns
        self._modems = [_Modem() for _ in medium.nodes]
        self._events: list[tuple[int, int, int, Any]] = []
        self._sent = 0
        self._fixed: list[list[tuple[int, float, int]]] | None = None
        if not medium.moves:
            places = medium.at(())
            self._fixed = [self._ways(node, places) for node in range(len(places))]
        self._horizon_ns = 0
        for number, one in enumerate(schedules):
            one.traffic = self
            self._offer_next(number)
        if self.is_live:
            self._run(end_ns)

    @property
    def is_live(self) -> bool:
        """Whether nodes move, so that packets are resolved one by one."""
        return self._fixed is None

    @property
    def message(self) -> int:
        """Number of the packet to be sent next, over all links."""
        return self._sent

    @property
    def horizon_ns(self) -> int:
        """The instant before which everything is final [ns]; 2**63 - 1 when all is.

        Of a medium whose nodes move it is that at which the next packet begins to be sent, on a
        grid the last point up to it: there the places of the nodes decide.
        """
        return self._horizon_ns

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final, where no node moves."""
        if until_ns >= self._horizon_ns and not self.is_live:
            self._run(min(until_ns, self._end_ns))

    def resolve(self, message: int, values: Sequence[float]) -> None:
        """Send the next packet of a medium whose nodes move.

        Parameters
        ----------
        message : its number; packets come in order.
        values : of the coordinates that follow signals, in the order of the nodes, at the horizon.

        Raises
        ------
        InputError : a packet out of order, coordinates that are not finite or too far away.
        """
        if not self.is_live or message != self._sent or self._horizon_ns == _NEVER:
            raise InputError(
                "the packets on a medium must be resolved in order",
                where=f"medium {self.medium.name!r}",
                expected=f"packet {self._sent}, of nodes that move",
                got=f"packet {message}",
            )
        at, _, node, _ = heappop(self._events)
        self._send(at, node, self._ways(node, self.medium.at(values)))
        self._run(self._end_ns)

    def _run(self, until: int) -> None:
        """Go through the events up to an instant; where nodes move, until a packet is sent."""
        events, horizon = self._events, until + 1
        while events and events[0][0] <= until:
            at, what, number, over = events[0]
            if what == _BEGIN and not self._is_heard(at, number):
                if self._fixed is None:
                    horizon = self._schedules[0].point_before(at)
                    break
                heappop(events)
                self._send(at, number, self._fixed[number])
                continue
            heappop(events)
            if what == _BEGIN:
                self._wait(number, at + 1)
            elif what == _OVER:
                self._end(at, *over)
            elif what == _RELEASE:
                self._schedules[number].release(over)
            else:
                self._offer(at, number)
        done = horizon > self._end_ns
        self._horizon_ns = _NEVER if done else horizon
        for one in self._schedules:
            one.settle(self._horizon_ns)

    def _offer_next(self, number: int) -> None:
        at = self._schedules[number].next_sending()
        if at <= self._end_ns:
            heappush(self._events, (at, _OFFER, number, None))

    def _offer(self, at: int, number: int) -> None:
        """Take the next message of a link into the queue of its node, unless too many wait."""
        one = self._schedules[number]
        message, limit = one.offer(), one.link.queue_limit
        self._offer_next(number)
        if one.link.playout_ns:
            heappush(self._events, (at + one.link.playout_ns, _RELEASE, number, message))
        node = one.sender
        waiting = self._modems[node].waiting
        # what can begin at this instant does not wait: the event of its node comes first
        begins = not waiting and self._begin_of(node, one, message, at) == at
        begins = begins and not self._is_heard(at, node)
        if limit is not None and not begins and sum(w is one for w, _ in waiting) >= limit:
            one.outcome(message, at, 0, QUEUE_FULL)
            return
        waiting.append((one, message))
        if len(waiting) == 1:
            self._wait(node, at)

    def _wait(self, node: int, at: int) -> None:
        """Let a node begin, or look, for the first that waits, from an instant on."""
        one, message = self._modems[node].waiting[0]
        begin = self._begin_of(node, one, message, at)
        self._modems[node].tries += 1
        heappush(self._events, (begin, _BEGIN, node, None))

    def _begin_of(self, node: int, one: MediumSchedule, message: int, at: int) -> int:
        """Return when a node may begin to send a message, from an instant on."""
        medium, modem = self.medium, self._modems[node]
        begin = max(at, modem.free)
        if medium.backoff_ns and (medium.access == "aloha" or modem.tries):
            link = one.link
            u = single_uniform(link.seed, link.name, "backoff", message, modem.tries)
            begin += int(u * medium.backoff_ns)
        slot = medium.slot_ns
        if not slot:
            return begin
        number = -(-begin // slot)
        if medium.slots:
            count = len(medium.slots)
            name = medium.nodes[node].name
            number = next(
                k for k in range(number, number + count) if medium.slots[k % count] == name
            )
        return number * slot

    def _is_heard(self, at: int, node: int) -> bool:
        """Whether a node that listens hears a packet; not one that begins at this instant."""
        if self.medium.access != "csma":
            return False
        return any(one.begin < at < one.end for one in self._modems[node].heard)

    def _ways(self, node: int, places: Sequence[Sequence[float]]) -> list[tuple[int, float, int]]:
        """Return each other node with its range [m], and the time that a packet travels [ns]."""
        medium, found = self.medium, []
        for other, place in enumerate(places):
            if other != node:
                names = f"{medium.nodes[node].name} to {medium.nodes[other].name}"
                range_m = distance(places[node], place)
                travel = medium.delay_ns(range_m, where=f"medium {medium.name!r}, {names}")
                found.append((other, range_m, travel))
        return found

    def _send(self, begin: int, node: int, ways: Sequence[tuple[int, float, int]]) -> None:
        """Let a node send the first message that waits, heard by all the others in reach."""
        medium, modem = self.medium, self._modems[node]
        one, message = modem.waiting.popleft()
        self._sent += 1
        end = begin + one.link.frame_ns
        modem.free, modem.deaf_until = end, end + int(medium.turnaround_ns)
        for heard in modem.heard:
            heard.deaf |= heard.begin < modem.deaf_until and heard.end > begin
        for other, range_m, travel in ways:
            is_receiver = other == one.receiver
            if not is_receiver and not range_m <= medium.hearing_range:
                continue
            heard = _Heard(begin + travel, end + travel)
            if range_m <= medium.hearing_range:
                self._hear(begin, self._modems[other], heard)
            if is_receiver and heard.end <= self._end_ns:
                over = (one, message, heard, travel, range_m)
                heappush(self._events, (heard.end, _OVER, self._sent, over))
        modem.tries = 0
        if modem.waiting:
            self._wait(node, end)

    @staticmethod
    def _hear(now: int, modem: _Modem, new: _Heard) -> None:
        modem.heard = [old for old in modem.heard if old.end > now]
        for old in modem.heard:
            if old.begin < new.end and new.begin < old.end:
                old.collided = new.collided = True
        new.deaf = new.begin < modem.deaf_until
        modem.heard.append(new)

    def _end(
        self, at: int, one: MediumSchedule, message: int, heard: _Heard, travel: int, range_m: float
    ) -> None:
        """Say what became of a packet that has passed its receiver."""
        medium, link, fate = self.medium, one.link, DELIVERED
        if medium.max_range is not None and range_m > medium.max_range:
            fate = OUT_OF_RANGE
        elif heard.deaf:
            fate = RECEIVER_SENDING
        elif heard.collided:
            fate = COLLIDED
        elif medium.loss is not None:
            u = single_uniform(link.seed, link.name, "range loss", message)
            fate = LOST if medium.loss.loses(u, range_m) else DELIVERED
        one.outcome(message, at, travel, fate)


class MediumSchedule(GrowingSchedule):
    """The schedule of a link over a medium, as far as it is known and remembered.

    Made by `growing_schedules`. Its messages become known with those of the other links.

    Attributes
    ----------
    traffic : the packets of all links over the medium.
    sender, receiver : numbers of its nodes.
    """

    traffic: MediumTraffic

    def __init__(
        self, link: PacketLink, hop: Hop, end_ns: int, points_ns: int | ArrayLike | None = None
    ) -> None:
        super().__init__(link, end_ns, points_ns)
        self.sender = hop.medium.number(hop.sender, "from")
        self.receiver = hop.medium.number(hop.receiver, "to")
        self._rules = rules_of(link)._replace(frame_ns=0, longest_wait_ns=NO_LIMIT)
        self._behind_ns, self._latest = 0, -1
        self._awaited: dict[int, Message] = {}  # offered, and on the medium or before it
        self._missed: set[int] = set()  # of those, what the play-out buffer does not await
        self._outcomes: dict[int, tuple[int, int, int]] | None = {}  # arrival, transit, fate

    @property
    def horizon_ns(self) -> int:
        """The instant before which everything is final [ns]; 2**63 - 1 when all is."""
        return self.traffic.horizon_ns

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final, for all links over the medium.

        Raises
        ------
        InputError : nodes move, and a packet that was sent by then is not resolved.
        """
        until = min(int(until_ns), self._end_ns)
        if self.is_live:
            self._check_final(until)
        self.traffic.advance(until)

    def next_sending(self) -> int:
        """Return when the next message is offered [ns]; 2**63 - 1 when none is left."""
        return self._next_sending()

    def point_before(self, time_ns: int) -> int:
        """Return the last point at or before an instant [ns]."""
        return self._sendings.grid.down(time_ns)

    def offer(self) -> int:
        """Take the next message; return its number."""
        number = self._messages.next
        column = self._messages.take(1)
        self._awaited[number] = Message._make(int(values[0]) for values in column)
        return number

    def outcome(self, number: int, over_ns: int, travel_ns: int, fate: int) -> None:
        """Take what became of a message on the medium, when its packet was over [ns].

        Raises
        ------
        InputError : a packet of a link with order = "fifo" overtook another one.
        """
        message = self._awaited.pop(number)
        if self._rules.fifo and number < self._latest:
            raise InputError(
                "a packet was overtaken by a later one of the same link",
                where=f"link {self._link.name!r}, message {number}",
                expected='order = "newest-wins" or "as-arrived", or nodes slower than the packets',
                got=f"message {self._latest} came first",
            )
        arrival, transit = over_ns, travel_ns + message.delay_ns + message.jitter_ns
        if fate != QUEUE_FULL:
            self._latest = max(self._latest, number)
            late = over_ns - message.sent_ns + message.delay_ns
            lost = int(message.lost or fate != DELIVERED)
            crossed = message._replace(delay_ns=late, lost=lost)
            found = send(self._rules, Sender(0, self._behind_ns), crossed)
            self._behind_ns, arrival = found.behind_ns, found.arrival_ns
            fate = fate if fate in ON_MEDIUM else found.fate
        if number in self._missed:
            self._missed.remove(number)
        else:
            self._take(number, message, arrival, transit, fate)

    def release(self, number: int) -> None:
        """Miss a message whose packet is not over at its play-out: it is late, whatever comes."""
        message = self._awaited.get(number)
        if message is not None:
            self._missed.add(number)
            at, transit = message.sent_ns + self._rules.playout_ns, message.delay_ns
            self._take(number, message, at, transit + message.jitter_ns, LATE)

    def _take(self, number: int, message: Message, at: int, transit: int, fate: int) -> None:
        if self._outcomes is not None:
            self._outcomes[number] = at, transit, fate
        self._due_at(at, number, Arrival(number, message.sent_ns, fate))

    def settle(self, horizon_ns: int) -> None:
        """Receive what is due before an instant, which is the horizon from now on."""
        self._settle(horizon_ns)

    def oldest_awaited_ns(self, time_ns: int) -> int:
        """When the oldest message was sent that is in use at an instant, or arrives later [ns]."""
        waiting = (message.sent_ns for message in self._awaited.values())
        return min(super().oldest_awaited_ns(time_ns), *waiting, time_ns)

    def forget(self, before_ns: int) -> None:
        """Drop what concerns only instants before this one."""
        super().forget(before_ns)
        self._outcomes = None

    def finish(self, end_ns: int | None = None, *, broken_off: bool = False) -> PacketSchedule:
        """Return the schedule of the run, or of one that ended at `end_ns` [ns].

        Of a message in flight by then nothing is known: it arrives at 2**62, after its delay and
        jitter alone.
        """
        end = self._end_ns if end_ns is None else int(end_ns)
        count = self._sent_by(end, broken_off=broken_off)
        messages = self._messages.first(count)
        known = known_delays(self._link, messages.sent_ns) + messages.jitter_ns
        arrival, transit = np.full(count, _UNKNOWN, np.int64), known
        fate = np.where(messages.lost, np.int8(LOST), np.int8(DELIVERED))
        for number, found in (self._outcomes or {}).items():
            if number < count and found[0] <= end:
                arrival[number], transit[number], fate[number] = found
        entries = Entries(arrival, messages.sent_ns, np.arange(count, dtype=np.int64), fate)
        sent = Sent(Sender(), entries, transit, np.zeros(count, np.bool_))
        grid = self._sendings.grid.cut(end)
        return received_schedule(self._link, end, messages, sent, grid)

    def copy(self) -> MediumSchedule:
        """Return a copy that goes on independently, with copies of the other links."""
        return deepcopy(self)

    def _sent_by(self, end: int, *, broken_off: bool) -> int:
        self._check_end(end)
        if not broken_off:
            self._check_final(end)
        return min(self._sendings.until(end), self._messages.next)


def growing_schedules(
    links: Iterable[PacketLink], end_ns: int, points_ns: int | ArrayLike | None = None
) -> dict[str, GrowingSchedule]:
    """Return the schedules of the packet links of a run, by name; those over a medium share it.

    `end_ns`, `points_ns` : as of `GrowingSchedule`.

    Raises
    ------
    InputError : as `GrowingSchedule`, or two media of one name.
    """
    found: dict[str, GrowingSchedule] = {}
    media: dict[str, list[MediumSchedule]] = {}
    for link in links:
        if link.hop is None:
            found[link.name] = GrowingSchedule(link, end_ns, points_ns)
            continue
        found[link.name] = one = MediumSchedule(link, link.hop, end_ns, points_ns)
        others = media.setdefault(link.hop.medium.name, [])
        others.append(one)
        first = others[0].link.hop
        if first is not None and first.medium != link.hop.medium:
            raise InputError(
                "two media have one name",
                where=f"link {link.name!r}: hop",
                expected=f"the medium of link {others[0].link.name!r}",
                got=repr(link.hop.medium),
            )
    for over in media.values():
        hop = over[0].link.hop
        assert hop is not None  # noqa: S101 - links over a medium have one
        MediumTraffic(hop.medium, over, int(end_ns))
    return found
