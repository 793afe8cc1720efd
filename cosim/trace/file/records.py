"""Take single records of an MCAP file apart, and chunks; every claim of a length is checked.

The classes of the mcap package name the fields of a record; its readers trust lengths. Format: the
MCAP specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import stat
import struct
import threading
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, McapRecord, Metadata

from cosim.core import InputError, unreadable
from cosim.trace.file.checksum import crc32

Parsed = TypeVar("Parsed", bound=McapRecord)

MAGIC = b"\x89MCAP0\r\n"

MAX_CHUNK_BYTES = 2**28
"""Largest chunk that is opened; one that claims more is damaged."""

HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""

LATEST_NS = 2**64 - 1
"""The latest log time that a message can have [ns]."""

LATEST_SIGNED_NS = 2**63 - 1
"""The latest time of what this project writes, and of its tables, which are of int64 [ns]."""

_CHUNK = struct.Struct("<QQQII")
_MESSAGE_BYTES = 22
_INSIDE_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


class DamageError(Exception):
    """The file cannot be read any further; the message says where and why."""


class Fields(ReadDataStream):
    """The fields of one record, for the classes of the mcap package.

    `DamageError` at a field beyond the record's end.
    """

    def __init__(self, content: bytes | memoryview) -> None:
        super().__init__(BytesIO(content))
        self._size = len(content)

    def read(self, length: int) -> bytes:
        """Return the next `length` bytes."""
        if length > self.left:
            raise DamageError("a field is longer than its record")
        return super().read(length)

    @property
    def left(self) -> int:
        """Bytes not yet read."""
        return self._size - self.count


def parsed(kind: type[Parsed], content: bytes | memoryview) -> Parsed:
    """Read the content of a record as a class of the mcap package.

    Behind its fields a record may have those of a later format, which are passed over.

    Raises
    ------
    DamageError : a field is longer than the record, a text is not UTF-8, the checksum of an
        attachment does not match, or what follows is no later format.
    """
    return _parsed(kind, content)[0]


def bytes_left(kind: type[McapRecord], content: bytes | memoryview) -> int:
    """Return how many bytes a record has behind its fields; `DamageError` as `parsed`."""
    return _parsed(kind, content)[1]


def _parsed(kind: type[Parsed], content: bytes | memoryview) -> tuple[Parsed, int]:
    fields = Fields(content)
    try:
        found: Parsed = kind.read(fields)  # type: ignore[attr-defined]
    except UnicodeDecodeError:
        raise DamageError("a text is not UTF-8") from None
    end = fields.count
    if kind is Attachment and not _checksum_holds(content, end):
        raise DamageError("the checksum of an attachment does not match")
    if kind is Metadata and (_entries_follow(fields) or not may_follow(content[end:])):
        raise DamageError("a metadata record is longer than what is in it")
    return found, len(content) - end


def may_follow(more: bytes | memoryview) -> bool:
    """Whether bytes behind a record's fields may be of a later format: they begin no record.

    A false length takes in the records that follow.
    """
    if len(more) < HEAD.size:
        return True
    opcode, length = HEAD.unpack_from(more)
    return not (0 < opcode <= max(Opcode) and length < 2**32)


def _checksum_holds(content: bytes | memoryview, end: int) -> bool:
    """Whether the checksum of an attachment, whose fields end there, matches; 0 stands for none."""
    given = int.from_bytes(content[end - 4 : end], "little")
    if given == 0:  # where something follows, a wrong length may have led to this place
        return end == len(content)
    return given == crc32(memoryview(content)[: end - 4]) and may_follow(content[end:])


def _entries_follow(fields: Fields) -> bool:
    """Whether what is left reads as metadata: then the length before them is wrong."""
    if not fields.left:
        return False
    try:
        while fields.left:
            fields.read_prefixed_string()
            fields.read_prefixed_string()
    except (DamageError, UnicodeDecodeError):
        return False
    return True


def open_trace(path: Path) -> BinaryIO:
    """Open a file for reading; `InputError` if that fails, or if it is no regular file."""
    try:
        # a pipe would block for ever
        regular = stat.S_ISREG(path.stat().st_mode)
        stream = path.open("rb") if regular else None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise unreadable(
            path, error, what="the trace cannot be opened", expected="a readable .mcap file"
        ) from error
    if stream is None:
        raise InputError(
            "not a trace",
            where=str(path),
            expected="the path of an .mcap file",
            got="a directory" if path.is_dir() else "no regular file",
            hint="name the .mcap file in it" if path.is_dir() else "the path of a file",
        )
    return stream


def check_start(start: bytes, size: int, path: Path) -> None:
    """Raise an `InputError` unless the first bytes of a file of `size` bytes are MCAP's."""
    if start != MAGIC:
        cut = bool(start) and MAGIC.startswith(start)
        raise InputError(
            "the file is empty" if not start else "not an MCAP file",
            where=str(path),
            expected="a file that begins with the MCAP magic bytes",
            got=f"{size} bytes" if cut or not start else f"begins with {start!r}",
            hint="a trace that cosim run wrote: traces/NAME.mcap",
        )


