"""MCAP files and their messages, taken apart by the mcap package and protobuf alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader
from mcap.records import Schema
from mcap.writer import Writer

MAGIC = b"\x89MCAP0\r\n"
HEAD_BYTES = 9
"""Opcode and length of a record."""


class Record(NamedTuple):
    """A record outside chunks: its first byte, the one behind it, and what it holds."""

    opcode: int
    position: int
    end: int
    content: bytes


def records_of(path: Path) -> Iterator[Record]:
    """The records of a whole file from front to end, chunks unopened."""
    data, at = path.read_bytes(), len(MAGIC)
    while at < len(data) - len(MAGIC):
        begin = at + HEAD_BYTES
        end = begin + int.from_bytes(data[at + 1 : begin], "little")
        yield Record(data[at], at, end, data[begin:end])
        at = end


def message_type(descriptors: bytes, name: str) -> Any:
    """The class of a protobuf message, from a `FileDescriptorSet` as a schema has it."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(descriptors).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(name))


def schemas_of(path: Path) -> dict[str, Schema]:
    """The schemas of a file, by topic."""
    with path.open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    return {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}


def type_of(path: Path, topic: str) -> Any:
    """The class of the messages of a topic, from the schema that the file has."""
    schema = schemas_of(path)[topic]
    return message_type(schema.data, schema.name)


def payloads_of(path: Path, topic: str) -> list[bytes]:
    """The messages of a topic as they are in the file, in its order."""
    with path.open("rb") as stream:
        messages = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [bytes(m.data) for _, channel, m in messages if channel.topic == topic]


def write_protobuf(
    path: Path, topic: str, descriptors: bytes, name: str, payloads: Iterable[bytes]
) -> Path:
    """A file of another tool: these messages on one topic, at 0 ns, 1 ns, ..."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "another tool")
        schema = writer.register_schema(name, "protobuf", descriptors)
        channel = writer.register_channel(topic, "protobuf", schema)
        for k, payload in enumerate(payloads):
            writer.add_message(channel, k, payload, k)
        writer.finish()
    return path
