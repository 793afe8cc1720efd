"""The records of an MCAP file by their places, and their fields.

Lengths are checked against the file, and every checksum is checked.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

from mcap.opcode import Opcode

from cosim.trace.records import (
    MAGIC,
    Cursor,
    DamageError,
    check_start,
    chunk_data,
    inner_records,
    open_trace,
)

HEAD_BYTES = 9
PRIVATE = 0x80
"""From here on opcodes are the applications' own."""

_LEAST_BYTES: dict[int, int] = {
    Opcode.HEADER: 8,
    Opcode.FOOTER: 20,
    Opcode.SCHEMA: 14,
    Opcode.CHANNEL: 16,
    Opcode.MESSAGE: 22,
    Opcode.CHUNK: 40,
    Opcode.MESSAGE_INDEX: 6,
    Opcode.CHUNK_INDEX: 60,
    Opcode.ATTACHMENT: 40,
    Opcode.ATTACHMENT_INDEX: 48,
    Opcode.STATISTICS: 46,
    Opcode.METADATA: 8,
    Opcode.METADATA_INDEX: 20,
    Opcode.SUMMARY_OFFSET: 17,
    Opcode.DATA_END: 4,
}
_MESSAGE = struct.Struct("<HIQQ")
_MOST_BYTES = 2**30
"""No record but an attachment is longer; a claim beyond it is damage."""


@dataclass(frozen=True)
class Piece:
    """A record at `position`, its content of `length` bytes behind its head."""

    opcode: int
    position: int
    length: int

    @property
    def end(self) -> int:
        """Where the next record begins."""
        return self.position + HEAD_BYTES + self.length


@dataclass(frozen=True)
class Schema:
    """Fields of a schema record."""

    number: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """Fields of a channel record."""

    number: int
    schema: int
    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class AttachmentRecord:
    """Fields of an attachment record."""

    log_ns: int
    create_ns: int
    name: str
    media_type: str
    data: bytes


class Message(NamedTuple):
    """Fields of a message record."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


class McapFile:
    """A file mapped into memory; use as a context manager.

    Raises
    ------
    InputError : it cannot be opened, is empty or no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        with open_trace(path) as stream:
            self.size = stream.seek(0, 2)
            if self.size == 0:
                check_start(b"", 0, path)
            self.data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self.size = len(self.data)
        start = self.data[: len(MAGIC)]
        first = self.at(len(MAGIC))
        if start != MAGIC and (first is None or first.opcode != Opcode.HEADER):
            self.data.close()
            check_start(start, self.size, path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.data.close()

    def at(self, position: int) -> Piece | None:
        """Return the record at a place if its head is plausible, else None."""
        if not len(MAGIC) <= position <= self.size - HEAD_BYTES:
            return None
        opcode = self.data[position]
        length = int.from_bytes(self.data[position + 1 : position + HEAD_BYTES], "little")
        most = self.size - position - HEAD_BYTES
        if opcode < PRIVATE and opcode != Opcode.ATTACHMENT:
            most = min(most, _MOST_BYTES)
        least = 0 if opcode >= PRIVATE else _LEAST_BYTES.get(opcode, _MOST_BYTES)
        if not least <= length <= most:
            return None
        return Piece(opcode, position, length)

    def content(self, piece: Piece) -> bytes:
        """Return the content of a record."""
        return self.data[piece.position + HEAD_BYTES : piece.end]

    def checksum(self, first: int, last: int) -> int:
        """Return the CRC-32 of the bytes first to last - 1."""
        with memoryview(self.data) as whole, whole[first:last] as part:
            return zlib.crc32(part)


def schema_of(content: bytes | memoryview) -> Schema:
    """Read a schema record; `DamageError` if it is none."""
    fields = Cursor(content)
    number, name, encoding = fields.number(2), fields.text(), fields.text()
    return Schema(number, name, encoding, bytes(fields.take(fields.number(4))))


def channel_of(content: bytes | memoryview) -> Channel:
    """Read a channel record; `DamageError` if it is none."""
    fields = Cursor(content)
    number, schema = fields.number(2), fields.number(2)
    topic, encoding = fields.text(), fields.text()
    return Channel(number, schema, topic, encoding, tuple(fields.mapping().items()))


def message_of(content: bytes | memoryview) -> Message:
    """Read a message record of at least 22 bytes."""
    channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(content)
    return Message(channel, sequence, log_ns, publish_ns, bytes(content[_MESSAGE.size :]))


def metadata_of(content: bytes | memoryview) -> tuple[str, dict[str, str]]:
    """Read name and entries of a metadata record; `DamageError` if it is none."""
    fields = Cursor(content)
    name, entries = fields.text(), fields.mapping()
    if fields.left:
        raise DamageError("a metadata record is longer than what is in it")
    return name, entries


def attachment_of(content: bytes | memoryview) -> AttachmentRecord:
    """Read an attachment record; `DamageError` if it is none, or its checksum is wrong."""
    given = int.from_bytes(content[-4:], "little")
    if given not in (0, zlib.crc32(memoryview(content)[:-4])):
        raise DamageError("the checksum of an attachment does not match")
    fields = Cursor(content)
    log_ns, create_ns = fields.number(8), fields.number(8)
    name, media_type = fields.text(), fields.text()
    return AttachmentRecord(
        log_ns, create_ns, name, media_type, bytes(fields.take(fields.number(8)))
    )


def declarations(file: McapFile, piece: Piece) -> list[Schema | Channel]:
    """Check a record, its content and its checksums, and return the schemas and channels in it.

    Raises
    ------
    DamageError : the record is damaged.
    """
    content = file.content(piece)
    found: list[Schema | Channel] = []
    if piece.opcode == Opcode.SCHEMA:
        found.append(schema_of(content))
    elif piece.opcode == Opcode.CHANNEL:
        found.append(channel_of(content))
    elif piece.opcode == Opcode.CHUNK:
        for opcode, _, inside in inner_records(chunk_data(content)):
            if opcode == Opcode.SCHEMA:
                found.append(schema_of(inside))
            elif opcode == Opcode.CHANNEL:
                found.append(channel_of(inside))
    elif piece.opcode == Opcode.METADATA:
        metadata_of(content)
    elif piece.opcode == Opcode.ATTACHMENT:
        attachment_of(content)
    return found
