"""The steps of `cosim.network.stepping` for many messages at once, on arrays.

A block begins in the state that the block before left, so that blocks of any size make the same
entries; the whole run is one block.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.network.arrivals import (
    DELIVERED,
    DUPLICATE,
    LATE,
    LOST,
    ON_MEDIUM,
    OVERTAKEN,
    QUEUE_FULL,
)
from cosim.network.messages import Messages
from cosim.network.received import Received
from cosim.network.state import NONE_YET, SUBSTITUTE
from cosim.network.stepping import Receiver, Reception, Rules, Sender, Sending


class Entries(NamedTuple):
    """Messages and copies between sender and receiver; arrays of shape (n,).

    Attributes
    ----------
    arrival_ns : when each arrives, or would if it is lost; refused, the instant of sending; with a
        play-out buffer, when it is released or missed [ns].
    sent_ns : instant of sending [ns], int64.
    message : number of the message, int64.
    fate : DELIVERED, LOST, LATE, QUEUE_FULL or one of ON_MEDIUM, as far as known before the
        receiver, int8.
    """

    arrival_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    message: NDArray[np.int64]
    fate: NDArray[np.int8]

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Entries:
        """Return some of the entries."""
        return Entries._make(column[which] for column in self)

    def followed_by(self, later: Entries) -> Entries:
        """Return these entries and some that were sent later."""
        if not self.message.size:
            return later
        columns: Any = zip(self, later, strict=True)
        return Entries._make(np.concatenate(pair) for pair in columns)

    def by_arrival(self, until_ns: int) -> NDArray[np.intp]:
        """Return the places of those up to an instant, in order of time.

        At one instant they are in order of sending.
        """
        places = np.flatnonzero(self.arrival_ns <= until_ns)
        times = self.arrival_ns[places]
        if (times[1:] < times[:-1]).any():
            places = places[np.argsort(times, kind="stable")]
        return places


class Sent(NamedTuple):
    """What a block of messages brings about, in order of sending; copies follow originals.

    Attributes
    ----------
    sender : the sender after the block.
    entries : messages and copies, on their way.
    transit_ns : delay + jitter of each [ns], int64 (n,).
    copy : which are copies, bool (n,).
    """

    sender: Sender
    entries: Entries
    transit_ns: NDArray[np.int64]
    copy: NDArray[np.bool_]


_NO_INSTANTS = np.zeros(0, np.int64)
NONE_SENT = Entries(_NO_INSTANTS, _NO_INSTANTS, _NO_INSTANTS, np.zeros(0, np.int8))
"""No entries at all."""


def send_block(rules: Rules, sender: Sender | Sending, messages: Messages, first: int) -> Sent:
    """Send the next messages, the `first` and following: `stepping.send` of each."""
    if not messages.sent_ns.size:
        same = Sender(sender.free_ns, sender.behind_ns)
        return Sent(same, NONE_SENT, _NO_INSTANTS, np.zeros(0, np.bool_))
    out, refused = _transmitted(rules, sender, messages.sent_ns)
    fate = np.where(messages.lost, np.int8(LOST), np.int8(DELIVERED))
    fate[refused] = QUEUE_FULL
    sent, message = messages.sent_ns, np.arange(first, first + out.size)
    transit, copy = messages.delay_ns + messages.jitter_ns, np.zeros(out.size, np.bool_)
    copied = messages.copied & (fate == DELIVERED)
    if copied.any():
        place, copy = _with_copies(copied)
        sent, message, fate, out = sent[place], message[place], fate[place], out[place]
        transit = np.where(
            copy, (messages.delay_ns + messages.copy_jitter_ns)[place], transit[place]
        )
    arrival, behind = out + transit, sender.behind_ns
    if rules.fifo:
        # a lost message delays no other, but is not noticed before its predecessors arrive
        ahead = np.maximum.accumulate(np.where(fate == DELIVERED, arrival, behind))
        ahead = np.maximum(ahead, behind)
        arrival, behind = np.maximum(arrival, ahead), int(ahead[-1])
    if rules.playout_ns > 0:
        release = sent + rules.playout_ns
        fate[(fate == DELIVERED) & (arrival > release)] = LATE
        arrival = release
    refused = fate == QUEUE_FULL
    arrival[refused] = sent[refused]
    entries = Entries(arrival, sent, message, fate)
    return Sent(Sender(int(out[-1]), behind), entries, transit, copy)


def receive_block(
    rules: Rules, receiver: Receiver | Reception, arrived: Entries
) -> tuple[Receiver, Received]:
    """Receive the next entries in order of time: `stepping.receive` of each.

    Returns the receiver after them, and what it received.
    """
    message, fate = arrived.message, arrived.fate
    sound = fate == DELIVERED
    # what was accepted is at least as new as all that could have been
    newest = _following(receiver.newest, np.where(sound, message, NONE_YET))
    newest = np.maximum.accumulate(newest)
    status, accepted = fate, sound
    late = sound & (message <= newest[:-1])
    if rules.newest_wins and late.any():
        status = fate.copy()
        status[late] = OVERTAKEN
        status[late & (message == newest[:-1])] = DUPLICATE
        accepted = status == DELIVERED
    changed, used = accepted, message
    if rules.substitutes:
        missed = (fate == LOST) | (fate == LATE) | (fate >= min(ON_MEDIUM))
        noticed = missed & (newest[:-1] < message)
        changed, used = accepted | noticed, np.where(noticed, SUBSTITUTE, message)
    received = Received(
        before=receiver,
        arrival_ns=arrived.arrival_ns,
        sent_ns=arrived.sent_ns,
        message=message,
        status=status,
        changed=changed,
        sequence=_last_values(used, changed, receiver.sequence),
        origin_ns=_last_values(arrived.sent_ns, accepted, receiver.origin_ns),
        delivered=receiver.delivered + np.cumsum(accepted, dtype=np.int64),
    )
    return received.after(message.size)._replace(newest=int(newest[-1])), received


def _following(before: int, values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the values, with one before them."""
    found = np.empty(values.size + 1, np.int64)
    found[0], found[1:] = before, values
    return found


