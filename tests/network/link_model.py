"""A link, event by event, in integers and fractions: slow, obvious, and on its own.

It shares nothing with `cosim.network` but the declaration of the link and the raw draws (uniform
numbers, jitter, which message is copied). The sender's queue is a list of waiting messages,
the channel a heap of events, the play-out buffer a shelf, the receiver a person with a notebook.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

from cosim.network import GilbertElliott, PacketLink, draws

Label = tuple[int, int]
"""A message and which of its two: 0 itself, 1 its copy."""

ON_MEDIUM = ("collided", "receiver sending", "out of range")
_CODES = {"none": -1, "substitute": -2}
_SENDER_DONE, _SEND, _ARRIVE, _PLAY, _OUT = 0, 1, 2, 3, 4


@dataclass
class Entry:
    """A message or a copy in flight."""

    sent: int
    transit: int
    lost: bool
    refused: bool
    late: bool = False
    due: int | None = None  # when it has crossed the channel
    arrival: int | None = None  # when the receiver gets, or misses, it
    fate: str = "in flight"

    @property
    def gone(self) -> bool:
        return self.lost or self.refused


@dataclass
class Note:
    """What the receiver knows from an instant on."""

    time: int = -1
    used: Label | str = "none"
    origin: int = 0
    delivered: int = 0
    dropped: int = 0
    effect: str = ""


@dataclass
class Outcome:
    """The outcome of a run."""

    end: int
    entries: dict[Label, Entry]
    notes: list[Note] = field(default_factory=lambda: [Note()])
    received: list[tuple[Label, str]] = field(default_factory=list)
    of_medium: tuple[str, ...] = ()  # fates of a link over a medium alone

    @cached_property
    def labels(self) -> list[Label]:
        return sorted(self.entries)

    def at(self, t: int) -> Note:
        return next(note for note in reversed(self.notes) if note.time <= t)

    def index(self, used: Label | str) -> int:
        return _CODES[used] if isinstance(used, str) else self.labels.index(used)

    def sequence(self, used: Label | str) -> int:
        return _CODES[used] if isinstance(used, str) else used[0]

    def sent(self, used: Label | str) -> int:
        return _CODES[used] if isinstance(used, str) else self.entries[used].sent

    def changes(self) -> dict[int, str]:
        """Instants at which what is in use changes, and what did it last."""
        return {note.time: note.effect for note in self.notes if note.effect}

    def statistics(self) -> dict[str, int | Fraction | None]:
        fates = [e.fate for e in self.entries.values()]
        delays = [e.arrival - e.sent for e in self.entries.values() if e.fate == "delivered"]
        ages = []
        for note, following in zip(self.notes, [*self.notes[1:], Note(self.end)], strict=True):
            if not isinstance(note.used, str):
                ages.append(following.time - note.origin)
        dropped = len(fates) - fates.count("delivered") - fates.count("in flight")
        return {
            "sent": sum(copy == 0 for _, copy in self.entries),
            "duplicated": sum(copy == 1 for _, copy in self.entries),
            "delivered": fates.count("delivered"),
            "dropped": dropped,
            "lost": fates.count("lost"),
            "overtaken": fates.count("overtaken"),
            "late": fates.count("late"),
            "queue_full": fates.count("queue full"),
            **{name.replace(" ", "_"): fates.count(name) for name in self.of_medium},
            "discarded_copies": fates.count("duplicate"),
            "in_flight": fates.count("in flight"),
            "substitutions": sum(effect == "noticed" for effect in self.changes().values()),
            "mean_delay_s": Fraction(sum(delays), len(delays) * 10**9) if delays else None,
            "max_delay_s": Fraction(max(delays), 10**9) if delays else None,
            "max_age_s": Fraction(max(ages), 10**9) if ages else None,
        }


class Raw(NamedTuple):
    """The raw draws of a link's messages."""

    jitter: list[int]
    lost: list[bool]
    copied: list[bool]
    copy_jitter: list[int]


def raw_draws(link: PacketLink, end: int, points: Sequence[int] | None = None) -> Raw:
    """Return the draws of a run; of a live link on a grid `points`, since windows count there."""
    nominal = range(link.offset_ns, end + 1, link.sample_time_ns)
    source = (link.seed, link.name, len(nominal))
    if link.recording is None:
        lost = chain_losses(link, len(nominal))
    else:
        lost = [bool(link.recording.lost[row]) for row in recorded_rows(link, len(nominal))]
    up = LinkModel(link, end, points if link.is_live else None).up
    for window in link.windows:
        others = draws.lost(window.loss, *source).tolist()
        inside = [window.from_ns <= up(t) < window.until_ns for t in nominal]
        lost = [o if i else own for own, o, i in zip(lost, others, inside, strict=True)]
    return Raw(
        draws.jitter_ns(link.jitter, *source).tolist(),
        lost,
        draws.duplicated(link.duplicate, *source).tolist(),
        draws.jitter_ns(link.jitter, *source, "copy jitter").tolist(),
    )


