"""The schedule of a link over a medium: what it offers, and what comes of it.

What happens in between is `cosim.network.medium_traffic`, for all links over the medium together.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.network import draws
from cosim.network.arrivals import DELIVERED, LATE, LOST, ON_MEDIUM, QUEUE_FULL
from cosim.network.block_stepping import Entries, Sent
from cosim.network.growing_schedule import GrowingSchedule
from cosim.network.medium import Hop
from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import PacketSchedule
from cosim.network.scheduling import received_schedule
from cosim.network.stepping import NO_LIMIT, Arrival, Message, Sender, rules_of, send

_UNKNOWN = 2**62  # arrival of a message that is not received in the run


class Traffic(Protocol):
    """The packets of all links over a medium: `MediumTraffic`."""

    @property
    def horizon_ns(self) -> int:
        """The instant before which everything is final [ns]."""
        ...

    @property
    def message(self) -> int:
        """How many packets and messages were resolved so far."""
        ...

    @property
    def sending_link(self) -> str:
        """Name of the link whose message is to be resolved next; "" for a packet, or nothing."""
        ...

    def advance(self, until_ns: int) -> None:
        """Make everything up to and including an instant final, where nothing is resolved."""
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


class MediumSchedule(GrowingSchedule):
    """The schedule of a link over a medium, as far as it is known and remembered.

    Made by `growing_schedules`. Its messages become known with those of the other links.

    Attributes
    ----------
    traffic : the packets of all links over the medium.
    sender, receiver : numbers of its nodes.
    """

    traffic: Traffic

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

    def offer(self, delay_ns: int | None = None, loss: float | None = None) -> int:
        """Take the next message, with another delay or loss than the link's; return its number."""
        number = self._messages.next
        column = self._messages.take(1)
        if delay_ns is not None:
            column.delay_ns[0] = delay_ns
        if loss is not None:  # the same number decides as with the link's own loss
            column.lost[:] = draws.lost(loss, self._link.seed, self._link.name, 1, number)
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
        arrival = np.full(count, _UNKNOWN, np.int64)
        transit = messages.delay_ns + messages.jitter_ns
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
