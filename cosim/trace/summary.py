"""Read the contents of an MCAP file from its summary, if that is consistent.

Its checksum and counts must be right, every chunk must be where it says, and no message may lie
between the records it names.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from cosim.trace.contents import RECORD, Contents, Segment
from cosim.trace.records import MAGIC, Cursor, DamageError, check_start, open_trace

_FOOTER = struct.Struct("<QQI")


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
    stream.seek(position)
    return stream.read(size)


class _Summary:
    """The summary section, taken apart."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream, self._size = stream, size
        self._known = Contents()
        self._named: list[tuple[int, int]] = []  # begin and end of the records in the summary
        self._metadata: list[int] = []
        self._numbers: tuple[int, ...] | None = None

    def contents(self) -> Contents | None:
        tail = RECORD.size + _FOOTER.size + len(MAGIC)
        at = self._size - tail
        if at < len(MAGIC):
            return None
        footer = _read(self._stream, at, tail)
        if footer[-len(MAGIC) :] != MAGIC or RECORD.unpack_from(footer) != (
            Opcode.FOOTER,
            _FOOTER.size,
        ):
            return None
        start, _, checksum = _FOOTER.unpack_from(footer, RECORD.size)
        if not len(MAGIC) < start < at:
            return None
        section = _read(self._stream, start, at - start)
        if checksum not in (0, zlib.crc32(footer[: RECORD.size + 16], zlib.crc32(section))):
            return None
        for opcode, content in _records(section):
            self._take(opcode, content)
        return self._known if self._adds_up(start) else None

    def _take(self, opcode: int, content: memoryview) -> None:
        known, fields = self._known, Cursor(content)
        if opcode == Opcode.SCHEMA:
            known.declared.add_schema(content)
        elif opcode == Opcode.CHANNEL:
            known.declared.add_channel(content)
        elif opcode == Opcode.STATISTICS:
            total, _, channels, attachments, metadata, chunks = (
                fields.number(n) for n in (8, 2, 4, 4, 4, 4)
            )
            self._numbers = total, channels, attachments, metadata, chunks
            fields.take(16)
            counts = Cursor(fields.take(fields.number(4)))
            while counts.left:
                channel = counts.number(2)
                known.counts[channel] = counts.number(8)
        elif opcode == Opcode.CHUNK_INDEX:
            self._chunk(fields)
        elif opcode == Opcode.ATTACHMENT_INDEX:
            at, size, _, _, _ = (fields.number(8) for _ in range(5))
            name = fields.text()
            known.attachments[name], known.media_types[name] = (at, size), fields.text()
            self._named.append((at, at + size))
        elif opcode == Opcode.METADATA_INDEX:
            at, size = fields.number(8), fields.number(8)
            self._metadata.append(at)
            self._named.append((at, at + size))

    def _chunk(self, fields: Cursor) -> None:
        first, last, at, size = (fields.number(8) for _ in range(4))
        offsets = Cursor(fields.take(fields.number(4)))
        channels = set()
        while offsets.left:
            channels.add(offsets.number(2))
            offsets.take(8)
        index = fields.number(8)
        indexed = frozenset(channels) if index else None
        self._known.segments.append(Segment(at, size, True, index, indexed, first, last))  # noqa: FBT003
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
            head = RECORD.unpack(_read(self._stream, segment.position, RECORD.size))
            if head != (Opcode.CHUNK, segment.size - RECORD.size):
                return False
        for at in sorted(self._metadata):
            opcode, length = RECORD.unpack(_read(self._stream, at, RECORD.size))
            if opcode != Opcode.METADATA or length > end:
                return False
            fields = Cursor(_read(self._stream, at + RECORD.size, length))
            known.metadata.append((fields.text(), fields.mapping()))
        return self._nothing_between(end)

    def _nothing_between(self, end: int) -> bool:
        """Whether no message and no chunk lies outside what the summary names."""
        at, opcode = len(MAGIC), 0
        for begin, after in [*sorted(self._named), (end, end)]:
            while at < begin:
                opcode, length = RECORD.unpack(_read(self._stream, at, RECORD.size))
                if opcode in (0, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA, Opcode.ATTACHMENT):
                    return False
                if opcode == Opcode.HEADER:
                    fields = Cursor(_read(self._stream, at + RECORD.size, min(length, end)))
                    fields.text()
                    self._known.library = fields.text()
                at += RECORD.size + length
            if at != begin:
                return False
            at = after
        return opcode == Opcode.DATA_END


def _records(section: bytes) -> Iterator[tuple[int, memoryview]]:
    view, at = memoryview(section), 0
    while at < len(section):
        opcode, length = RECORD.unpack_from(section, at)
        at += RECORD.size
        if length > len(section) - at:
            raise DamageError("a record of the summary is cut short")
        yield opcode, view[at : at + length]
        at += length
