"""Thousands of MCAP message records laid out at once, as arrays of bytes.

A message record is `05 | length u64 | channel u16 | sequence u32 | log u64 | publish u64 | data`.
Rows of one topic have data of one length, so that all their records are one structured array;
a block puts the records of several topics into one order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_HEAD = np.dtype(
    [
        ("opcode", "<u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
        ("publish", "<u8"),
    ]
)
_AFTER_LENGTH = _HEAD.itemsize - 9


@dataclass(frozen=True)
class Records:
    """Message records of one channel and one length.

    Attributes
    ----------
    channel : id of the channel.
    log_ns, publish_ns, sequence : int64 (m,).
    data : uint8 (m, size).
    rank : orders records of the same log time, int64 (m, keys), or one tuple for all: what has
        the smaller first key comes first, then the second decides, and so on.
    """

    channel: int
    log_ns: Integers
    publish_ns: Integers
    sequence: Integers
    data: Bytes
    rank: Integers

    @property
    def size(self) -> int:
        """Bytes of a record."""
        return int(_HEAD.itemsize + self.data.shape[1])

    def lines(self) -> Bytes:
        """The records, uint8 (m, size)."""
        m, size = self.data.shape
        head = np.zeros(m, _HEAD)
        head["opcode"] = Opcode.MESSAGE
        head["length"] = _AFTER_LENGTH + size
        head["channel"] = self.channel
        head["sequence"] = self.sequence
        head["log"] = self.log_ns
        head["publish"] = self.publish_ns
        return np.hstack([head.view(np.uint8).reshape(m, _HEAD.itemsize), self.data])


@dataclass(frozen=True)
class Block:
    """Message records of several channels, one behind the other.

    Attributes
    ----------
    data : all records.
    ends : where each ends in `data`, int64 (m,).
    channels, log_ns : of each, int64 (m,).
    """

    data: memoryview
    ends: Integers
    channels: Integers
    log_ns: Integers

    @property
    def size(self) -> int:
        """How many records."""
        return self.ends.size

    def begin(self, i: int) -> int:
        """Where record i begins."""
        return int(self.ends[i - 1]) if i else 0

    def part(self, first: int, last: int) -> Block:
        """Records first to last - 1."""
        begin = self.begin(first)
        return Block(
            self.data[begin : int(self.ends[last - 1])],
            self.ends[first:last] - begin,
            self.channels[first:last],
            self.log_ns[first:last],
        )


def in_order(parts: Sequence[Records]) -> Block:
    """One block of all records: by log time, then by rank, then as given."""
    counts = [part.log_ns.size for part in parts]
    log = np.concatenate([part.log_ns for part in parts])
    keys = max(part.rank.shape[-1] for part in parts)
    rank = np.zeros((log.size, keys), np.int64)
    sizes = np.repeat([part.size for part in parts], counts)
    channels = np.repeat([part.channel for part in parts], counts)
    begin = 0
    for part, count in zip(parts, counts, strict=True):
        rank[begin : begin + count, : part.rank.shape[-1]] = part.rank
        begin += count
    order = np.lexsort((*(rank[:, i] for i in reversed(range(keys))), log))
    ends = np.cumsum(sizes[order])
    starts = np.empty(log.size, np.int64)
    starts[order] = ends - sizes[order]
    data = np.empty(int(ends[-1]) if ends.size else 0, np.uint8)
    begin = 0
    for part, count in zip(parts, counts, strict=True):
        places = starts[begin : begin + count, None] + np.arange(part.size)
        data[places] = part.lines()
        begin += count
    return Block(data.data, ends, channels[order], log[order])
