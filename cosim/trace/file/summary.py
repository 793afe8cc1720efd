"""Read the contents of an MCAP file from its summary, if that is consistent.

Its checksum and counts must be right, every chunk must be where it says, and no message may lie
between the records it names.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Header, Metadata, MetadataIndex, Statistics

from cosim.trace.file.checksum import crc32
from cosim.trace.file.contents import Contents, Segment
from cosim.trace.file.records import (
    HEAD,
    MAGIC,
    DamageError,
    check_start,
    open_trace,
    parsed,
)

_FOOTER = struct.Struct("<QQI")
_CHUNK_INDEX = struct.Struct("<QQQQI")
_MOST = 2**62
_OFFSET = np.dtype([("channel", "<u2"), ("at", "<u8")])


def from_summary(path: Path) -> Contents | None:
    """Read the contents from the summary; None if it is missing or inconsistent.

    Raises
    ------
    InputError : no such file, or not an MCAP file.
    """
    with open_trace(path) as stream:
        try:
            size = stream.seek(0, 2)
            check_start(_read(stream, 0, len(MAGIC)), size, path)
            return _Summary(stream, size).contents()
        except (DamageError, OSError, struct.error):
            return None


def _read(stream: BinaryIO, position: int, size: int) -> bytes:
    """Read bytes by their place; `DamageError` if no file can have so many."""
    if not 0 <= position <= _MOST - size:
        raise DamageError(f"a place beyond the file, {position}")
    stream.seek(position)
    return stream.read(size)


class _Summary:
    """The summary section, taken apart."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream, self._size = stream, size
        self._known = Contents()
        self._named: list[tuple[int, int]] = []  # begin and end of the records in the summary
        self._metadata: list[int] = []
        self._sets: dict[bytes, frozenset[int]] = {}
        self._numbers: tuple[int, ...] | None = None

    def contents(self) -> Contents | None:
        tail = HEAD.size + _FOOTER.size + len(MAGIC)
        at = self._size - tail
        if at < len(MAGIC):
            return None
        footer = _read(self._stream, at, tail)
        if footer[-len(MAGIC) :] != MAGIC or HEAD.unpack_from(footer) != (
            Opcode.FOOTER,
            _FOOTER.size,
        ):
            return None
        start, _, checksum = _FOOTER.unpack_from(footer, HEAD.size)
        if not len(MAGIC) < start < at:
            return None
        section = _read(self._stream, start, at - start)
        if checksum not in (0, crc32(footer[: HEAD.size + 16], crc32(section))):
            return None
        for opcode, content in _records(section):
            self._take(opcode, content)
        return self._known if self._adds_up(start) else None

    def _take(self, opcode: int, content: memoryview) -> None:
        known = self._known
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            known.declared.add([(opcode, content)])
        elif opcode == Opcode.STATISTICS:
            found = parsed(Statistics, content)
            self._numbers = (
                found.message_count,
                found.channel_count,
                found.attachment_count,
                found.metadata_count,
                found.chunk_count,
            )
            known.counts.update(found.channel_message_counts)
        elif opcode == Opcode.CHUNK_INDEX:
            self._chunk(content)
        elif opcode == Opcode.ATTACHMENT_INDEX:
            index = parsed(AttachmentIndex, content)
            known.attachments[index.name] = index.offset, index.length
            known.media_types[index.name] = index.media_type
            self._named.append((index.offset, index.offset + index.length))
        elif opcode == Opcode.METADATA_INDEX:
            place = parsed(MetadataIndex, content)
            self._metadata.append(place.offset)
            self._named.append((place.offset, place.offset + place.length))

    def _chunk(self, content: memoryview) -> None:
        """Take a chunk index, by arrays: one of thousands of channels is long."""
        if len(content) < _CHUNK_INDEX.size:
            raise DamageError("a field is longer than its record")
        first, last, at, size, length = _CHUNK_INDEX.unpack_from(content)
        if length % _OFFSET.itemsize or length > len(content) - _CHUNK_INDEX.size - 8:
            raise DamageError("a field is longer than its record")
        offsets = np.frombuffer(content, _OFFSET, length // _OFFSET.itemsize, _CHUNK_INDEX.size)
        ids = offsets["channel"].tobytes()
        if ids not in self._sets:
            self._sets[ids] = frozenset(offsets["channel"].tolist())
        after = _CHUNK_INDEX.size + length
        index = int.from_bytes(content[after : after + 8], "little")
        if at + size + index > self._size:
            raise DamageError("a chunk index leads beyond the file")
        indexed = self._sets[ids] if index else None
        segment = Segment(at, size, chunk=True, index_size=index, channels=indexed)
        segment.start_ns, segment.end_ns = first, last
        segment.data_size = int.from_bytes(content[-8:], "little")
        self._known.segments.append(segment)
        self._named.append((at, at + size + index))

    def _adds_up(self, end: int) -> bool:
        known = self._known
        found = (
            sum(known.counts.values()),
            len(known.declared.channels),
            len(known.attachments),
            len(self._metadata),
            len(known.segments),
        )
        if found != self._numbers or not known.counts.keys() <= known.declared.channels.keys():
            return False
        known.segments.sort(key=lambda segment: segment.position)
        for segment in known.segments:
            head = HEAD.unpack(_read(self._stream, segment.position, HEAD.size))
            if head != (Opcode.CHUNK, segment.size - HEAD.size):
                return False
        for at in sorted(self._metadata):
            opcode, length = HEAD.unpack(_read(self._stream, at, HEAD.size))
            if opcode != Opcode.METADATA or length > end:
                return False
            record = parsed(Metadata, _read(self._stream, at + HEAD.size, length))
            known.metadata.append((record.name, record.metadata))
        return self._nothing_between(end)

    def _nothing_between(self, end: int) -> bool:
        """Whether no message and no chunk lies outside what the summary names."""
        at, opcode = len(MAGIC), 0
        for begin, after in [*sorted(self._named), (end, end)]:
            while at < begin:
                opcode, length = HEAD.unpack(_read(self._stream, at, HEAD.size))
                if opcode in (0, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA, Opcode.ATTACHMENT):
                    return False
                if opcode == Opcode.HEADER:
                    content = _read(self._stream, at + HEAD.size, min(length, end))
                    self._known.library = parsed(Header, content).library
                at += HEAD.size + length
            if at != begin:
                return False
            at = after
        return opcode == Opcode.DATA_END


def _records(section: bytes) -> Iterator[tuple[int, memoryview]]:
    view, at = memoryview(section), 0
    while at < len(section):
        opcode, length = HEAD.unpack_from(section, at)
        at += HEAD.size
        if length > len(section) - at:
            raise DamageError("a record of the summary is cut short")
        yield opcode, view[at : at + length]
        at += length
