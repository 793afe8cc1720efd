"""Read the records of an MCAP file in file order, as far as they are whole.

The official reader needs the summary, which a file cut short does not have, and trusts lengths.
This one reads from the front, checks every length and every checksum, and reports where it
stopped. Format: the MCAP specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import stat
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from cosim.core import InputError

MAGIC = b"\x89MCAP0\r\n"

MAX_CHUNK_BYTES = 2**28
"""Largest chunk that is opened; one that claims more is damaged."""

_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")
_MESSAGE_BYTES = 22
_INSIDE_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


class DamageError(Exception):
    """The file cannot be read any further; the message says where and why."""


class Cursor:
    """A reading position in one record; `DamageError` at a field beyond the record's end."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._data = memoryview(data)
        self._at = 0

    def take(self, size: int) -> memoryview:
        """Return the next `size` bytes."""
        if size > len(self._data) - self._at:
            raise DamageError("a field is longer than its record")
        self._at += size
        return self._data[self._at - size : self._at]

    def number(self, size: int) -> int:
        """Return the next unsigned integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """Return the next string (length in four bytes, UTF-8)."""
        try:
            return bytes(self.take(self.number(4))).decode()
        except UnicodeDecodeError:
            raise DamageError("a text is not UTF-8") from None

    def mapping(self) -> dict[str, str]:
        """Return the next string-to-string map."""
        inner = Cursor(self.take(self.number(4)))
        entries = {}
        while inner.left:
            key = inner.text()
            entries[key] = inner.text()
        return entries

    @property
    def left(self) -> int:
        """Bytes not yet read."""
        return len(self._data) - self._at


def outer_records(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Yield opcode, position in the file and content of each record, with chunks unopened.

    Raises
    ------
    InputError : no such file, a directory, an empty file, not an MCAP file.
    DamageError : the file is cut short or damaged; records yielded before are whole.
    """
    with open_trace(path) as stream:
        try:
            yield from _walk(stream, path)
        except OSError as error:
            raise DamageError(f"reading failed: {error.strerror}") from error


def open_trace(path: Path) -> BinaryIO:
    """Open a file for reading; `InputError` if that fails, or if it is no regular file."""
    try:
        # a pipe would block for ever
        regular = stat.S_ISREG(path.stat().st_mode)
        stream = path.open("rb") if regular else None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise InputError(
            "the trace cannot be opened",
            where=str(path),
            expected="a readable .mcap file",
            got=getattr(error, "strerror", None) or str(error),
        ) from error
    if stream is None:
        raise InputError(
            "not a trace",
            where=str(path),
            expected="the path of an .mcap file",
            got="a directory" if path.is_dir() else "no regular file",
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
        )


def _walk(stream: BinaryIO, path: Path) -> Iterator[tuple[int, int, bytes]]:
    size = stream.seek(0, 2)
    stream.seek(0)
    start = stream.read(len(MAGIC))
    check_start(start, size, path)
    checksum = zlib.crc32(start)
    position = len(MAGIC)
    while True:
        if size - position < _HEAD.size:
            raise DamageError(f"the file ends after {size} bytes, without its closing records")
        head = stream.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head)
        if opcode == 0:
            raise DamageError(f"no record at byte {position}")
        if length > size - position - _HEAD.size:
            raise DamageError(f"the record at byte {position} is cut short")
        content = stream.read(length)
        if len(content) < length:
            raise DamageError(f"the record at byte {position} is cut short")
        try:
            _check(opcode, content, checksum)
        except DamageError as error:
            raise DamageError(f"record at byte {position}: {error}") from None
        yield opcode, position, content
        checksum = zlib.crc32(content, zlib.crc32(head, checksum))
        position += _HEAD.size + length
        if opcode == Opcode.FOOTER:
            break
    end = stream.read()
    if end != MAGIC:
        raise DamageError(f"the closing magic is not where it should be, at byte {position}")


def _check(opcode: int, content: bytes, checksum: int) -> None:
    if opcode == Opcode.DATA_END:
        given = Cursor(content).number(4)
        if given not in (0, checksum):
            raise DamageError("the checksum of the data section does not match")
    if opcode == Opcode.ATTACHMENT:
        given = int.from_bytes(content[-4:], "little")
        if given not in (0, zlib.crc32(content[:-4])):
            raise DamageError("the checksum of an attachment does not match")
    if opcode == Opcode.MESSAGE and len(content) < _MESSAGE_BYTES:
        raise DamageError("a message is cut short")


def inner_records(data: bytes | memoryview) -> Iterator[tuple[int, int, memoryview]]:
    """Yield opcode, place and content of each record of an opened chunk; `DamageError` if cut."""
    view = memoryview(data)
    at, size = 0, len(data)
    while at < size:
        if size - at < _HEAD.size:
            raise DamageError("a record inside the chunk is cut short")
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if length > size - at or (opcode == Opcode.MESSAGE and length < _MESSAGE_BYTES):
            raise DamageError("a record inside the chunk is cut short")
        if opcode in _INSIDE_CHUNKS:
            yield opcode, at - _HEAD.size, view[at : at + length]
        elif opcode < 0x80:  # beyond, the specification leaves opcodes to applications
            raise DamageError(f"a record of type {opcode} inside a chunk")
        at += length


def chunk_data(content: bytes | memoryview) -> bytes:
    """Decompress a chunk record; `DamageError` if size or checksum are not as it claims."""
    fields = Cursor(content)
    _, _, size, checksum = _CHUNK.unpack(fields.take(_CHUNK.size))
    compression = fields.text()
    packed = fields.take(fields.number(8))
    if size > MAX_CHUNK_BYTES:
        raise DamageError(f"a chunk claims {size} bytes, more than {MAX_CHUNK_BYTES}")
    try:
        data = _decompress(compression, packed, size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise DamageError(f"a chunk does not decompress ({error})") from None
    if len(data) != size:
        raise DamageError(f"a chunk has {len(data)} bytes where it claims {size}")
    if checksum not in (0, zlib.crc32(data)):
        raise DamageError("the checksum of a chunk does not match")
    return data


def _decompress(compression: str, packed: memoryview, size: int) -> bytes:
    if compression == "":
        return bytes(packed)
    if size == 0:
        return b""
    if compression == "zstd":
        if zstandard.frame_content_size(packed) not in (-1, size):
            raise DamageError("a chunk's compressed frame is not of the size it claims")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        return unpacked
    raise DamageError(f"unknown compression {compression!r}")