def _last_values(
    values: NDArray[np.int64], there: NDArray[np.bool_], before: int
) -> NDArray[np.int64]:
    """Return at each place the last value that is there; `before` ahead of the first."""
    if there.all():
        return values
    last = np.maximum.accumulate(np.where(there, np.arange(1, values.size + 1), 0))
    return _following(before, values)[last]


def _transmitted(
    rules: Rules, sender: Sender | Sending, sent: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return when the sender has sent each message, and whether the queue refuses it.

    One after the other: out[k] = max(sent[k], out[k-1]) + frame, which unrolls into
    frame (k + 1) + max over j <= k of (sent[j] - frame j), where the sender is free before the
    first at out[-1].
    """
    refused = np.zeros(sent.size, np.bool_)
    if rules.frame_ns == 0:
        return sent, refused
    before = np.int64(rules.frame_ns) * np.arange(sent.size, dtype=np.int64)
    free = np.maximum(np.maximum.accumulate(sent - before), sender.free_ns) + before
    if not (free - sent > rules.longest_wait_ns).any():
        return free + rules.frame_ns, refused
    out, now = [], sender.free_ns
    for k, instant in enumerate(sent.tolist()):
        if now - instant > rules.longest_wait_ns:
            refused[k] = True
        else:
            now = max(now, instant) + rules.frame_ns
        out.append(now)
    return np.array(out, np.int64), refused


def _with_copies(copied: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return place of the message, and whether it is a copy, of each entry, copies following."""
    place = np.repeat(np.arange(copied.size), 1 + copied)
    copy = np.zeros(place.size, np.bool_)
    copy[1:] = place[1:] == place[:-1]
    return place, copy
