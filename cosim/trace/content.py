"""The content hash: equal for two runs that did the same, wherever and however written.

SHA-256 over two digests, each of length-prefixed parts (so that no two contents give the same
bytes):

- messages, in file order: a digest of the channel (topic, message encoding, schema name,
  encoding and data, channel metadata sorted by key), log time, publish time, sequence, payload;
- metadata records, in file order: name and entries sorted by key, without the keys that begin
  with `host.`, and without the record that says that a file was recovered.

Not covered: compression, chunking, schema and channel ids, indexes, the writing library, and
attachments, whose hashes belong into `cosim.run`.
"""

from __future__ import annotations

import hashlib
import struct
from typing import TYPE_CHECKING

from cosim.trace.layout import HOST_PREFIX, RECOVERED
from cosim.trace.reader import Channel, Trace

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from os import PathLike

_VERSION = b"auv-cosim content 1"
_TIMES = struct.Struct("<QQIQ")


def content_hash(path: str | PathLike[str], *, incomplete: bool | None = None) -> str:
    """Content hash of a trace, as 64 hexadecimal digits.

    `incomplete` as in `Trace`: the hash of a file cut short is that of what it still holds.

    Raises
    ------
    InputError, LossError : as `Trace`.
    """
    return content_hash_of(Trace(path, incomplete=incomplete))


def content_hash_of(trace: Trace) -> str:
    """Content hash of a trace already open."""
    messages = hashlib.sha256()
    known: dict[int, bytes] = {}
    for channel, sequence, log, publish, payload in trace.messages():
        head = known.get(id(channel))
        if head is None:
            head = known[id(channel)] = _channel(channel)
        messages.update(head + _TIMES.pack(log, publish, sequence, len(payload)))
        messages.update(payload)
    metadata = hashlib.sha256()
    for name, entries in trace.metadata:
        if name == RECOVERED:
            continue
        metadata.update(_joined([name.encode(), *_entries(entries)]))
    return hashlib.sha256(_VERSION + messages.digest() + metadata.digest()).hexdigest()


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
    return b"".join([struct.pack("<Q", len(parts))] + [_prefixed(part) for part in parts])


def _prefixed(part: bytes) -> bytes:
    return struct.pack("<Q", len(part)) + part
