"""What becomes of the packets on a medium, event by event, in integer nanoseconds.

At one instant receptions end first, then play-out buffers release, then nodes begin to send, then
links offer messages, in the order of links. All intervals are half open: packets that meet end to
end do not disturb each other. So the order of the nodes has no effect.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from heapq import heappop, heappush
from typing import Any

from cosim.core import InputError
from cosim.network.arrivals import (
    COLLIDED,
    DELIVERED,
    LOST,
    OUT_OF_RANGE,
    QUEUE_FULL,
    RECEIVER_SENDING,
)
from cosim.network.medium import Medium, distance
from cosim.network.medium_delivery import MediumDelivery
from cosim.network.packet import PacketLink
from cosim.network.sendings import NEVER
from cosim.network.single_draws import single_uniform

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
        self.waiting: deque[tuple[MediumDelivery, int]] = deque()
        self.heard: list[_Heard] = []
        self.tries = 0  # of the first that waits


class MediumTraffic:
    """The packets on a medium over [0, end_ns], as far as they are known.

    Made by `begin_deliveries`, which makes the deliveries of its links.

    Attributes
    ----------
    medium : the medium.
    message : how many packets and messages were resolved so far.
    horizon_ns : the instant before which everything is final [ns]; 2**63 - 1 when all is. Of a
        medium whose nodes move it is that at which the next packet begins to be sent, on a grid
        the last point up to it: there the places of the nodes decide. Of adjustable links it is
        that at which the next message is offered.
    is_live : whether packets are resolved one by one, or messages before they wait (`resolve`).
    """

    def __init__(self, medium: Medium, deliveries: Sequence[MediumDelivery], end_ns: int) -> None:
        self.medium, self._deliveries, self._end_ns = medium, deliveries, end_ns
        self._modems = [_Modem() for _ in medium.nodes]
        self._events: list[tuple[int, int, int, Any]] = []
        self._sent = self.message = self.horizon_ns = 0
        self._leaders = [self._leader(number) for number in range(len(deliveries))]
        self._sharing = {
            one: [s for s, of in zip(deliveries, self._leaders, strict=True) if of == number]
            for number, one in enumerate(deliveries)
        }
        self._refused: set[tuple[int, int]] = set()  # messages of links that others share
        self._adjusts = any(one.link.adjustable for one in deliveries)
        self._fixed: list[list[tuple[int, float, int]]] | None = None
        if not medium.moves:
            places = medium.at(())
            self._fixed = [self._ways(node, places) for node in range(len(places))]
        self.is_live = medium.moves or self._adjusts
        for number, one in enumerate(deliveries):
            one.traffic = self
            self._offer_next(number)
        if self.is_live:
            self._run(end_ns)

    def _leader(self, number: int) -> int:
        """Return the first link whose packets are those of a link: itself, or one before it.

        Raises
        ------
        InputError : they are not of one size, rhythm and queue.
        """
        link = self._deliveries[number].link
        for other, one in enumerate(self._deliveries[:number]):
            if _packet_of(one.link) == _packet_of(link) is not None:
                for key in ("sample_time_ns", "offset_ns", "frame_size", "queue_limit"):
                    mine, its = getattr(link, key), getattr(one.link, key)
                    if mine != its:
                        raise InputError(
                            "links that share their packets have other packets",
                            where=f"link {link.name!r}: {key}",
                            expected=f"{its}, as of link {one.link.name!r}",
                            got=repr(mine),
                        )
                return other
        return number

    @property
    def sending_link(self) -> str:
        """Name of the link whose message is to be resolved next; "" for a packet, or nothing."""
        awaited = self._events[0] if self._events else None
        offered = self._adjusts and awaited is not None and awaited[1] == _OFFER
        return self._deliveries[awaited[2]].link.name if offered and awaited is not None else ""

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final, where no node moves."""
        if until_ns >= self.horizon_ns and not self.is_live:
            self._run(min(until_ns, self._end_ns))

    def resolve(
        self,
        message: int,
        values: Sequence[float],
        *,
        delay_ns: int | None = None,
        loss: float | None = None,
    ) -> None:
        """Send the next packet of a medium whose nodes move, or offer that of an adjustable link.

        Parameters
        ----------
        message : how many were resolved before; they come in order.
        values : of the coordinates that follow signals, in the order of the nodes, at the horizon.
        delay_ns, loss : in place of those of `sending_link`, if there is one.

        Raises
        ------
        InputError : one out of order, coordinates that are not finite or too far away.
        """
        if not self.is_live or message != self.message or self.horizon_ns == NEVER:
            raise InputError(
                "the packets on a medium must be resolved in order",
                where=f"medium {self.medium.name!r}",
                expected=f"packet {self.message}, of nodes that move or links that change",
                got=f"packet {message}",
            )
        at, what, number, _ = heappop(self._events)
        self.message += 1
        if what == _OFFER:
            self._offer(at, number, delay_ns, loss)
        else:
            self._send(at, number, self._ways(number, self.medium.at(values)))
        self._run(self._end_ns)

    def check_value(self, value: Sequence[float]) -> None:
        """Raise what `resolve` raises of coordinates that are not finite or too far away."""
        _, what, number, _ = self._events[0]
        places = self.medium.at(value)
        if what != _OFFER:
            self._ways(number, places)

    def _run(self, until: int) -> None:
        """Go through the events up to an instant, or to what is to be resolved."""
        events, horizon = self._events, until + 1
        while events and events[0][0] <= until:
            at, what, number, over = events[0]
            if what == _BEGIN and not self._is_heard(at, number):
                if self._fixed is None:
                    horizon = self._deliveries[0].point_before(at)
                    break
                heappop(events)
                self._send(at, number, self._fixed[number])
                continue
            if what == _OFFER and self._adjusts:
                horizon = at
                break
            heappop(events)
            if what == _BEGIN:
                self._wait(number, at + 1)
            elif what == _OVER:
                self._end(at, *over)
            elif what == _RELEASE:
                self._deliveries[number].release(over)
            else:
                self._offer(at, number)
        self.horizon_ns = NEVER if horizon > self._end_ns else horizon
        for one in self._deliveries:
            one.settle(self.horizon_ns)

    def _offer_next(self, number: int) -> None:
        at = self._deliveries[number].next_sending()
        if at <= self._end_ns:
            heappush(self._events, (at, _OFFER, number, None))

    def _offer(
        self, at: int, number: int, delay_ns: int | None = None, loss: float | None = None
    ) -> None:
        """Take the next message of a link into the queue of its node, unless too many wait."""
        one = self._deliveries[number]
        message, limit = one.offer(delay_ns, loss), one.link.queue_limit
        self._offer_next(number)
        if one.link.playout_ns:
            heappush(self._events, (at + one.link.playout_ns, _RELEASE, number, message))
        node, leader = one.sender, self._leaders[number]
        if leader != number:  # its packet is that of another link, which was offered before
            if (leader, message) in self._refused:
                one.outcome(message, at, QUEUE_FULL)
            return
        waiting = self._modems[node].waiting
        # what can begin at this instant does not wait: the event of its node comes first
        begins = not waiting and self._begin_of(node, one, message, at) == at
        begins = begins and not self._is_heard(at, node)
        if limit is not None and not begins and sum(w is one for w, _ in waiting) >= limit:
            one.outcome(message, at, QUEUE_FULL)
            if len(self._sharing[one]) > 1:
                self._refused.add((number, message))
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

    def _begin_of(self, node: int, one: MediumDelivery, message: int, at: int) -> int:
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
        end = begin + one.link.frame_ns
        modem.free, modem.deaf_until = end, end + int(medium.turnaround_ns)
        for heard in modem.heard:
            heard.deaf |= heard.begin < modem.deaf_until and heard.end > begin
        for other, range_m, travel in ways:
            heard = _Heard(begin + travel, end + travel)
            if range_m <= medium.hearing_range:
                self._hear(begin, self._modems[other], heard)
            for link in self._sharing[one] if heard.end <= self._end_ns else ():
                if other == link.receiver:
                    self._sent += 1
                    over = (link, message, heard, range_m)
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
        self, at: int, one: MediumDelivery, message: int, heard: _Heard, range_m: float
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
        one.outcome(message, at, fate)


def _packet_of(link: PacketLink) -> tuple[str, str] | None:
    """Return sender and name of the packets that a link shares; None if they are its own."""
    hop = link.hop
    return None if hop is None or not hop.packet else (hop.sender, hop.packet)
