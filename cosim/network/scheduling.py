"""Compute the schedule of a packet link over a whole run."""

from __future__ import annotations

import numpy as np

from cosim.core import InputError
from cosim.network.arrivals import DELIVERED, IN_FLIGHT
from cosim.network.block_stepping import Sent, receive_block, send_block
from cosim.network.delay_signal import DelaySignal
from cosim.network.grid import Grid
from cosim.network.messages import Messages, MessageStream, Sendings
from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import PacketSchedule
from cosim.network.stepping import Receiver, Sender, rules_of


def schedule(link: PacketLink, end_ns: int) -> PacketSchedule:
    """Compute the schedule of every message sent in [0, end_ns], in exact integer nanoseconds.

    A longer run begins with the same messages, delays, losses and copies.

    Raises
    ------
    InputError : as `sending_instants`, a delay that follows a signal (`GrowingSchedule`), or a link
        over a medium (`growing_schedules`).
    """
    sendings = Sendings(link, end_ns)
    if link.hop is not None:
        raise shares_medium(link)
    if isinstance(link.delay, DelaySignal):
        raise InputError(
            "the delay follows a signal, which is known only during the run",
            where=f"link {link.name!r}: delay",
            expected="a constant delay or a DelayProfile",
            got=repr(link.delay),
            hint="use GrowingSchedule, and pass it the value of each message as it is sent",
        )
    messages = MessageStream(link, sendings).take(sendings.count)
    return resolve_messages(link, int(end_ns), messages, sendings.grid)


def resolve_messages(
    link: PacketLink, end_ns: int, messages: Messages, grid: Grid
) -> PacketSchedule:
    """Compute the schedule of messages already drawn; arrivals are rounded up to the grid."""
    return received_schedule(
        link, end_ns, messages, send_block(rules_of(link), Sender(), messages, 0), grid
    )


def received_schedule(
    link: PacketLink, end_ns: int, messages: Messages, sent: Sent, grid: Grid
) -> PacketSchedule:
    """Compute the schedule of messages already sent; arrivals are rounded up to the grid."""
    rules = rules_of(link)
    entries = sent.entries._replace(arrival_ns=grid.up(sent.entries.arrival_ns))
    order = entries.by_arrival(end_ns)
    _, received = receive_block(rules, Receiver(), entries.select(order))
    status = np.full(entries.message.size, IN_FLIGHT, np.int8)
    status[order] = received.status
    return PacketSchedule(
        link=link,
        end_ns=end_ns,
        sent_ns=entries.sent_ns,
        transit_ns=sent.transit_ns,
        arrival_ns=entries.arrival_ns,
        delivered_ns=np.where(status == DELIVERED, entries.arrival_ns, -1),
        sequence=entries.message,
        status=status,
        lost=messages.lost[entries.message],
        copy=sent.copy,
        messages=messages,
        received=received,
        order=order,
    )


def shares_medium(link: PacketLink) -> InputError:
    """Return the error for a link over a medium that is asked about alone."""
    return InputError(
        "what becomes of a message on a medium depends on the other links over it",
        where=f"link {link.name!r}",
        expected="a link of its own",
        got=f"medium {link.hop.medium.name!r}" if link.hop is not None else "",
        hint="growing_schedules() computes all links over a medium together",
    )
