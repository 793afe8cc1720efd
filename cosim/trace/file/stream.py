"""Write an MCAP file, messages one by one or in blocks of thousands.

Records are written by the classes of the mcap package. Only chunks are filled here: a block of
messages, laid out as bytes, is appended with its index as arrays. (The package's `Writer` takes
one message at a time, some 130,000 a second.)
"""

from __future__ import annotations

from collections import defaultdict
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from cosim.trace.file.block import Block
from cosim.trace.file.checksum import crc32
from cosim.trace.file.chunk import ClosedChunk, OpenChunk
from cosim.trace.file.compress import Compressor, Data
from cosim.trace.file.records import MAGIC

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

COMPRESSIONS = ("zstd", "lz4", "none")
_FOOTER_LENGTH = 8 + 8 + 4


class Sink(Protocol):
    """A file, or another receiver of bytes."""

    def write(self, data: Data, /) -> int:
        """Write all the data."""

    def flush(self) -> None:
        """Pass everything written on to the operating system."""


class McapStream:
    """A writer of one MCAP file; the caller owns the stream, and calls `start` and `finish`.

    An interruption (Ctrl-C) may come at any time: call `finish` only while `sound`.

    Parameters
    ----------
    stream : binary, seekable or not.
    chunk_bytes : size before compression at which a chunk is closed [bytes].
    compression : one of `COMPRESSIONS`.
    early : write schemas and channels before the chunks too, so that a damaged chunk loses no
        channel that later ones use.
    """

    def __init__(
        self,
        stream: Sink,
        chunk_bytes: int,
        compression: str,
        *,
        early: bool = False,
    ) -> None:
        self._stream = stream
        self.position = 0
        """End of the last whole record [bytes]."""
        self.sound = True
        """False after an interruption within an operation: a summary would be wrong."""
        self._crc = 0
        self._chunk_bytes = chunk_bytes
        self._compress = Compressor("" if compression == "none" else compression)
        self._early = early
        self._chunk = OpenChunk()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks = 0
        self._chunk_indexes = bytearray()  # as they are written: a long trace has many
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._first: int | None = None
        self._last = 0

    def start(self, library: str, profile: str = "") -> None:
        """Write magic bytes and header."""
        self._write(MAGIC)
        self._record(Header(profile=profile, library=library))

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record, before the messages of the chunk in progress."""
        with self.undivided():
            offset = self.position
            length = self._record(Metadata(name=name, metadata=dict(entries)))
            self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def attachment(
        self, name: str, media_type: str, data: bytes, *, log_ns: int = 0, create_ns: int = 0
    ) -> None:
        """Write an attachment; its times are 0 unless given."""
        with self.undivided():
            offset = self.position
            record = Attachment(
                create_time=create_ns,
                log_time=log_ns,
                name=name,
                media_type=media_type,
                data=data,
            )
            length = self._record(record)
            self._attachments.append(
                AttachmentIndex(
                    offset=offset,
                    length=length,
                    create_time=create_ns,
                    log_time=log_ns,
                    data_size=len(data),
                    name=name,
                    media_type=media_type,
                )
            )

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema and return its id."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        with self.undivided():
            self._schemas.append(schema)
            self._declare(schema)
        return schema.id

    def channel(
        self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]
    ) -> int:
        """Declare a channel and return its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        with self.undivided():
            self._channels.append(channel)
            self._declare(channel)
        return channel.id

    def add(self, block: Block) -> None:
        """Write messages in the order of the block; chunks are closed as they fill."""
        begin = 0
        with self.undivided():
            while begin < block.size:
                room = self._chunk_bytes - self._chunk.count
                # as the package does: the message that fills a chunk is its last
                end = int(np.searchsorted(block.ends, block.begin(begin) + room, side="right")) + 1
                end = min(max(end, begin + 1), block.size)
                self._chunk.add(block.part(begin, end))
                begin = end
                if self._chunk.count > self._chunk_bytes:
                    self._close_chunk()

    def message(
        self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """Write one message."""
        self._chunk.message(channel, log_ns, publish_ns, sequence, data)
        if self._chunk.count > self._chunk_bytes:
            self._close_chunk()

    @property
    def last_ns(self) -> int:
        """Greatest log time of the closed chunks [ns]; 0 before the first."""
        return self._last

    def flush(self) -> None:
        """Close the chunk in progress and hand everything to the operating system."""
        self._close_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the last chunk, the summary and the footer."""
        self._close_chunk()
        self._record(DataEnd(self._crc))
        start = self.position
        builder = RecordBuilder()
        offsets = []
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, ()),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ):
            begin = builder.count
            for record in records:
                record.write(builder)
            if opcode == Opcode.CHUNK_INDEX:
                builder.write(self._chunk_indexes)
            offsets.append(SummaryOffset(opcode, start + begin, builder.count - begin))
        offset_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = builder.end()  # type: ignore[no-untyped-call]
        head = bytes([Opcode.FOOTER]) + _FOOTER_LENGTH.to_bytes(8, "little")
        head += start.to_bytes(8, "little") + offset_start.to_bytes(8, "little")
        self._write(summary)
        self._record(
            Footer(
                summary_start=start,
                summary_offset_start=offset_start,
                summary_crc=crc32(head, crc32(summary)),
            )
        )
        self._write(MAGIC)

    @contextmanager
    def undivided(self) -> Iterator[None]:
        """Do what an interruption must not divide: within, the stream is not `sound`."""
        before, self.sound = self.sound, False
        yield
        self.sound = before

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._last,
            message_start_time=self._first or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _declare(self, record: Schema | Channel) -> None:
        data = _bytes_of(record)
        if self._early:
            self._write(data)
        self._chunk.declare(data)

    def _close_chunk(self) -> None:
        if self._chunk.messages:
            with self.undivided():
                sealed, self._chunk = self._chunk.seal(), OpenChunk()
                self._write_chunk(sealed)

    def _write_chunk(self, chunk: ClosedChunk) -> None:
        packed = self._compress(chunk.data)
        start = self.position
        name = self._compress.name
        head = _bytes_of(
            Chunk(
                compression=name,
                data=b"",
                message_start_time=chunk.first,
                message_end_time=chunk.last,
                uncompressed_crc=crc32(chunk.data),
                uncompressed_size=len(chunk.data),
            )
        )
        # the package's own, but for the data, which is large and not copied
        opcode, length, fields = head[:1], len(head) - 9 + len(packed), head[9:-8]
        sizes = length.to_bytes(8, "little"), len(packed).to_bytes(8, "little")
        self._write(opcode + sizes[0] + fields + sizes[1], packed)
        length += 9
        self._first = chunk.first if self._first is None else min(self._first, chunk.first)
        self._last = max(self._last, chunk.last)
        index_start = self.position
        builder = RecordBuilder()
        offsets = {}
        for channel, count, entries in chunk.index:
            self._counts[channel] += count
            offsets[channel] = index_start + builder.count
            builder.start_record(Opcode.MESSAGE_INDEX)
            builder.write2(channel)
            builder.write4(len(entries))
            builder.write(entries)
            builder.finish_record()  # type: ignore[no-untyped-call]
        indexes = builder.end()  # type: ignore[no-untyped-call]
        self._write(indexes)
        self._chunks += 1
        self._chunk_indexes += _bytes_of(
            ChunkIndex(
                message_start_time=chunk.first,
                message_end_time=chunk.last,
                chunk_start_offset=start,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=len(indexes),
                compression=name,
                compressed_size=len(packed),
                uncompressed_size=len(chunk.data),
            )
        )

    def _record(self, record: McapRecord) -> int:
        data = _bytes_of(record)
        self._write(data)
        return len(data)

    def _write(self, *parts: Data) -> None:
        """One record or several, whole."""
        for data in parts:
            self._stream.write(data)
            self._crc = crc32(data, self._crc)
        self.position += sum(len(data) for data in parts)


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
