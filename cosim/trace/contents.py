"""Where everything lies in an MCAP file: from its summary, or by going through it.

The summary is believed where it adds up: its checksum and its counts are right, every chunk
stands where it says, and no message lies between what it names. Else the file is gone through
from its front, chunk by chunk, as far as it can be read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode

from cosim.trace.declared import Declarations
from cosim.trace.messages import Messages, Others, find_messages
from cosim.trace.records import (
    MAGIC,
    Cursor,
    DamageError,
    check_start,
    chunk_data,
    open_trace,
    outer_records,
)

RECORD = struct.Struct("<BQ")
"""Opcode and length of a record."""
_FOOTER = struct.Struct("<QQI")
_LOOSE_BYTES = 2**22


@dataclass(slots=True)
class Stretch:
    """A chunk, or messages outside chunks that follow each other.

    Attributes
    ----------
    position, size : of its records in the file.
    chunk : whether it is a chunk.
    index_size : bytes of the message indexes behind it.
    channels : ids of its messages' channels; None if that is not known yet.
    start_ns, end_ns : least and greatest log time of its messages.
    damaged : whether it could be read in part only.
    """

    position: int
    size: int
    chunk: bool
    index_size: int = 0
    channels: frozenset[int] | None = None
    start_ns: int = 0
    end_ns: int = 2**64 - 1
    damaged: bool = False


@dataclass(slots=True)
class Contents:
    """What is in a file, and where.

    Attributes
    ----------
    library : who wrote it, as its header says.
    counts : messages by id of their channel.
    spans : least and greatest log time by id; None where only the data can tell.
    metadata : name and entries of each record, in file order.
    attachments : position and size of the record of each, by name.
    damage : where and why it could not be read on; None if it is whole.
    scanned : whether all of it was gone through, with every checksum.
    """

    library: str = ""
    declared: Declarations = field(default_factory=Declarations)
    stretches: list[Stretch] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    spans: dict[int, tuple[int, int]] | None = None
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: dict[str, tuple[int, int]] = field(default_factory=dict)
    media_types: dict[str, str] = field(default_factory=dict)
    damage: str | None = None
    scanned: bool = False


def from_summary(path: Path) -> Contents | None:
    """Contents as the summary tells them; None where it is missing or does not add up.

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
        self._named: list[tuple[int, int]] = []  # where what the summary names begins and ends
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
        told = frozenset(channels) if index else None
        self._known.stretches.append(Stretch(at, size, True, index, told, first, last))  # noqa: FBT003
        self._named.append((at, at + size + index))

    def _adds_up(self, end: int) -> bool:
        known = self._known
        found = (
            sum(known.counts.values()),
            len(known.declared.channels),
            len(known.attachments),
            len(self._metadata),
            len(known.stretches),
        )
        if found != self._numbers or not known.counts.keys() <= known.declared.channels.keys():
            return False
        known.stretches.sort(key=lambda stretch: stretch.position)
        for stretch in known.stretches:
            head = RECORD.unpack(_read(self._stream, stretch.position, RECORD.size))
            if head != (Opcode.CHUNK, stretch.size - RECORD.size):
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


def by_scan(path: Path) -> Contents:
    """Contents by going through the whole file; `damage` says how far it could be read.

    Raises
    ------
    InputError : no such file, or not an MCAP file.
    """
    return _Scan(path).contents


class _Scan:
    def __init__(self, path: Path) -> None:
        self.contents = Contents(spans={}, scanned=True)
        self._pending: tuple[int, bytes] | None = None  # a chunk whose indexes are still to come
        self._index: list[bytes] = []
        self._loose: list[bytes] = []
        self._loose_at, self._loose_end = 0, 0
        try:
            try:
                for opcode, position, content in outer_records(path):
                    self._take(opcode, position, content)
            finally:
                self._settle()
        except DamageError as error:
            self.contents.damage = str(error)

    def _take(self, opcode: int, position: int, content: bytes) -> None:
        if opcode == Opcode.MESSAGE_INDEX and self._pending is not None:
            self._index.append(content)
            return
        if opcode == Opcode.MESSAGE:
            if position != self._loose_end or self._loose_end - self._loose_at > _LOOSE_BYTES:
                self._settle()
                self._loose_at = position
            self._loose.append(RECORD.pack(opcode, len(content)) + content)
            self._loose_end = position + RECORD.size + len(content)
            return
        self._settle()
        known = self.contents
        if opcode == Opcode.CHUNK:
            self._pending = position, content
        elif opcode == Opcode.METADATA:
            fields = Cursor(content)
            known.metadata.append((fields.text(), fields.mapping()))
        elif opcode == Opcode.ATTACHMENT:
            fields = Cursor(content)
            fields.take(16)
            name = fields.text()
            known.media_types[name] = fields.text()
            fields.take(fields.number(8))
            known.attachments[name] = (position, RECORD.size + len(content))
        elif opcode == Opcode.HEADER:
            fields = Cursor(content)
            fields.text()
            known.library = fields.text()
        else:
            self._declare([(opcode, memoryview(content))])

    def _declare(self, others: Others) -> None:
        for opcode, content in others:
            if opcode == Opcode.SCHEMA:
                self.contents.declared.add_schema(content)
            elif opcode == Opcode.CHANNEL:
                self.contents.declared.add_channel(content)

    def _settle(self) -> None:
        """Take note of the messages that came together."""
        if self._pending is not None:
            (position, content), self._pending = self._pending, None
            index, self._index = self._index, []
            stretch = Stretch(position, RECORD.size + len(content), True)  # noqa: FBT003
            stretch.index_size = sum(RECORD.size + len(entry) for entry in index)
            try:
                self._note(stretch, chunk_data(content), index)
            except DamageError as error:
                raise DamageError(f"record at byte {position}: {error}") from None
        if self._loose:
            loose, self._loose = self._loose, []
            stretch = Stretch(self._loose_at, self._loose_end - self._loose_at, False)  # noqa: FBT003
            self._note(stretch, b"".join(loose), [])

    def _note(self, stretch: Stretch, data: bytes, index: list[bytes]) -> None:
        messages, others, damage = find_messages(data, index)
        try:
            self._declare(others)
        except DamageError as error:
            damage, messages = error, messages.part(np.arange(0))
        messages, stranger = declared_only(messages, self.contents.declared)
        damage = stranger or damage
        stretch.damaged = damage is not None
        heads = messages.heads
        if len(messages):
            stretch.start_ns, stretch.end_ns = int(heads["log"].min()), int(heads["log"].max())
        ids = np.unique(heads["channel"]).tolist()
        stretch.channels = frozenset(ids)
        self.contents.stretches.append(stretch)
        counts, spans = self.contents.counts, self.contents.spans or {}
        for channel in ids:
            times = heads["log"][heads["channel"] == channel]
            low, high = int(times.min()), int(times.max())
            if channel in spans:
                low, high = min(low, spans[channel][0]), max(high, spans[channel][1])
            spans[channel] = (low, high)
            counts[channel] = counts.get(channel, 0) + times.size
        self.contents.spans = spans
        if damage is not None:
            raise damage


def declared_only(
    messages: Messages, declared: Declarations
) -> tuple[Messages, DamageError | None]:
    """Messages up to the first on a channel that is not declared."""
    known = np.fromiter(declared.channels, np.uint16, len(declared.channels))
    strange = ~np.isin(messages.heads["channel"], known)
    if not strange.any():
        return messages, None
    first = int(np.argmax(strange))
    channel = int(messages.heads["channel"][first])
    error = DamageError(f"a message on channel {channel}, which is not declared")
    return messages.part(np.arange(first)), error
