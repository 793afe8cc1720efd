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
from os import PathLike

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError

from cosim.core import distinct
from cosim.trace.file.declared import Channel
from cosim.trace.file.messages import Messages
from cosim.trace.reader import Trace
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


def content_hash(path: str | PathLike[str], *, incomplete: bool | None = None) -> str:
    """Return the content hash of a trace, of this version, as 64 hexadecimal digits.

    `incomplete` as in `Trace`: of a file cut short, the part that can be read is hashed.

    Raises
    ------
    InputError, LossError : as `Trace`.
    """
    return content_hash_of(Trace(path, incomplete=incomplete))


def content_hash_of(trace: Trace) -> str:
    """Return the content hash of an open trace."""
    trace.check()
    heads = {n: _channel(channel) for n, channel in trace.channels.items() if _is_covered(channel)}
    messages = hashlib.sha256(_VERSION)
    for block in trace.blocks():
        covered = np.isin(block.heads["channel"], [*heads])
        messages.update(_block(block.part(np.flatnonzero(covered)), heads))
    return messages.hexdigest()


def _is_covered(channel: Channel) -> bool:
    return channel.topic != LOG_TOPIC and not channel.schema.name.startswith(_NOT_COVERED)


def begins_with(whole: Trace, part: Trace) -> bool:
    """Whether every topic of `part` is the beginning of the same topic of `whole`, bit for bit.

    The topic /log is not compared: a run that was stopped early logs that. Nor is the scene, which
    follows from the rest.
    """
    covered = {t: i for t, i in part.topics.items() if t != LOG_TOPIC and not i.is_computed}
    counts = {topic: info.count for topic, info in covered.items() if info.count}
    if any(t not in whole.topics or whole.topics[t].count < n for t, n in counts.items()):
        return False
    return _beginnings(whole, counts) == _beginnings(part, counts)


def _beginnings(trace: Trace, counts: Mapping[str, int]) -> dict[str, bytes]:
    """Return the digest of the first messages of each topic."""
    heads = {number: _channel(channel) for number, channel in trace.channels.items()}
    digests = {topic: hashlib.sha256() for topic in counts}
    left = dict(counts)
    for block in trace.blocks():
        for number in distinct(block.heads["channel"]).tolist():
            topic = trace.channels[number].topic
            if not left.get(topic):
                continue
            mine = np.flatnonzero(block.heads["channel"] == number)[: left[topic]]
            digests[topic].update(_block(block.part(mine), heads))
            left[topic] -= mine.size
    return {topic: digest.digest() for topic, digest in digests.items()}


def _block(block: Messages, heads: Mapping[int, bytes]) -> memoryview:
    """Lay out channel, times, sequence, size and payload of all messages at once, in order."""
    sizes = block.sizes + _HEAD.itemsize
    ends = np.cumsum(sizes)
    out = np.empty(int(ends[-1]) if ends.size else 0, np.uint8)
    starts = ends - sizes
    for which, payloads in block.by_size():
        part = block.heads[which]
        head = np.zeros(which.size, _HEAD)
        found, own = np.unique(part["channel"], return_inverse=True)
        names = b"".join([heads[channel] for channel in found.tolist()])
        head["channel"] = np.frombuffer(names, head["channel"].dtype)[own]
        head["log"], head["publish"] = part["log"], part["publish"]
        head["sequence"], head["size"] = part["sequence"], payloads.shape[1]
        lines = np.hstack([head.view(np.uint8).reshape(which.size, _HEAD.itemsize), payloads])
        size = np.dtype(f"V{lines.shape[1]}")
        places = np.ndarray((out.size - size.itemsize + 1,), size, out, strides=(1,))
        places[starts[which]] = lines.view(size)[:, 0]
    return out.data


def _channel(channel: Channel) -> bytes:
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
