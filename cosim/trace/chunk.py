"""The chunk in progress: what goes into it, and what it is once it is closed."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.opcode import Opcode

from cosim.trace.block import HEAD, LENGTH_BEFORE, Block

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Integers = NDArray[np.int64]


@dataclass(frozen=True)
class ClosedChunk:
    """A chunk that is closed.

    Attributes
    ----------
    data : its records, uncompressed.
    first, last : least and greatest log time [ns].
    index : per channel, in order of first use: id, count, and (log time, offset) as bytes.
    """

    data: bytes | memoryview
    first: int
    last: int
    index: list[tuple[int, int, bytes]]


class OpenChunk:
    """Records one behind the other.

    Each piece goes in with what the index is to say of it in one step, so that an interruption
    in between two steps leaves nothing half done.
    """

    def __init__(self) -> None:
        self.count = 0
        self.messages = 0
        self._pieces: list[tuple[Any, Any, Any, Any]] = []

    def declare(self, record: bytes) -> None:
        """A schema or channel record."""
        self._pieces.append((record, None, None, None))
        self.count += len(record)

    def message(
        self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """One message."""
        length = HEAD.size - LENGTH_BEFORE + len(data)
        record = HEAD.pack(Opcode.MESSAGE, length, channel, sequence, log_ns, publish_ns) + data
        self._pieces.append((record, channel, log_ns, None))
        self.count += len(record)
        self.messages += 1

    def add(self, block: Block) -> None:
        """Many messages."""
        self._pieces.append((block.data, block.channels, block.log_ns, block.ends))
        self.count += len(block.data)
        self.messages += block.size

    def seal(self) -> ClosedChunk:
        """The chunk as it is written; it has a message."""
        columns: list[tuple[Any, Any, Any]] = []
        single: list[tuple[int, int, int]] = []
        at = 0
        for data, channels, log_ns, ends in self._pieces:
            if ends is not None:
                if single:
                    columns.append(tuple(np.array(single, np.int64).T))
                    single = []
                starts = np.empty(ends.size, np.int64)
                starts[0], starts[1:] = at, ends[:-1] + at
                columns.append((channels, log_ns, starts))
            elif channels is not None:
                single.append((channels, log_ns, at))
            at += len(data)
        if single:
            columns.append(tuple(np.array(single, np.int64).T))
        channels, times, starts = (
            parts[0] if len(parts) == 1 else np.concatenate(parts)
            for parts in zip(*columns, strict=True)
        )
        data = self._pieces[0][0]
        if len(self._pieces) > 1:
            data = b"".join([piece[0] for piece in self._pieces])
        return ClosedChunk(
            data, int(times.min()), int(times.max()), _index(channels, times, starts)
        )


def _index(channels: Integers, times: Integers, starts: Integers) -> list[tuple[int, int, bytes]]:
    pairs = np.empty((times.size, 2), "<u8")
    pairs[:, 0], pairs[:, 1] = times, starts
    if (channels == channels[0]).all():
        return [(int(channels[0]), times.size, pairs.tobytes())]
    index = []
    for channel in np.flatnonzero(np.bincount(channels)).tolist():
        mine = np.flatnonzero(channels == channel)
        index.append((int(mine[0]), channel, pairs[mine]))
    return [(channel, len(own), own.tobytes()) for _, channel, own in sorted(index, key=_FIRST)]


_FIRST = operator.itemgetter(0)
