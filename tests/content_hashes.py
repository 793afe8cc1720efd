"""Content hashes as they are defined, by the mcap package and protobuf alone.

Version 3 is that of row format 2, version 2 that of row format 1 and of files of other tools.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from google.protobuf.descriptor_pb2 import FieldDescriptorProto as F, FileDescriptorSet
from mcap import records
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_files import message_type

EARLIER = {F.TYPE_SFIXED64: F.TYPE_INT64, F.TYPE_FIXED64: F.TYPE_UINT64}
"""What row format 1 declares where row format 2 declares a fixed width."""


def uncommented(schema: Any) -> bytes:
    """Data of a schema, without comments if it is protobuf's."""
    if schema is None or schema.encoding != "protobuf":
        return schema.data if schema else b""
    files = FileDescriptorSet.FromString(schema.data)
    for file in files.file:
        file.ClearField("source_code_info")
    return files.SerializeToString(deterministic=True)


def covered(path: Path) -> Iterator[tuple[bytes, records.Message]]:
    """The messages that count, each with the digest of its channel, by the official reader."""

    def prefixed(parts: list[bytes]) -> bytes:
        head = struct.pack("<Q", len(parts))
        return head + b"".join(struct.pack("<Q", len(part)) + part for part in parts)

    def entries(found: dict[str, str]) -> list[bytes]:
        kept = sorted((k, v) for k, v in found.items() if not k.startswith("host."))
        return [text.encode() for item in kept for text in item]

    with path.open("rb") as stream:
        schemas: dict[int, Any] = {}
        channels: dict[int, Any] = {}
        for record in StreamReader(stream).records:
            if isinstance(record, records.Schema):
                schemas[record.id] = record
            elif isinstance(record, records.Channel):
                channels[record.id] = record
            elif isinstance(record, records.Message):
                channel = channels[record.channel_id]
                schema = schemas.get(channel.schema_id)
                computed = schema and schema.name.startswith(("foxglove.", "cosim.scene.link."))
                if channel.topic == "/log" or computed:
                    continue
                names = [channel.topic, channel.message_encoding]
                names += [schema.name, schema.encoding] if schema else ["", ""]
                parts = [n.encode() for n in names] + [uncommented(schema)]
                yield hashlib.sha256(prefixed(parts + entries(channel.metadata))).digest(), record


def plain_hash(path: Path) -> str:
    """The content hash as its definition reads, a message at a time."""
    found: dict[bytes, list[bytes]] = {}
    for channel, one in covered(path):
        head = 5, 22 + len(one.data), 0, one.sequence, one.log_time, one.publish_time
        found.setdefault(channel, []).append(struct.pack("<BQHIQQ", *head) + one.data)
    topics = [
        channel + struct.pack("<Q", len(of)) + hashlib.sha256(b"".join(of)).digest()
        for channel, of in found.items()
    ]
    return hashlib.sha256(b"auv-cosim content 3" + b"".join(sorted(topics))).hexdigest()


def former_hash(path: Path) -> str:
    """That of files of other tools, and of those that have row format 1."""
    messages = hashlib.sha256(b"auv-cosim content 2")
    for channel, one in covered(path):
        times = one.log_time, one.publish_time, one.sequence, len(one.data)
        messages.update(channel + struct.pack("<QQIQ", *times) + one.data)
    return messages.hexdigest()


def in_format_1(path: Path, target: Path) -> Path:
    """The same trace as an earlier version wrote it: by the package's writer and protobuf."""
    with path.open("rb") as source, target.open("wb") as stream:
        reader, writer = make_reader(source), Writer(stream)
        writer.start("", "auv-cosim")
        for one in reader.iter_metadata():
            of = {k: v for k, v in one.metadata.items() if k != "row_format"}
            writer.add_metadata(one.name, of)
        channels: dict[int, int] = {}
        types: dict[int, tuple[Any, Any]] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            own = schema.name.startswith("cosim.")
            if channel.id not in channels:
                data = _earlier(schema.data) if own else schema.data
                number = writer.register_schema(schema.name, schema.encoding, data)
                of = dict(channel.metadata)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, of
                )
                if own:
                    types[channel.id] = tuple(
                        message_type(d, schema.name) for d in (schema.data, data)
                    )
            payload = _again(message.data, *types[channel.id]) if own else message.data
            times = message.log_time, payload, message.publish_time, message.sequence
            writer.add_message(channels[channel.id], *times)
        writer.finish()
    return target


def _earlier(descriptors: bytes) -> bytes:
    """The descriptors of a row, its integers as wide as they need."""
    files = FileDescriptorSet.FromString(descriptors)
    for field in files.file[0].message_type[0].field:
        field.type = EARLIER.get(field.type, field.type)
    return files.SerializeToString(deterministic=True)


def _again(payload: bytes, now: Any, then: Any) -> bytes:
    """A row of one type as a row of another that has the same fields."""
    fields = {field.name: value for field, value in now.FromString(payload).ListFields()}
    written: bytes = then(**fields).SerializeToString(deterministic=True)
    return written
