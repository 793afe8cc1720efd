"""Read parts of an MCAP file by their place: chunks, indexes, attachments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment

from cosim.trace.file.contents import Contents, Segment, declared_only
from cosim.trace.file.declared import Declarations
from cosim.trace.file.messages import Messages, entries_of, find_messages
from cosim.trace.file.records import HEAD, DamageError, chunk_data, open_trace, parsed
from cosim.trace.file.walk import Walk


def read_segment(stream: BinaryIO, segment: Segment, declared: Declarations) -> Messages:
    """Read the messages of a segment; `DamageError` if it is damaged."""
    try:
        stream.seek(segment.position)
        raw = stream.read(segment.size + segment.index_size)
    except OSError as error:
        raise DamageError(f"reading failed: {error.strerror}") from error
    if len(raw) < segment.size + segment.index_size:
        raise DamageError(f"the file ends in the record at byte {segment.position}")
    try:
        if segment.chunk:
            data = chunk_data(memoryview(raw)[HEAD.size : segment.size])
            found, _, damage = find_messages(data, _indexes(memoryview(raw)[segment.size :]))
        else:
            found, _, damage = find_messages(raw, [])
    except DamageError as error:
        raise DamageError(f"record at byte {segment.position}: {error}") from None
    found, stranger = declared_only(found, declared)
    damage = stranger or damage
    if damage is not None and not segment.damaged:
        raise DamageError(f"record at byte {segment.position}: {damage}")
    return found


def _indexes(raw: memoryview) -> list[memoryview]:
    """Contents of the message index records; none where something else is among them."""
    found, at = [], 0
    while at + HEAD.size <= len(raw):
        opcode, length = HEAD.unpack_from(raw, at)
        at += HEAD.size
        if opcode != Opcode.MESSAGE_INDEX or length > len(raw) - at:
            return []
        found.append(raw[at : at + length])
        at += length
    return found


def times_of(path: Path, contents: Contents) -> dict[int, tuple[int, int]]:
    """Return least and greatest log time by channel, from indexes, or the data without them.

    A segment is read only if it may hold an earlier or later message of a channel than found yet.

    Raises
    ------
    DamageError : neither can be read.
    """
    with open_trace(path) as stream:
        least = _extremes(stream, contents, sign=1)
        greatest = _extremes(stream, contents, sign=-1)
    return {number: (low, -greatest[number]) for number, low in least.items()}


def _extremes(stream: BinaryIO, contents: Contents, sign: int) -> dict[int, int]:
    """Return the least sign * log time by channel, from the segments in order of that."""
    found: dict[int, int] = {}
    waiting = {number for number, count in contents.counts.items() if count}
    bounds = [(s.start_ns if sign > 0 else -s.end_ns, s) for s in contents.segments]
    for bound, segment in sorted(bounds, key=lambda each: each[0]):
        waiting -= {number for number in waiting if found.get(number, bound + 1) <= bound}
        if not waiting:
            break
        if segment.channels is None or not segment.channels.isdisjoint(waiting):
            for number, low, high in _times(stream, segment, contents):
                time = low if sign > 0 else -high
                found[number] = min(time, found.get(number, time))
    return {number: time for number, time in found.items() if contents.counts.get(number)}


def _times(
    stream: BinaryIO, segment: Segment, contents: Contents
) -> Iterator[tuple[int, int, int]]:
    """Yield channel, least and greatest log time of the messages of a segment."""
    stream.seek(segment.position + segment.size)
    entries = [entries_of(i) for i in _indexes(memoryview(stream.read(segment.index_size)))]
    known = [entry for entry in entries if entry is not None]
    if frozenset(channel for channel, _ in known) == segment.channels:
        for channel, pairs in known:
            if len(pairs):
                yield channel, int(pairs[:, 0].min()), int(pairs[:, 0].max())
        return
    for channel, low, high, _ in read_segment(stream, segment, contents.declared).spans():
        yield channel, low, high


def attachment_data(path: Path, places: Mapping[str, tuple[int, int]]) -> dict[str, bytes]:
    """Read attachments by name.

    Raises
    ------
    DamageError : there is no attachment at a place, or its checksum does not match.
    """
    found = {}
    with open_trace(path) as stream:
        for name, (position, size) in places.items():
            stream.seek(position)
            raw = stream.read(size)
            if len(raw) < size or HEAD.unpack_from(raw) != (
                Opcode.ATTACHMENT,
                size - HEAD.size,
            ):
                raise DamageError(f"no attachment at byte {position}")
            found[name] = parsed(Attachment, memoryview(raw)[HEAD.size :]).data
    return found


def check_outer_records(path: Path) -> None:
    """Read every record of a file, chunks unopened; `DamageError` where one is damaged."""
    for _ in Walk(path, chunks=False):
        pass