def chain_losses(link: PacketLink, count: int) -> list[bool]:
    """The losses of a link, walked message by message."""
    u = draws.uniform(link.seed, link.name, "loss", count)
    change = draws.uniform(link.seed, link.name, "loss state", count)
    if isinstance(link.loss, int | float):
        return [x < link.loss for x in u]
    if isinstance(link.loss, GilbertElliott):
        p, q = link.loss.p_enter, link.loss.p_exit
        leaving, losses = [[p], [q]], [link.loss.loss_good, link.loss.loss_bad]
    else:
        rows = [list(row) for row in link.loss.transitions]
        leaving = [row[:i] + row[i + 1 :] for i, row in enumerate(rows)]
        losses = list(link.loss.loss)
    state, lost = 0, []
    for k in range(count):
        others = [other for other in range(len(losses)) if other != state]
        total = 0.0
        for other, p in zip(others, leaving[state], strict=True) if k else ():
            total += p
            if change[k] < total:
                state = other
                break
        lost.append(bool(u[k] < losses[state]))
    return lost


def recorded_rows(link: PacketLink, count: int) -> list[int]:
    """The row of its recording that each message takes, found by looking from the start."""
    recording = link.recording
    assert recording is not None
    sent = recording.sent_ns.tolist()
    delays = [0] * len(sent) if recording.delay_ns is None else recording.delay_ns.tolist()
    order = list(range(len(sent)))
    if recording.rows == "time":
        order, t = [], 0
        while t <= sent[-1]:
            order.append(max(k for k, instant in enumerate(sent) if instant <= t))
            t += link.sample_time_ns
    if recording.replay == "once":
        return order[:count]
    whole = [row for row in order if min(delays[: row + 1]) >= 0]
    if recording.replay == "loop":
        return [whole[k % len(whole)] for k in range(count)]
    block, rows = recording.block, []
    u = draws.uniform(link.seed, link.name, "recording", count).tolist()
    while len(rows) < count:
        begin = math.floor(u[len(rows) // block] * (len(whole) - block + 1))
        rows += whole[begin : begin + block]
    return rows[:count]


def run(
    link: PacketLink,
    end: int,
    raw: Raw,
    delay_of: Callable[[int, int], int],
    points: Sequence[int] | None = None,
) -> Outcome:
    """Compute what becomes of every message sent in [0, end].

    `raw` holds the draws of this run or of a longer one; `delay_of(message, sent)` is the
    delay without jitter; all instants are rounded up to `points`, if there are any.
    """
    model = LinkModel(link, end, points)
    nominal = range(link.offset_ns, end + 1, link.sample_time_ns)
    return model.run([model.up(t) for t in nominal], raw, delay_of)


class LinkModel:
    def __init__(self, link: PacketLink, end: int, points: Sequence[int] | None) -> None:
        self.link, self.points = link, points
        self.frame = (
            math.ceil(Fraction(link.frame_size * 10**9, link.data_rate)) if link.data_rate else 0
        )
        self.outcome = Outcome(end, {})
        self.events: list[tuple[Any, ...]] = []
        self.waiting: list[int] = []
        self.busy_until: int | None = None
        self.line: list[Label] = []  # sent and neither received nor missed yet
        self.newest = -1
        self.buffered: set[Label] = set()  # arrived, and waiting for their play-out

    def up(self, t: int) -> int:
        if self.points is None:
            return t
        later = [p for p in self.points if p >= t]
        return later[0] if later else t

    def run(self, sent: list[int], raw: Raw, delay_of: Callable[[int, int], int]) -> Outcome:
        for k, t in enumerate(sent):
            self.events.append((t, _SEND, k))
        heapq.heapify(self.events)
        entries = self.outcome.entries
        while self.events:
            t, what, k, *more = heapq.heappop(self.events)
            if what == _SEND:
                delay = delay_of(k, t)
                refused = self.is_full(k)
                entries[k, 0] = Entry(t, delay + raw.jitter[k], raw.lost[k], refused)
                self.line.append((k, 0))
                if raw.copied[k] and not entries[k, 0].gone:
                    entries[k, 1] = Entry(t, delay + raw.copy_jitter[k], lost=False, refused=False)
                    self.line.append((k, 1))
                if self.link.playout_ns:
                    heapq.heappush(self.events, (t + self.link.playout_ns, _PLAY, k))
                self.hand_to_sender(t, k, refused=refused)
            elif what == _SENDER_DONE:
                self.busy_until = None
                self.leave(t, k)
                if self.waiting:
                    self.begin(t, self.waiting.pop(0))
            elif what == _PLAY:
                self.play(t, k)
            elif what == _OUT:
                self.receive(t, (k, more[0]))
            else:
                self.arrived(t, [(k, more[0]), *self.others(t)])
        return self.outcome

    def others(self, t: int) -> list[Label]:
        """Take what else crosses the channel at this instant."""
        together = []
        while self.events and self.events[0][:2] == (t, _ARRIVE):
            together.append(heapq.heappop(self.events)[2:])
        return together

    def is_full(self, k: int) -> bool:
        del k
        busy = self.busy_until is not None
        limit = self.link.queue_limit
        return busy and limit is not None and len(self.waiting) >= limit

    def hand_to_sender(self, t: int, k: int, *, refused: bool) -> None:
        if refused:
            what = _OUT if self.link.playout_ns else _ARRIVE
            heapq.heappush(self.events, (t, what, k, 0))
        elif self.busy_until is not None:
            self.waiting.append(k)
        else:
            self.begin(t, k)

    def begin(self, t: int, k: int) -> None:
        if self.frame == 0:
            self.leave(t, k)
            return
        self.busy_until = t + self.frame
        heapq.heappush(self.events, (self.busy_until, _SENDER_DONE, k))

    def leave(self, t: int, k: int) -> None:
        for label in ((k, 0), (k, 1)):
            entry = self.outcome.entries.get(label)
            if entry is not None:
                over = t + entry.transit
                # a buffer compares instants as they are; what it releases waits for a point
                at = over if self.link.playout_ns else self.up(over)
                heapq.heappush(self.events, (at, _ARRIVE, *label))

    def play(self, t: int, k: int) -> None:
        """The instant at which message k and its copy leave the buffer, if they are there."""
        for label in ((k, 0), (k, 1)):
            entry = self.outcome.entries.get(label)
            if entry is not None and not entry.refused:
                entry.late = label not in self.buffered
                heapq.heappush(self.events, (self.up(t), _OUT, *label))

    def arrived(self, t: int, labels: list[Label]) -> None:
        """All that crosses the channel at one instant."""
        for label in labels:
            self.outcome.entries[label].due = t
        if self.link.order != "fifo":
            for label in labels:
                self.line.remove(label)
                self.out(t, label)
            return
        for other in list(self.line):
            due = self.outcome.entries[other].due
            ahead = self.line[: self.line.index(other)]
            if due is None:
                continue
            refused = self.outcome.entries[other].refused
            if refused or all(self.outcome.entries[a].gone for a in ahead):
                self.line.remove(other)
                self.out(t, other)

    def out(self, t: int, label: Label) -> None:
        """A message leaves the channel: for the receiver, or for the shelf."""
        if self.link.playout_ns:
            self.buffered.add(label)
        else:
            self.receive(t, label)

    def receive(self, t: int, label: Label) -> None:
        entry, k = self.outcome.entries[label], label[0]
        entry.arrival = t
        if t > self.outcome.end:
            return
        last = self.outcome.notes[-1]
        note = Note(t, last.used, last.origin, last.delivered, last.dropped)
        if last.time == t:
            note.effect = last.effect
            self.outcome.notes.pop()
        self.outcome.notes.append(note)
        newest_wins = self.link.order == "newest-wins"
        if entry.gone or entry.late:
            entry.fate = "queue full" if entry.refused else "lost" if entry.lost else "late"
            if not entry.refused and self.link.on_loss != "hold" and self.newest < k:
                note.used, note.effect = "substitute", "noticed"
        elif newest_wins and k <= self.newest:
            entry.fate = "overtaken" if k < self.newest else "duplicate"
        else:
            entry.fate = "delivered"
            self.newest = max(self.newest, k)
            note.used, note.origin, note.effect = label, entry.sent, "delivered"
        self.outcome.received.append((label, entry.fate))
        note.delivered += entry.fate == "delivered"
        note.dropped += entry.fate != "delivered"
