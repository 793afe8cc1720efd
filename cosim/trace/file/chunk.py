"""Collect the records of a chunk, and index its messages when it is closed."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cosim.trace.file.block import HEAD, LENGTH_BEFORE, Block, Integers


@dataclass(frozen=True)
class ClosedChunk:
    """A closed chunk.

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
    """The chunk in progress: records, each appended together with its index entries.

    An interruption between two steps therefore leaves data and index in agreement.
    """

    def __init__(self) -> None:
        self.count = 0
        self.messages = 0
        self._pieces: list[tuple[Any, Any, Any, Any]] = []

    def declare(self, record: bytes) -> None:
        """Append a schema or channel record."""
        self._pieces.append((record, None, None, None))
        self.count += len(record)

    def message(
        self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """Append one message."""
        length = HEAD.size - LENGTH_BEFORE + len(data)
        record = HEAD.pack(Opcode.MESSAGE, length, channel, sequence, log_ns, publish_ns) + data
        self._pieces.append((record, channel, log_ns, None))
        self.count += len(record)
        self.messages += 1

    def add(self, block: Block) -> None:
        """Append a block of messages."""
        self._pieces.append((block.data, block.channels, block.log_ns, block.ends))
        self.count += len(block.data)
        self.messages += block.size

    def seal(self) -> ClosedChunk:
        """Close the chunk, which has a message, and index its messages."""
        columns: list[tuple[Any, Any, Any]] = []
        single: list[tuple[int, int, int]] = []
        at = 0
        for data, channels, log_ns, ends in self._pieces:
            if ends is not None:
                if single:
                    columns.append(_columns(single))
                    single = []
                columns.append((channels, log_ns.view(np.uint64), np.append(0, ends[:-1]) + at))
            elif channels is not None:
                single.append((channels, log_ns, at))
            at += len(data)
        if single:
            columns.append(_columns(single))
        channels, times, starts = (
            parts[0] if len(parts) == 1 else np.concatenate(parts)
            for parts in zip(*columns, strict=True)
        )
        data = self._pieces[0][0]
        if len(self._pieces) > 1:
            data = b"".join([piece[0] for piece in self._pieces])
        index = _index(channels, times, starts)
        return ClosedChunk(data, int(times.min()), int(times.max()), index)


def _columns(single: list[tuple[int, int, int]]) -> tuple[Integers, NDArray[np.uint64], Integers]:
    """Return channels, times and places of single messages; recovered times may be of any size."""
    channels, times, places = zip(*single, strict=True)
    return np.array(channels, np.int64), np.array(times, np.uint64), np.array(places, np.int64)


def _index(
    channels: Integers, times: NDArray[np.uint64], starts: Integers
) -> list[tuple[int, int, bytes]]:
    pairs = np.empty((times.size, 2), "<u8")
    pairs[:, 0], pairs[:, 1] = times, starts
    if (channels == channels[0]).all():
        return [(int(channels[0]), times.size, pairs.tobytes())]
    # of 16 bits, which numbers of channels are: sorted by digits, in a third of the time
    order = np.argsort(channels.astype(np.uint16), kind="stable")
    channels, pairs = channels[order], pairs[order]
    cuts = [0, *(np.flatnonzero(np.diff(channels)) + 1).tolist(), channels.size]
    spans = sorted(itertools.pairwise(cuts), key=lambda span: int(order[span[0]]))
    return [(int(channels[i]), j - i, pairs[i:j].tobytes()) for i, j in spans]
