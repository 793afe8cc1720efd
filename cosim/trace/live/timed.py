"""Read the messages of a trace in order of time, from any instant on, a chunk at a time."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from cosim.core import LossError
from cosim.trace.file.contents import Segment
from cosim.trace.file.messages import Messages
from cosim.trace.file.records import LATEST_SIGNED_NS
from cosim.trace.reader import Trace

_KEPT = 4


class TimedMessage(NamedTuple):
    """A message: id of its channel, log time [ns], payload."""

    channel: int
    log_ns: int
    payload: memoryview


class TimedMessages:
    """The messages of a trace in order of log time; of equal times, in file order.

    Messages of later times than `LATEST_SIGNED_NS`, which a file may claim, count as of that one.

    Only chunks that overlap in time are in memory together. A chunk that turns out to be damaged
    is passed over.

    Attributes
    ----------
    first_ns, last_ns : least and greatest log time.
    damage : what could not be read, and why.
    """

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        spans = trace.spans.values()
        self.first_ns = min((min(low, LATEST_SIGNED_NS) for low, _ in spans), default=0)
        self.last_ns = max((min(high, LATEST_SIGNED_NS) for _, high in spans), default=0)
        self.damage: list[str] = []
        self._segments = sorted(trace.segments, key=lambda s: (s.start_ns, s.position))
        self._starts = [min(s.start_ns, LATEST_SIGNED_NS) for s in self._segments]
        # end of this segment and of all before it: where nothing earlier is left to come
        self._ends = list(
            accumulate((min(s.end_ns, LATEST_SIGNED_NS) for s in self._segments), max)
        )
        self._read: OrderedDict[int, Messages] = OrderedDict()
        self._used = [number for number, count in trace.counts.items() if count]

    def between(self, first_ns: int, last_ns: int) -> Iterator[TimedMessage]:
        """Yield the messages of log times first_ns to last_ns, both included."""
        waiting: list[tuple[Segment, Messages]] = []
        begin = int(np.searchsorted(self._ends, first_ns))
        end = int(np.searchsorted(self._starts, last_ns, side="right"))
        for k in range(begin, end):
            segment = self._segments[k]
            if waiting:
                yield from _before(waiting, self._starts[k])
            if min(segment.end_ns, LATEST_SIGNED_NS) >= first_ns:
                messages = self._messages(segment)
                log = np.minimum(messages.heads["log"], LATEST_SIGNED_NS)
                inside = (log >= first_ns) & (log <= last_ns)
                waiting.append((segment, messages.part(np.flatnonzero(inside))))
        yield from _before(waiting, None)

    def latest(self, at_ns: int) -> list[TimedMessage]:
        """Return the last message of each channel up to an instant, in order of time."""
        found: dict[int, TimedMessage] = {}
        waiting = set(self._used)
        for k in reversed(range(int(np.searchsorted(self._starts, at_ns, side="right")))):
            waiting -= {n for n in waiting if n in found and found[n].log_ns >= self._ends[k]}
            segment = self._segments[k]
            if not waiting:
                break
            if segment.channels is not None and segment.channels.isdisjoint(waiting):
                continue
            messages = self._messages(segment)
            log = np.minimum(messages.heads["log"], LATEST_SIGNED_NS)
            for number, mine in messages.by_channel():
                mine = mine[log[mine] <= at_ns]  # noqa: PLW2901
                if number in waiting and mine.size:
                    last = mine[np.argsort(log[mine], kind="stable")[-1:]]
                    one = next(_messages(messages.part(last)))
                    if number not in found or one.log_ns > found[number].log_ns:
                        found[number] = one
        return sorted(found.values(), key=lambda message: message.log_ns)

    def _messages(self, segment: Segment) -> Messages:
        if segment.position in self._read:
            self._read.move_to_end(segment.position)
            return self._read[segment.position]
        try:
            messages = self._trace.read_segment(segment)
        except LossError as error:
            self.damage.append(str(error.got))
            messages = Messages.at(b"", np.zeros(0, np.int64))
        self._read[segment.position] = messages
        while len(self._read) > _KEPT:
            self._read.popitem(last=False)
        return messages


def _before(
    waiting: list[tuple[Segment, Messages]], bound_ns: int | None
) -> Iterator[TimedMessage]:
    """Yield, and take away, the messages before an instant, or all, in order of time."""
    logs = [np.minimum(messages.heads["log"], LATEST_SIGNED_NS) for _, messages in waiting]
    if bound_ns is not None:
        chosen = [np.flatnonzero(log < bound_ns) for log in logs]
    else:
        chosen = [np.arange(log.size) for log in logs]
    if len(waiting) == 1:
        order = chosen[0][np.argsort(logs[0][chosen[0]], kind="stable")]
        yield from _messages(waiting[0][1].part(order))
    elif waiting:
        parts = [list(_messages(m.part(c))) for (_, m), c in zip(waiting, chosen, strict=True)]
        places = [segment.position for segment, _ in waiting]
        keyed = [(m.log_ns, p, m) for p, part in zip(places, parts, strict=True) for m in part]
        yield from (message for _, _, message in sorted(keyed, key=lambda each: each[:2]))
    waiting[:] = [
        (segment, messages.part(np.flatnonzero(log >= bound_ns)))
        for (segment, messages), log in zip(waiting, logs, strict=True)
        if bound_ns is not None and (log >= bound_ns).any()
    ]


def _messages(messages: Messages) -> Iterator[TimedMessage]:
    heads = messages.heads
    log = np.minimum(heads["log"], LATEST_SIGNED_NS)
    for number, at, payload in zip(
        heads["channel"].tolist(), log.tolist(), messages.payloads(), strict=True
    ):
        yield TimedMessage(number, at, payload)
