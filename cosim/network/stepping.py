"""What becomes of a message: the sender's queue, the channel, and the receiver, one step each.

Written once. This Python steps live links; translated, line by line, it is the C that link FMUs
and the loop over messages step (`cosim.fmu`, link_step.h; delivery.c), so `send` and `receive` use
nothing but integers, comparisons, `max` and `if`, and `and` only in conditions.
"""

from __future__ import annotations

from typing import NamedTuple

from cosim.network.arrivals import DELIVERED, DUPLICATE, LATE, LOST, OVERTAKEN, QUEUE_FULL
from cosim.network.packet import PacketLink
from cosim.network.state import NONE_YET, SUBSTITUTE

NO_LIMIT = 2**62
"""`longest_wait_ns` of a queue that takes every message; longer than all messages of a run take."""


class Rules(NamedTuple):
    """What a link does, the same for all messages; `fifo`, `newest_wins`, `substitutes` are 0 or 1.

    `playout_ns` : 0 without a play-out buffer.
    """

    frame_ns: int
    longest_wait_ns: int
    fifo: int
    newest_wins: int
    substitutes: int
    playout_ns: int


class Message(NamedTuple):
    """A message at the instant of sending, as in `Messages`; `lost` and `copied` are 0 or 1."""

    sent_ns: int
    delay_ns: int
    jitter_ns: int
    lost: int
    copied: int
    copy_jitter_ns: int


class Sender(NamedTuple):
    """When the sender has sent all it accepted; under fifo, the latest arrival so far [ns].

    After a message its `Sending` is the sender.
    """

    free_ns: int = 0
    behind_ns: int = 0


class Sending(NamedTuple):
    """What a message brings about.

    Attributes
    ----------
    free_ns, behind_ns : the `Sender` after it.
    arrival_ns : when it arrives, or would if it is lost; refused, the instant of sending; with a
        play-out buffer, when it is released or missed [ns].
    fate : DELIVERED, LOST, LATE or QUEUE_FULL, as far as that is known before the receiver.
    copies : 1 if a copy arrives, too, at `copy_arrival_ns`; its fate is `copy_fate`.
    """

    free_ns: int
    behind_ns: int
    arrival_ns: int
    fate: int
    copies: int
    copy_arrival_ns: int
    copy_fate: int


class Arrival(NamedTuple):
    """A message that arrives, is due but lost or late, or was refused: number, sending, fate."""

    message: int
    sent_ns: int
    fate: int


class Receiver(NamedTuple):
    """What the receiver has: as `LinkState` and `Received`; `newest` message accepted so far.

    After an arrival its `Reception` is the receiver.
    """

    newest: int = NONE_YET
    sequence: int = NONE_YET
    origin_ns: int = 0
    dropped: int = 0
    delivered: int = 0


class Reception(NamedTuple):
    """The `Receiver` after an arrival, and what it did.

    Attributes
    ----------
    status : of the message; DELIVERED: it is in use from now on.
    noticed : 1 if the substitute is in use from now on, because this message is missed.
    """

    newest: int
    sequence: int
    origin_ns: int
    dropped: int
    delivered: int
    status: int
    noticed: int


def rules_of(link: PacketLink) -> Rules:
    """Return the rules of a link."""
    limit = link.queue_limit
    # Each waiting message takes a frame, and the one being sent the rest of its own: if the
    # sender is busy for more than `queue_limit` frames, that many messages wait already.
    return Rules(
        frame_ns=link.frame_ns,
        longest_wait_ns=NO_LIMIT if limit is None else min(int(limit) * link.frame_ns, NO_LIMIT),
        fifo=int(link.order == "fifo"),
        newest_wins=int(link.order == "newest-wins"),
        substitutes=int(link.on_loss != "hold"),
        playout_ns=int(link.playout_ns),
    )


def send(rules: Rules, sender: Sender | Sending, message: Message) -> Sending:
    """Send the next message: it waits for those before it, takes a frame, and crosses the link."""
    free_ns = sender.free_ns
    behind_ns = sender.behind_ns
    if free_ns - message.sent_ns > rules.longest_wait_ns:
        return Sending(free_ns, behind_ns, message.sent_ns, QUEUE_FULL, 0, 0, DELIVERED)
    free_ns = max(free_ns, message.sent_ns) + rules.frame_ns
    arrival_ns = free_ns + message.delay_ns + message.jitter_ns
    copy_arrival_ns = free_ns + message.delay_ns + message.copy_jitter_ns
    fate = DELIVERED
    copies = message.copied
    if message.lost:
        fate = LOST
        copies = 0
    if rules.fifo:
        # a lost message delays no other, but is not noticed before its predecessors arrive
        arrival_ns = max(arrival_ns, behind_ns)
        if fate == DELIVERED:
            behind_ns = arrival_ns
        copy_arrival_ns = max(copy_arrival_ns, behind_ns)
        if copies:
            behind_ns = copy_arrival_ns
    copy_fate = DELIVERED
    if rules.playout_ns > 0:
        release_ns = message.sent_ns + rules.playout_ns
        if fate == DELIVERED and arrival_ns > release_ns:
            fate = LATE
        if copy_arrival_ns > release_ns:
            copy_fate = LATE
        arrival_ns = release_ns
        copy_arrival_ns = release_ns
    return Sending(free_ns, behind_ns, arrival_ns, fate, copies, copy_arrival_ns, copy_fate)


def receive(rules: Rules, receiver: Receiver | Reception, arrival: Arrival) -> Reception:
    """Receive the next message in order of time, at one instant in order of sending."""
    newest = receiver.newest
    sequence = receiver.sequence
    origin_ns = receiver.origin_ns
    status = arrival.fate
    noticed = 0
    if status == DELIVERED and rules.newest_wins and arrival.message <= newest:
        status = DUPLICATE if arrival.message == newest else OVERTAKEN
    if status == DELIVERED:
        sequence = arrival.message
        newest = max(newest, arrival.message)
        origin_ns = arrival.sent_ns
    elif (
        (status == LOST or status == LATE)  # noqa: PLR1714, SIM109 - C has no `in`
        and rules.substitutes
        and newest < arrival.message
    ):
        sequence = SUBSTITUTE
        noticed = 1
    accepted = status == DELIVERED
    dropped = receiver.dropped + 1 - accepted
    return Reception(
        newest, sequence, origin_ns, dropped, receiver.delivered + accepted, status, noticed
    )