def inner_records(data: bytes | memoryview) -> Iterator[tuple[int, int, memoryview]]:
    """Yield opcode, place and content of each record of an opened chunk; `DamageError` if cut."""
    view = memoryview(data)
    at, size = 0, len(data)
    while at < size:
        if size - at < HEAD.size:
            raise DamageError("a record inside the chunk is cut short")
        opcode, length = HEAD.unpack_from(data, at)
        at += HEAD.size
        if length > size - at or (opcode == Opcode.MESSAGE and length < _MESSAGE_BYTES):
            raise DamageError("a record inside the chunk is cut short")
        if opcode in _INSIDE_CHUNKS:
            yield opcode, at - HEAD.size, view[at : at + length]
        elif opcode < 0x80:  # beyond, the specification leaves opcodes to applications
            raise DamageError(f"a record of type {opcode} inside a chunk")
        at += length


class ChunkHead(NamedTuple):
    """The fields of a chunk record before its data; `at` and `packed`: place and size of these."""

    first: int
    last: int
    size: int
    checksum: int
    compression: str
    at: int
    packed: int


def chunk_head(content: bytes | memoryview) -> ChunkHead:
    """Read the fields of a chunk; `DamageError` if they or the data exceed the record."""
    if len(content) < _CHUNK.size:
        raise DamageError("a field is longer than its record")
    first, last, size, checksum, length = _CHUNK.unpack_from(content)
    at = _CHUNK.size + length + 8
    if at > len(content):
        raise DamageError("a field is longer than its record")
    try:
        compression = bytes(content[_CHUNK.size : at - 8]).decode()
    except UnicodeDecodeError:
        raise DamageError("a text is not UTF-8") from None
    packed = int.from_bytes(content[at - 8 : at], "little")
    if packed > len(content) - at:
        raise DamageError("a field is longer than its record")
    return ChunkHead(first, last, size, checksum, compression, at, packed)


def is_chunk(content: bytes | memoryview) -> bool:
    """Whether bytes begin as a chunk, whatever is behind: with the name of a compression."""
    if len(content) < _CHUNK.size:
        return False
    length = _CHUNK.unpack_from(content)[4]
    return length <= 4 and bytes(content[_CHUNK.size :][:length]) in (b"", b"lz4", b"zstd")


def chunk_data(content: bytes | memoryview) -> bytes:
    """Decompress a chunk record; `DamageError` if size or checksum are not as it claims."""
    head = chunk_head(content)
    packed = memoryview(content)[head.at : head.at + head.packed]
    if head.size > MAX_CHUNK_BYTES:
        raise DamageError(f"a chunk claims {head.size} bytes, more than {MAX_CHUNK_BYTES}")
    try:
        data = _decompress(head.compression, packed, head.size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise DamageError(f"a chunk does not decompress ({error})") from None
    if len(data) != head.size:
        raise DamageError(f"a chunk has {len(data)} bytes where it claims {head.size}")
    if head.checksum not in (0, crc32(data)):
        raise DamageError("the checksum of a chunk does not match")
    return data


def salvaged(content: bytes | memoryview, packed: int | None) -> bytes:
    """Decompress what can be of a damaged chunk record, whatever it claims.

    packed : size of its data as its index has it, which then end the record; None if unknown.
    """
    at = len(content) - packed if packed is not None else _CHUNK.size + 8
    if packed is None and len(content) >= _CHUNK.size:
        at += int.from_bytes(content[_CHUNK.size - 4 : _CHUNK.size], "little")
    data = memoryview(content)[max(at, 0) :]
    # by the first bytes of a frame: the name of the compression may be what is damaged
    start = bytes(data[:4])
    if start == _LZ4 or bytes(content[_CHUNK.size :][:3]) == b"lz4":
        return _as_far_as(lz4.frame.LZ4FrameDecompressor(), data)
    if start == _ZSTD or bytes(content[_CHUNK.size :][:4]) == b"zstd":
        return _as_far_as(zstandard.ZstdDecompressor().decompressobj(), data)
    return bytes(data)


_ZSTD, _LZ4 = b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"


def _as_far_as(decompressor: Any, packed: memoryview) -> bytes:
    """Return what a frame gives before its damage."""
    found, size = [], 0
    for at in range(0, len(packed), 256):
        try:
            found.append(decompressor.decompress(bytes(packed[at : at + 256])))
        except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError):
            break
        size += len(found[-1])
        if size > MAX_CHUNK_BYTES:
            break
    return b"".join(found)


class _Own(threading.local):
    """What each thread has for itself; zstd's are not thread-safe, and cost some to make."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_own = _Own()


def _decompress(compression: str, packed: memoryview, size: int) -> bytes:
    if compression == "":
        return bytes(packed)
    if size == 0:
        return b""
    if compression == "zstd":
        if zstandard.frame_content_size(packed) not in (-1, size):
            raise DamageError("a chunk's compressed frame is not of the size it claims")
        return _own.decompressor.decompress(packed, max_output_size=size)
    if compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        return unpacked
    raise DamageError(f"unknown compression {compression!r}")
