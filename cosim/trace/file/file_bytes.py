"""The bytes of an MCAP file by their place; where a record can lie, and where the summary says."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, Footer, MetadataIndex

from cosim.trace.file.checksum import crc32
from cosim.trace.file.records import HEAD, MAGIC, DamageError, parsed

WINDOW = 2**20
"""Bytes that are read, and searched, at once."""

_LEAST_BYTES: dict[int, int] = {
    Opcode.HEADER: 8,
    Opcode.FOOTER: 20,
    Opcode.SCHEMA: 14,
    Opcode.CHANNEL: 16,
    Opcode.MESSAGE: 22,
    Opcode.CHUNK: 40,
    Opcode.MESSAGE_INDEX: 6,
    Opcode.CHUNK_INDEX: 60,
    Opcode.ATTACHMENT: 36,
    Opcode.ATTACHMENT_INDEX: 48,
    Opcode.STATISTICS: 46,
    Opcode.METADATA: 8,
    Opcode.METADATA_INDEX: 20,
    Opcode.SUMMARY_OFFSET: 17,
    Opcode.DATA_END: 4,
}
_EXACT_BYTES: dict[int, int] = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
_PRIVATE = 0x80
"""From here on opcodes are the applications' own."""
_MOST_BYTES = 2**30
"""No record but an attachment is longer; a claim beyond it is damage."""
NamedRecord = tuple[int, int, int | None]
"""Opcode, end and, of a chunk, packed size of the record that an index leads to."""


class FileBytes:
    """Bytes of an open MCAP file by their place; at most a window of it is in memory.

    any_opcode : whether a record may lie where the opcode is none that MCAP knows.
    """

    def __init__(self, stream: BinaryIO, *, any_opcode: bool) -> None:
        self.size = os.fstat(stream.fileno()).st_size
        self._stream, self._any_opcode = stream, any_opcode
        self._at, self._window = 0, b""

    def __call__(self, position: int, size: int) -> bytes:
        """Return `size` bytes, fewer at the end of the file; `DamageError` if reading fails."""
        begin = position - self._at
        if not 0 <= begin <= len(self._window) - size:
            try:
                self._stream.seek(position)
                self._window = self._stream.read(max(size, WINDOW))
            except OSError as error:
                raise DamageError(f"reading failed: {error.strerror}") from error
            self._at, begin = position, 0
        return self._window[begin : begin + size]

    def checksum(self, first: int, last: int, before: int = 0) -> int:
        """Return the CRC-32 of the bytes first to last - 1, continued from `before`."""
        for at in range(first, last, WINDOW):
            before = crc32(self(at, min(WINDOW, last - at)), before)
        return before

    def content(self, position: int, end: int) -> bytes:
        """Return the content of the record from `position` to `end`."""
        return self(position + HEAD.size, end - position - HEAD.size)

    def head(self, position: int) -> tuple[int, int]:
        """Return opcode and end of the record at a place."""
        opcode, length = HEAD.unpack(self(position, HEAD.size))
        return opcode, position + HEAD.size + length

    def fault(self, position: int) -> str | None:
        """Return why no record can lie at a place; None if one can."""
        left = self.size - position - HEAD.size
        if left < 0:
            return f"the file ends after {self.size} bytes, without its closing records"
        opcode, length = HEAD.unpack(self(position, HEAD.size))
        known, private = opcode in _LEAST_BYTES, opcode >= _PRIVATE
        strange = not (known or private) and not self._any_opcode
        if opcode == 0 or strange or length != _EXACT_BYTES.get(opcode, length):
            return f"no record at byte {position}"
        if length > left:
            return f"the record at byte {position} is cut short"
        if known and length < _LEAST_BYTES[opcode]:
            name = Opcode(opcode).name.lower().replace("_", " ")
            return f"record at byte {position}: the {name} is cut short"
        if not private and opcode != Opcode.ATTACHMENT and length > _MOST_BYTES:
            return f"the record at byte {position} claims {length} bytes"
        return None

    def plausible(self, position: int) -> bool:
        """Whether a record, the closing magic or the end could lie at a place."""
        left = self(position, len(MAGIC))
        return left == MAGIC[: len(left)] or self.fault(position) is None

    def named(self) -> Iterator[tuple[int, NamedRecord]]:
        """Yield the position of each record that the summary names, and what it says of it.

        Of chunks, attachments and metadata. `proves_summary` says whether it can be trusted.
        """
        start, at, _ = self._summary()
        while start < at and self.fault(start) is None:
            opcode, end = self.head(start)
            content = self.content(start, end)
            if opcode == Opcode.CHUNK_INDEX:
                chunk = parsed(ChunkIndex, content)
                place = chunk.chunk_start_offset
                yield place, (Opcode.CHUNK, place + chunk.chunk_length, chunk.compressed_size)
            elif opcode == Opcode.ATTACHMENT_INDEX:
                attachment = parsed(AttachmentIndex, content)
                place = attachment.offset
                yield place, (Opcode.ATTACHMENT, place + attachment.length, None)
            elif opcode == Opcode.METADATA_INDEX:
                metadata = parsed(MetadataIndex, content)
                yield metadata.offset, (Opcode.METADATA, metadata.offset + metadata.length, None)
            start = end

    def proves_summary(self) -> bool:
        """Whether there is a summary that matches its checksum."""
        start, at, checksum = self._summary()
        return start < at and checksum == self.checksum(start, at + 25)

    def _summary(self) -> tuple[int, int, int]:
        """Return where the summary begins and ends, and its checksum; nothing without a footer."""
        tail = HEAD.size + 20 + len(MAGIC)
        at = self.size - tail
        if at < len(MAGIC) or self.head(at) != (Opcode.FOOTER, self.size - len(MAGIC)):
            return 0, 0, 0
        footer = parsed(Footer, self(at + HEAD.size, 20))
        inside = len(MAGIC) < footer.summary_start < at
        return (footer.summary_start, at, footer.summary_crc) if inside else (0, 0, 0)
