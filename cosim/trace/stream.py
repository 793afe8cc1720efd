"""An MCAP stream that takes messages one by one or in blocks of thousands.

Records are written through the mcap package's own classes; what is ours is the way into a
chunk: a block of messages, already laid out as bytes, is appended as it is, its index as
arrays. (The package's `Writer` takes one message at a time, some 130,000 a second.)
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from typing import IO, TYPE_CHECKING, Any

import lz4.frame
import numpy as np
import zstandard
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
from mcap.writer import MCAP0_MAGIC

from cosim.trace.block import Block

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

COMPRESSIONS = ("zstd", "lz4", "none")
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_FOOTER_LENGTH = 8 + 8 + 4


class McapStream:
    """Writes one MCAP file; the caller owns the stream and calls `start` first, `finish` last.

    Parameters
    ----------
    stream : binary, seekable or not.
    chunk_bytes : size before compression at which a chunk is closed.
    compression : one of `COMPRESSIONS`.
    """

    def __init__(self, stream: IO[bytes], chunk_bytes: int, compression: str) -> None:
        self._stream = stream
        self._position = 0
        self._crc = 0
        self._chunk_bytes = chunk_bytes
        self._compression = "" if compression == "none" else compression
        self._chunk = _Chunk()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._first: int | None = None
        self._last = 0

    def start(self, library: str) -> None:
        """Magic bytes and header."""
        self._write(MCAP0_MAGIC)
        self._record(Header(profile="", library=library))

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """A metadata record; what is in the chunk in progress stays behind it."""
        offset = self._position
        length = self._record(Metadata(name=name, metadata=dict(entries)))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def attachment(self, name: str, media_type: str, data: bytes) -> None:
        """An attachment without times."""
        offset = self._position
        record = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        length = self._record(record)
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=0,
                log_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; returns its id."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk.declare(schema)
        return schema.id

    def channel(
        self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]
    ) -> int:
        """Declare a channel; returns its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._channels.append(channel)
        self._chunk.declare(channel)
        return channel.id

    def add(self, block: Block) -> None:
        """Messages in the order of the block; chunks are closed as they fill."""
        begin = 0
        while begin < block.size:
            room = self._chunk_bytes - self._chunk.count
            # as the package does: the message that fills a chunk is its last
            end = int(np.searchsorted(block.ends, block.begin(begin) + room, side="right")) + 1
            end = min(max(end, begin + 1), block.size)
            part = block.part(begin, end)
            self._chunk.add(part)
            for channel, count in zip(*np.unique(part.channels, return_counts=True), strict=True):
                self._counts[int(channel)] += int(count)
            begin = end
            if self._chunk.count > self._chunk_bytes:
                self._close_chunk()

    def message(
        self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """One message."""
        self._chunk.message(channel, log_ns, publish_ns, sequence, data)
        self._counts[channel] += 1
        if self._chunk.count > self._chunk_bytes:
            self._close_chunk()

    def flush(self) -> None:
        """Close the chunk in progress and hand everything to the operating system."""
        self._close_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """The last chunk, the summary, the footer."""
        self._close_chunk()
        self._record(DataEnd(self._crc))
        start = self._position
        builder = RecordBuilder()
        offsets = []
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ):
            begin = builder.count
            for record in records:
                record.write(builder)
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
                summary_crc=zlib.crc32(head, zlib.crc32(summary)),
            )
        )
        self._write(MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=self._last,
            message_start_time=self._first or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _close_chunk(self) -> None:
        chunk = self._chunk
        if chunk.messages == 0:
            return
        data = chunk.data()
        compressed = _COMPRESS[self._compression](data)
        record = Chunk(
            compression=self._compression,
            data=compressed,
            message_start_time=chunk.first,
            message_end_time=chunk.last,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        self._first = chunk.first if self._first is None else min(self._first, chunk.first)
        self._last = max(self._last, chunk.last)
        start = self._position
        length = self._record(record)
        index_start = self._position
        builder = RecordBuilder()
        offsets = {}
        for channel, entries in chunk.index():
            offsets[channel] = index_start + builder.count
            builder.start_record(Opcode.MESSAGE_INDEX)
            builder.write2(channel)
            builder.write4(len(entries))
            builder.write(entries)
            builder.finish_record()  # type: ignore[no-untyped-call]
        indexes = builder.end()  # type: ignore[no-untyped-call]
        self._write(indexes)
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.first,
                message_end_time=chunk.last,
                chunk_start_offset=start,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=len(indexes),
                compression=self._compression,
                compressed_size=len(compressed),
                uncompressed_size=len(data),
            )
        )
        self._chunk = _Chunk()

    def _record(self, record: McapRecord) -> int:
        builder = RecordBuilder()
        record.write(builder)
        data = builder.end()  # type: ignore[no-untyped-call]
        self._write(data)
        return len(data)

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._position += len(data)
        self._crc = zlib.crc32(data, self._crc)


class _Chunk:
    """The chunk in progress."""

    def __init__(self) -> None:
        self.count = 0
        self.messages = 0
        self.first, self.last = 0, 0
        self._parts: list[Any] = []
        self._index: list[tuple[Any, Any, Any]] = []
        self._single: list[tuple[int, int, int]] = []

    def declare(self, record: McapRecord) -> None:
        builder = RecordBuilder()
        record.write(builder)
        self._append(builder.end())  # type: ignore[no-untyped-call]

    def message(
        self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        self._span(log_ns, log_ns)
        self._single.append((channel, log_ns, self.count))
        self.messages += 1
        length = MESSAGE_HEAD.size - 9 + len(data)
        self._append(
            MESSAGE_HEAD.pack(Opcode.MESSAGE, length, channel, sequence, log_ns, publish_ns) + data
        )

    def add(self, block: Block) -> None:
        self._span(int(block.log_ns.min()), int(block.log_ns.max()))
        self._gather()
        starts = self.count + np.append(0, block.ends[:-1])
        self._index.append((block.channels, block.log_ns, starts))
        self.messages += block.size
        self._append(block.data)

    def data(self) -> bytes:
        return b"".join(self._parts)

    def index(self) -> list[tuple[int, bytes]]:
        """Per channel, in order of first use: (log time, offset) of its messages."""
        self._gather()
        channels, times, starts = (
            np.concatenate(parts) for parts in zip(*self._index, strict=True)
        )
        found, first = np.unique(channels, return_index=True)
        pairs = np.column_stack([times, starts]).astype("<u8")
        return [
            (int(channel), pairs[channels == channel].tobytes())
            for channel in found[np.argsort(first)]
        ]

    def _span(self, low: int, high: int) -> None:
        self.first = low if self.messages == 0 else min(self.first, low)
        self.last = max(self.last, high)

    def _gather(self) -> None:
        """Single messages into the index, in their place between the blocks."""
        if self._single:
            columns = np.array(self._single, np.int64).T
            self._index.append((columns[0], columns[1], columns[2]))
            self._single = []

    def _append(self, data: Any) -> None:
        self._parts.append(data)
        self.count += len(data)


_COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "zstd": lambda data: zstandard.ZstdCompressor().compress(data),
    "lz4": lz4.frame.compress,
}
