"""The content hash: equal for two runs that exchanged the same values, whatever the host.

SHA-256 over the topics of components and links, in no order: of each a digest of its channel
(topic, message encoding, schema name, encoding and data, channel metadata sorted by key), the
number of its messages, and SHA-256 of these in file order. A message is hashed as the record that
it is in a file, channel number 0: so it need not be laid out for it.

Not covered: topics that are computed from these or tell about them (/log, everything with a
schema of Foxglove or of the scene), how messages of different topics follow each other, comments
of schemas, keys that begin with `host.`, metadata records and attachments, compression, chunking,
schema and channel ids, indexes, the writing library.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError

from cosim.trace.file.block import LENGTH_BEFORE, Bytes, Integers, Records, lines_in_order
from cosim.trace.file.declared import Channel
from cosim.trace.file.messages import Messages
from cosim.trace.rows.layout import HOST_PREFIX, LOG_TOPIC, SCENE_SCHEMAS

_VERSION = b"auv-cosim content 3"
"""Changes when what is hashed changes: hashes of different versions cannot be compared."""
_NOT_COVERED = ("foxglove.", SCENE_SCHEMAS)


def is_covered(channel: Channel) -> bool:
    """Whether the content hash covers the messages of a channel."""
    return channel.topic != LOG_TOPIC and not channel.schema.name.startswith(_NOT_COVERED)


class ContentDigest:
    """The content hash of messages, those of each channel in file order."""

    def __init__(self) -> None:
        self._topics: dict[int, _Topic] = {}

    def declare(self, number: int, channel: Channel) -> None:
        """Take a channel, before its first message."""
        if is_covered(channel):
            self._topics[number] = _Topic(channel)

    def add(self, messages: Messages) -> None:
        """Take the next messages; those of channels that are not covered do not count."""
        for number, mine in messages.by_channel():
            if number in self._topics:
                part = messages.part(mine).compact()
                records = np.frombuffer(part.data, np.uint8).copy()
                for place in (LENGTH_BEFORE, LENGTH_BEFORE + 1):  # of the channel's number
                    records[part.places + place] = 0
                self._topics[number].add(len(part), records)

    def add_records(self, parts: Sequence[Records], numbers: Sequence[Integers]) -> None:
        """Take the next messages as they are written, before they have the number of a channel.

        `numbers` : of each part, which of all these records its own are.
        """
        of_channel: dict[int, list[tuple[Integers, Bytes]]] = {}
        for part, own in zip(parts, numbers, strict=True):
            if part.channel in self._topics:
                of_channel.setdefault(part.channel, []).append((own, part.lines))
        for channel, found in of_channel.items():
            order = np.argsort(np.concatenate([own for own, _ in found]), kind="stable")
            records, _ = lines_in_order([lines for _, lines in found], order)
            self._topics[channel].add(order.size, records)

    def of_topics(self) -> dict[str, list[bytes]]:
        """Return by topic what is known of its messages, as bytes; of those that have any."""
        found: dict[str, list[bytes]] = {}
        for one in self._topics.values():
            if one.count:
                found.setdefault(one.topic, []).append(one.digest())
        return {topic: sorted(of) for topic, of in found.items()}

    def hexdigest(self) -> str:
        """Return the hash so far, as 64 hexadecimal digits."""
        found = sorted(one for of in self.of_topics().values() for one in of)
        return hashlib.sha256(_VERSION + b"".join(found)).hexdigest()


class _Topic:
    """The messages of one channel so far."""

    def __init__(self, channel: Channel) -> None:
        self.topic, self._head = channel.topic, digest_of_channel(channel)
        self.count, self._messages = 0, hashlib.sha256()

    def add(self, count: int, records: Bytes) -> None:
        """Take the next records, which have the channel number 0."""
        self.count += count
        self._messages.update(records.data)

    def digest(self) -> bytes:
        """Return what is known of its messages."""
        return self._head + struct.pack("<Q", self.count) + self._messages.digest()


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
