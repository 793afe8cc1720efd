"""The content hash: equal for two runs that did the same, whatever the host and compression.

SHA-256 over two digests, each of length-prefixed parts (so that no two contents give the same
bytes):

- messages, in file order: a digest of the channel (topic, message encoding, schema name,
  encoding and data, channel metadata sorted by key), log time, publish time, sequence, payload;
- metadata records, in file order: name and entries sorted by key, without the keys that begin
  with `host.`, and without the record of a recovery.

Not covered: compression, chunking, schema and channel ids, indexes, the writing library, and
attachments, whose hashes belong in `cosim.run`.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Mapping
from os import PathLike

import numpy as np

from cosim.trace.declared import Channel
from cosim.trace.layout import HOST_PREFIX, LOG_TOPIC, RECOVERED
from cosim.trace.messages import Messages
from cosim.trace.reader import Trace

_VERSION = b"auv-cosim content 1"
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
    """Return the content hash of a trace, as 64 hexadecimal digits.

    `incomplete` as in `Trace`: of a file cut short, the part that can be read is hashed.

    Raises
    ------
    InputError, LossError : as `Trace`.
    """
    return content_hash_of(Trace(path, incomplete=incomplete))


def content_hash_of(trace: Trace) -> str:
    """Return the content hash of an open trace."""
    trace.check()
    messages = hashlib.sha256()
    heads = {number: _channel(channel) for number, channel in trace.channels.items()}
    for block in trace.blocks():
        messages.update(_block(block, heads))
    metadata = hashlib.sha256()
    for name, entries in trace.metadata:
        if name != RECOVERED:
            metadata.update(_joined([name.encode(), *_entries(entries)]))
    return hashlib.sha256(_VERSION + messages.digest() + metadata.digest()).hexdigest()


def begins_with(whole: Trace, part: Trace) -> bool:
    """Whether every topic of `part` is the beginning of the same topic of `whole`, bit for bit.

    The topic /log is not compared: a run that was stopped early logs that.
    """
    counts = {t: info.count for t, info in part.topics.items() if info.count and t != LOG_TOPIC}
    if any(t not in whole.topics or whole.topics[t].count < n for t, n in counts.items()):
        return False
    return _beginnings(whole, counts) == _beginnings(part, counts)


def _beginnings(trace: Trace, counts: Mapping[str, int]) -> dict[str, bytes]:
    """Return the digest of the first messages of each topic."""
    heads = {number: _channel(channel) for number, channel in trace.channels.items()}
    digests = {topic: hashlib.sha256() for topic in counts}
    left = dict(counts)
    for block in trace.blocks():
        for number in np.unique(block.heads["channel"]).tolist():
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
        for channel in np.unique(part["channel"]).tolist():
            head["channel"][part["channel"] == channel] = heads[channel]
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
    return hashlib.sha256(_joined([*parts, schema.data, *_entries(channel.metadata)])).digest()


def _entries(entries: Mapping[str, str]) -> list[bytes]:
    kept = sorted(item for item in entries.items() if not item[0].startswith(HOST_PREFIX))
    return [text.encode() for item in kept for text in item]


def _joined(parts: Iterable[bytes]) -> bytes:
    parts = list(parts)
    prefixed = [struct.pack("<Q", len(part)) + part for part in parts]
    return struct.pack("<Q", len(parts)) + b"".join(prefixed)
