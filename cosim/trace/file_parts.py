"""Read parts of an MCAP file by their place: chunks, indexes, attachments."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode

from cosim.trace.contents import RECORD, Contents, Segment, declared_only
from cosim.trace.declared import Declarations
from cosim.trace.messages import Messages, entries_of, find_messages
from cosim.trace.records import Cursor, DamageError, chunk_data, open_trace, outer_records


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
            data = chunk_data(memoryview(raw)[RECORD.size : segment.size])
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
    while at + RECORD.size <= len(raw):
        opcode, length = RECORD.unpack_from(raw, at)
        at += RECORD.size
        if opcode != Opcode.MESSAGE_INDEX or length > len(raw) - at:
            return []
        found.append(raw[at : at + length])
        at += length
    return found


def times_of(path: Path, contents: Contents) -> dict[int, tuple[int, int]]:
    """Return least and greatest log time by channel, from indexes, or the data without them.

    Raises
    ------
    DamageError : neither can be read.
    """
    found: dict[int, tuple[int, int]] = {}

    def note(channel: int, low: int, high: int) -> None:
        before = found.get(channel, (low, high))
        found[channel] = min(low, before[0]), max(high, before[1])

    with open_trace(path) as stream:
        for segment in contents.segments:
            stream.seek(segment.position + segment.size)
            entries = [entries_of(i) for i in _indexes(memoryview(stream.read(segment.index_size)))]
            known = [entry for entry in entries if entry is not None]
            if frozenset(channel for channel, _ in known) == segment.channels:
                for channel, pairs in known:
                    if len(pairs):
                        note(channel, int(pairs[:, 0].min()), int(pairs[:, 0].max()))
                continue
            heads = read_segment(stream, segment, contents.declared).heads
            for channel in np.unique(heads["channel"]).tolist():
                times = heads["log"][heads["channel"] == channel]
                note(channel, int(times.min()), int(times.max()))
    return {channel: span for channel, span in found.items() if contents.counts.get(channel)}


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
            if len(raw) < size or RECORD.unpack_from(raw) != (
                Opcode.ATTACHMENT,
                size - RECORD.size,
            ):
                raise DamageError(f"no attachment at byte {position}")
            checksum = int.from_bytes(raw[-4:], "little")
            if checksum not in (0, zlib.crc32(raw[RECORD.size : -4])):
                raise DamageError("the checksum of an attachment does not match")
            fields = Cursor(memoryview(raw)[RECORD.size :])
            fields.take(16)
            fields.text()
            fields.text()
            found[name] = bytes(fields.take(fields.number(8)))
    return found


def check_outer_records(path: Path) -> None:
    """Read every record of a file, chunks unopened; `DamageError` where one is damaged."""
    for _ in outer_records(path):
        pass
