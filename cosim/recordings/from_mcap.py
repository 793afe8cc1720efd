"""Recordings of the links of a trace, or of the topics of another MCAP file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network import IN_FLIGHT_NS, NOT_RECEIVED, REASONS, Recording
from cosim.recordings.lost_messages import with_due
from cosim.trace import Trace
from cosim.trace.rows import link_topic

_MAGIC = b"\x89MCAP"
_MISSED = tuple(REASONS[status] for status in NOT_RECEIVED)
_INTEGERS = NDArray[np.int64]


def is_mcap(path: Path) -> bool:
    """Whether a file begins like MCAP; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def recordings_in(path: Path) -> dict[str, Recording]:
    """Return the recordings in an MCAP file, by link or topic, in order of appearance.

    Raises
    ------
    InputError : a file without links, and without a topic whose messages are numbered; or without
        messages.
    """
    trace = Trace(path)
    names = trace.link_names
    if names:
        links = {name: _of_link(trace, name) for name in names}
        found = {name: recording for name, recording in links.items() if recording is not None}
    else:
        topics = {topic: _of_topic(trace, topic) for topic in trace.topics}
        found = {topic: recording for topic, recording in topics.items() if recording is not None}
    if not found:
        raise InputError(
            "the file contains no messages of a link",
            where=str(path),
            expected="a trace of a run with packet links, or topics with sequence numbers, sent at "
            "publish time and logged on arrival",
            got=", ".join(trace.topics) or "no topics",
        )
    return found


class _Seen(NamedTuple):
    """Entries of messages, in order of time; arrays of shape (m,)."""

    sequence: _INTEGERS
    sent_ns: _INTEGERS
    at_ns: _INTEGERS

    def first(self) -> dict[int, tuple[int, int]]:
        """Return instants of sending and of the first entry, by sequence number."""
        found: dict[int, tuple[int, int]] = {}
        for number, sent, at in zip(*(column.tolist() for column in self), strict=True):
            found.setdefault(number, (sent, at))
        return found


def _seen(trace: Trace, topic: str) -> _Seen:
    rows = [(number, sent, at) for _, number, at, sent, _ in trace.messages([topic])]
    return _Seen(*np.array(rows, np.int64).reshape(-1, 3).T)


def _of_link(trace: Trace, name: str) -> Recording | None:
    """Return what became of every message that a link sent; None if it sent none.

    What came too late for its receiver, after a newer message, did arrive.
    """
    dropped = trace.dropped(name)
    reasons = dropped["reason"]
    late = np.isin(reasons, _MISSED)
    rows = _Seen(dropped.sequence, dropped.publish_time_ns, dropped.log_time_ns)
    missed = _Seen._make(column[late] for column in rows).first()
    others = [_seen(trace, link_topic(name)), _Seen._make(column[~late] for column in rows)]
    arrived = _Seen._make(np.concatenate(pair) for pair in zip(*others, strict=True)).first()
    counted = (trace.links or {}).get(name, {}).get("sent")
    count = max([int(counted or 0), *(k + 1 for k in arrived), *(k + 1 for k in missed)])
    if not count:
        return None
    link = json.loads(trace.run.get(f"link.{name}", "{}"))
    every, offset = int(link.get("sample_time_ns", 0)), int(link.get("offset_ns", 0))
    sent, delay, lost = [], [], []
    for k in range(count):
        own, at = arrived.get(k) or missed.get(k) or (offset + k * every, None)
        sent.append(own)
        delay.append(IN_FLIGHT_NS if at is None else at - own)
        lost.append(k in missed and k not in arrived)
    instants = np.maximum.accumulate(np.array(sent, np.int64))
    return Recording(
        instants - instants[0],
        np.array(lost),
        np.array(delay, np.int64),
        start_ns=int(instants[0]),
    )


def _of_topic(trace: Trace, topic: str) -> Recording | None:
    """Return the recording of a topic; None if its messages are not numbered one by one.

    A missing number is a lost message, sent between those beside it at equal distances.
    """
    seen = _seen(trace, topic)
    found = seen.first()
    numbers = np.array(sorted(found), np.int64)
    if numbers.size < 2 or numbers.size < len(seen.sequence):
        return None
    sent, at = np.array([found[k] for k in numbers.tolist()], np.int64).T
    if (np.diff(sent) < 0).any() or (at < sent).any():
        raise InputError(
            "the messages of a topic are no recording of a link",
            where=f"{trace.path}, topic {topic}",
            expected="publish times that grow with the sequence number, and log times after them",
            got="others",
        )
    every = np.arange(numbers[0], numbers[-1] + 1)
    first = int(sent[0])
    between = np.rint(np.interp(every, numbers, sent - first)).astype(np.int64)
    delays: list[int | None] = [None] * every.size
    for place, delay in zip((numbers - numbers[0]).tolist(), (at - sent).tolist(), strict=True):
        delays[place] = delay
    lost = np.array([delay is None for delay in delays])
    return Recording(between, lost, with_due(delays), start_ns=first)
