"""The content hash: equal for two runs that exchanged the same values, whatever the host.

SHA-256 over the messages of components and links, in file order: a digest of the channel (topic,
message encoding, schema name, encoding and data, channel metadata sorted by key), log time,
publish time, sequence, payload. Parts are length-prefixed, so that no two contents give the same
bytes.

Not covered: topics that are computed from these or tell about them (/log, everything with a
schema of Foxglove or of the scene), comments of schemas, keys that begin with `host.`, metadata
records and attachments, compression, chunking, schema and channel ids, indexes, the writing
library.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from cosim.trace.file.block import HEAD as RECORD_HEAD, Block, Bytes, put_lines
from cosim.trace.file.declared import Channel
from cosim.trace.file.messages import Messages
from cosim.trace.rows.layout import HOST_PREFIX, LOG_TOPIC, SCENE_SCHEMAS

CONTENT_HASH_VERSION = 2
"""Changes when what is hashed changes: hashes of different versions cannot be compared."""
_VERSION = b"auv-cosim content %d" % CONTENT_HASH_VERSION
_NOT_COVERED = ("foxglove.", SCENE_SCHEMAS)
_HEAD = np.dtype(
    [
        ("channel", "V32"),
        ("log", "<u8"),
        ("publish", "<u8"),
        ("sequence", "<u4"),
        ("size", "<u8"),
    ]
)


class ContentDigest:
    """The content hash of messages that come in file order, as they are written or read."""

    def __init__(self) -> None:
        self._messages = hashlib.sha256(_VERSION)
        self._heads: dict[int, bytes] = {}

    def declare(self, number: int, channel: Channel) -> None:
        """Take a channel, before its first message."""
        if channel.topic != LOG_TOPIC and not channel.schema.name.startswith(_NOT_COVERED):
            self._heads[number] = digest_of_channel(channel)

    def add(self, messages: Messages) -> None:
        """Take the next messages; those of channels that are not covered do not count."""
        covered = np.isin(messages.heads["channel"], [*self._heads])
        part = messages if covered.all() else messages.part(np.flatnonzero(covered))
        self._messages.update(laid_out(part, self._heads))

    def add_block(self, block: Block) -> None:
        """Take the next messages as they are written: without taking their records apart again."""
        covered = np.zeros(int(block.channels.max(initial=0)) + 1, np.bool_)
        covered[[number for number in self._heads if number < covered.size]] = True
        sizes = np.diff(block.ends, prepend=0) + (_HEAD.itemsize - RECORD_HEAD.size)
        ends = np.cumsum(np.where(covered[block.channels], sizes, 0))
        starts = np.empty(ends.size, np.int64)
        starts[block.order] = ends - sizes
        out = np.empty(int(ends[-1]), np.uint8)
        first = 0
        for part in block.parts:
            own = slice(first, first := first + part.log_ns.size)
            if covered[part.channel]:
                name = np.void(self._heads[part.channel])
                times = part.log_ns, part.publish_ns
                lines = _lines(name, *times, part.sequence, part.lines[:, RECORD_HEAD.size :])
                put_lines(out, starts[own], lines)
        self._messages.update(out.data)

    def hexdigest(self) -> str:
        """Return the hash so far, as 64 hexadecimal digits."""
        return self._messages.hexdigest()


def laid_out(block: Messages, heads: Mapping[int, bytes]) -> memoryview:
    """Lay out channel, times, sequence, size and payload of all messages at once, in order."""
    sizes = block.sizes + _HEAD.itemsize
    ends = np.cumsum(sizes)
    out = np.empty(int(ends[-1]) if ends.size else 0, np.uint8)
    starts = ends - sizes
    for which, payloads in block.by_size():
        part = block.heads[which]
        found, own = np.unique(part["channel"], return_inverse=True)
        names = b"".join([heads[channel] for channel in found.tolist()])
        name = np.frombuffer(names, _HEAD["channel"])[own]
        lines = _lines(name, part["log"], part["publish"], part["sequence"], payloads)
        put_lines(out, starts[which], lines)
    return out.data


def _lines(name: Any, log: Any, publish: Any, sequence: Any, payloads: Bytes) -> Bytes:
    """Return what is hashed of messages of one size, uint8 (k, size)."""
    count, size = payloads.shape
    lines = np.empty((count, _HEAD.itemsize + size), np.uint8)
    head: NDArray[np.void] = np.ndarray((count,), _HEAD, lines, 0, (lines.shape[1],))
    head["channel"], head["log"], head["publish"] = name, log, publish
    head["sequence"], head["size"] = sequence, size
    lines[:, _HEAD.itemsize :] = payloads
    return lines


def digest_of_channel(channel: Channel) -> bytes:
    """Return the digest of a channel: names, schema without comments, metadata."""
    schema = channel.schema
    names = (channel.topic, channel.encoding, schema.name, schema.encoding)
    parts = [name.encode() for name in names]
    data = _without_comments(schema.data) if schema.encoding == "protobuf" else schema.data
    return hashlib.sha256(_joined([*parts, data, *_entries(channel.metadata)])).digest()


def _without_comments(descriptors: bytes) -> bytes:
    """Return a FileDescriptorSet without the comments of its source; as it is if it is none."""
    try:
        found = FileDescriptorSet.FromString(descriptors)
    except DecodeError:
        return descriptors
    if not any(file.HasField("source_code_info") for file in found.file):
        return descriptors
    for file in found.file:
        file.ClearField("source_code_info")
    return found.SerializeToString(deterministic=True)


def _entries(entries: Mapping[str, str]) -> list[bytes]:
    kept = sorted(item for item in entries.items() if not item[0].startswith(HOST_PREFIX))
    return [text.encode() for item in kept for text in item]


def _joined(parts: Iterable[bytes]) -> bytes:
    parts = list(parts)
    prefixed = [struct.pack("<Q", len(part)) + part for part in parts]
    return struct.pack("<Q", len(parts)) + b"".join(prefixed)
