"""The content hash of version 2, of traces whose rows are of format 1.

SHA-256 over the messages of components and links, in file order: a digest of the channel, log time,
publish time, sequence, payload, length-prefixed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.digest import digest_of_channel, is_covered
from cosim.trace.file.block import Bytes, put_lines
from cosim.trace.file.declared import Channel
from cosim.trace.file.messages import Messages

_VERSION = b"auv-cosim content 2"
_HEAD = np.dtype(
    [
        ("channel", "V32"),
        ("log", "<u8"),
        ("publish", "<u8"),
        ("sequence", "<u4"),
        ("size", "<u8"),
    ]
)


class FormerDigest:
    """The content hash of messages that come in file order."""

    def __init__(self) -> None:
        self._messages = hashlib.sha256(_VERSION)
        self._heads: dict[int, bytes] = {}

    def declare(self, number: int, channel: Channel) -> None:
        """Take a channel, before its first message."""
        if is_covered(channel):
            self._heads[number] = digest_of_channel(channel)

    def add(self, messages: Messages) -> None:
        """Take the next messages; those of channels that are not covered do not count."""
        covered = np.isin(messages.heads["channel"], [*self._heads])
        part = messages if covered.all() else messages.part(np.flatnonzero(covered))
        self._messages.update(_laid_out(part, self._heads))

    def hexdigest(self) -> str:
        """Return the hash so far, as 64 hexadecimal digits."""
        return self._messages.hexdigest()


def _laid_out(block: Messages, heads: Mapping[int, bytes]) -> memoryview:
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
        put_lines(out, starts[which], _lines(name, part, payloads))
    return out.data


def _lines(name: Any, heads: NDArray[Any], payloads: Bytes) -> Bytes:
    """Return what is hashed of messages of one size, uint8 (k, size)."""
    count, size = payloads.shape
    lines = np.empty((count, _HEAD.itemsize + size), np.uint8)
    head: NDArray[np.void] = np.ndarray((count,), _HEAD, lines, 0, (lines.shape[1],))
    head["channel"], head["size"] = name, size
    for each in ("log", "publish", "sequence"):
        head[each] = heads[each]
    lines[:, _HEAD.itemsize :] = payloads
    return lines
