"""The delivery of a link over a medium: what it offers, and what comes of it.

What happens in between is `cosim.network.medium_traffic`, for all links over the medium together.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

from cosim.core import InputError
from cosim.network.arrivals import DELIVERED, LATE, ON_MEDIUM, QUEUE_FULL
from cosim.network.delivery import Delivery
from cosim.network.medium import Hop
from cosim.network.packet import PacketLink
from cosim.network.stepping import NO_LIMIT, Arrival, Message, Sender, send


class Traffic(Protocol):
    """The packets of all links over a medium: `MediumTraffic`."""

    message: int
    horizon_ns: int

    @property
    def sending_link(self) -> str:
        """Name of the link whose message is to be resolved next; "" for a packet, or nothing."""
        ...

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final, where nothing is resolved."""
        ...

    def check_value(self, value: Any) -> None:
        """Raise what `resolve` raises of coordinates."""
        ...

    def resolve(
        self,
        message: int,
        values: Any,
        *,
        delay_ns: int | None = None,
        loss: float | None = None,
    ) -> None:
        """Send the next packet of moving nodes, or offer the next message of an adjustable link."""
        ...


class MediumDelivery(Delivery):
    """The delivery of the messages of a link over a medium, with those of the other links.

    Made by `begin_deliveries`.

    Attributes
    ----------
    traffic : the packets of all links over the medium.
    sender, receiver : numbers of its nodes.
    """

    traffic: Traffic

    def __init__(self, link: PacketLink, hop: Hop, end_ns: int, step_ns: int | None = None) -> None:
        super().__init__(link, end_ns, step_ns)
        self.sender = hop.medium.number(hop.sender, "from")
        self.receiver = hop.medium.number(hop.receiver, "to")
        # its packets wait, and take their time, on the medium
        self._rules = self._rules._replace(frame_ns=0, longest_wait_ns=NO_LIMIT)
        self._awaited: dict[int, Message] = {}  # offered, and on the medium or before it
        self._missed: set[int] = set()  # of those, what the play-out buffer does not await
        self._latest = -1  # message that came over the medium

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final, for all links over the medium.

        Raises
        ------
        InputError : nodes move, and a packet that was sent by then is not resolved.
        """
        until = min(int(until_ns), self.end_ns)
        if self.is_live:
            self._check_final(until)
        self.traffic.advance(until)

    def next_sending(self) -> int:
        """Return when the next message is offered [ns]; 2**63 - 1 when none is left."""
        return self._sendings.instant(self.message)

    def point_before(self, time_ns: int) -> int:
        """Return the last point at or before an instant [ns]."""
        return self._sendings.down(time_ns)

    def offer(self, delay_ns: int | None = None, loss: float | None = None) -> int:
        """Take the next message, with another delay or loss than the link's; return its number."""
        number, self.message = self.message, self.message + 1
        self._awaited[number] = self.adjusted(number, delay_ns, loss)
        return number

    def outcome(self, number: int, over_ns: int, fate: int) -> None:
        """Take what became of a message on the medium, when its packet was over [ns].

        Raises
        ------
        InputError : a packet of a link with order = "fifo" overtook another one.
        """
        one, arrival_ns = self._awaited.pop(number), over_ns
        if self._rules.fifo and number < self._latest:
            raise InputError(
                "a packet was overtaken by a later one of the same link",
                where=f"link {self.link.name!r}, message {number}",
                expected='order = "newest-wins" or "as-arrived", or nodes slower than the packets',
                got=f"message {self._latest} came first",
            )
        if fate != QUEUE_FULL:
            self._latest = max(self._latest, number)
            lost = int(one.lost or fate != DELIVERED)
            crossed = one._replace(delay_ns=over_ns - one.sent_ns + one.delay_ns, lost=lost)
            behind = Sender(0, self._sender.behind_ns)
            self._sender = sending = send(self._rules, behind, crossed)
            arrival_ns = sending.arrival_ns
            fate = fate if fate in ON_MEDIUM else sending.fate
        if number in self._missed:
            self._missed.remove(number)
        else:
            self.expect(arrival_ns, number, Arrival(number, one.sent_ns, fate))

    def release(self, number: int) -> None:
        """Miss a message whose packet is not over at its play-out: it is late, whatever comes."""
        one = self._awaited.get(number)
        if one is not None:
            self._missed.add(number)
            at = one.sent_ns + self._rules.playout_ns
            self.expect(at, number, Arrival(number, one.sent_ns, LATE))

    def _waiting(self) -> Iterable[int]:
        return (one.sent_ns for one in self._awaited.values())

    def _sent(self, time_ns: int, *, broken_off: bool) -> int:
        del broken_off  # what was offered was sent
        return min(self._sendings.until(time_ns), self.message)

    def _check_resolved(self, end: int, *, broken_off: bool) -> None:
        if not broken_off:
            self._check_final(end)
