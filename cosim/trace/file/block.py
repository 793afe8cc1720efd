"""Lay out thousands of MCAP message records at once, as arrays of bytes.

A message record is `05 | length u64 | channel u16 | sequence u32 | log u64 | publish u64 | data`.
Rows of one topic have data of one length: all their records are one array. A block has the records
of several topics in one order.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

HEAD = struct.Struct("<BQHIQQ")
"""Head of a message record: opcode, length, channel, sequence, log time, publish time."""

LENGTH_BEFORE = 9
"""Bytes of opcode and length, which the length does not count."""


@dataclass(frozen=True)
class Records:
    """Message records of one channel and one length.

    Attributes
    ----------
    channel : id of the channel.
    log_ns, publish_ns, sequence : int64 (m,).
    lines : uint8 (m, size), with room for the head in front of the data.
    rank : order of records of the same log time: ascending in the first key, then the second,
        and so on; int64 (m, keys), or (keys,) for all.

    In its head each record has the channel number 0 until it is put in order.
    """

    channel: int
    log_ns: Integers
    publish_ns: Integers
    sequence: Integers
    lines: Bytes
    rank: Integers

    def __post_init__(self) -> None:
        m, size = self.lines.shape
        head = HEAD.pack(Opcode.MESSAGE, size - LENGTH_BEFORE, 0, 0, 0, 0)
        self.lines[:, : HEAD.size] = np.frombuffer(head, np.uint8)
        for values, form, place in (
            (self.sequence, "<u4", 11),
            (self.log_ns, "<u8", 15),
            (self.publish_ns, "<u8", 23),
        ):
            into: Integers = np.ndarray((m,), form, self.lines, place, (size,))
            into[:] = values

    def number(self) -> None:
        """Write the number of the channel into the records."""
        self.lines[:, LENGTH_BEFORE : LENGTH_BEFORE + 2] = list(self.channel.to_bytes(2, "little"))


@dataclass(frozen=True)
class Block:
    """Message records of several channels, one behind the other.

    Attributes
    ----------
    data : all records.
    ends : end of each in `data`, int64 (m,).
    channels, log_ns : of each, int64 (m,).
    """

    data: memoryview
    ends: Integers
    channels: Integers
    log_ns: Integers

    @property
    def size(self) -> int:
        """Number of records."""
        return self.ends.size

    def begin(self, i: int) -> int:
        """Return the beginning of record i in `data`."""
        return int(self.ends[i - 1]) if i else 0

    def part(self, first: int, last: int) -> Block:
        """Return records first to last - 1."""
        begin = self.begin(first)
        return Block(
            self.data[begin : int(self.ends[last - 1])],
            self.ends[first:last] - begin,
            self.channels[first:last],
            self.log_ns[first:last],
        )


Watch = Callable[[Sequence[Records], Sequence[Integers]], None]
"""Looks at records, and which of a block each will be, int64 (m,), before they have a channel."""


def in_order(
    parts: Sequence[Records], *, by_time: bool = True, watch: Watch | None = None
) -> Block:
    """Order all records in one block: by log time (if `by_time`), then by rank, then as given."""
    counts = [part.log_ns.size for part in parts]
    # the times are copied: the caller may use the array again
    log = np.concatenate([part.log_ns for part in parts])
    channels = np.repeat([part.channel for part in parts], counts)
    alone = len(parts) == 1 and _is_ordered(parts[0], by_time=by_time)
    order = np.arange(log.size) if alone else _order(parts, log, by_time=by_time)
    if watch is not None:
        numbers = np.empty(log.size, np.int64)
        numbers[order] = np.arange(log.size)
        watch(parts, np.split(numbers, np.cumsum(counts)[:-1]))
    for part in parts:
        part.number()
    data, ends = lines_in_order([part.lines for part in parts], order)
    return Block(data.data, ends, channels[order], log[order])


def lines_in_order(parts: Sequence[Bytes], order: Integers) -> tuple[Bytes, Integers]:
    """Return lines one behind the other, and the end of each, int64 (m,).

    parts : uint8 (k, size) of each size.
    order : which line comes, counted through all parts, int64 (m,).
    """
    counts = [len(lines) for lines in parts]
    sizes = np.repeat([lines.shape[1] for lines in parts], counts)
    ends = np.cumsum(sizes[order])
    if len(parts) == 1 and (np.diff(order) > 0).all():
        return parts[0].reshape(-1), ends
    starts = np.empty(sizes.size, np.int64)
    starts[order] = ends - sizes[order]
    data = np.empty(int(ends[-1]) if ends.size else 0, np.uint8)
    for lines, own in zip(parts, np.split(starts, np.cumsum(counts)[:-1]), strict=True):
        put_lines(data, own, lines)
    return data, ends


def put_lines(data: Bytes, starts: Integers, lines: Bytes) -> None:
    """Put lines of one length, uint8 (k, size), at these places, (k,)."""
    size = lines.shape[1]
    # every place at which one of this size could begin, as one item each
    places: NDArray[np.void] = np.ndarray(
        (data.size - size + 1,), np.dtype((np.void, size)), data, 0, (1,)
    )
    places[starts] = lines.view(places.dtype).ravel()


def _is_ordered(part: Records, *, by_time: bool) -> bool:
    steps = np.diff(part.log_ns if by_time else part.rank[:, 0])
    return bool((steps > 0).all() or (part.rank.ndim == 1 and (steps >= 0).all()))


def _order(parts: Sequence[Records], log: Integers, *, by_time: bool) -> NDArray[np.intp]:
    keys = max(part.rank.shape[-1] for part in parts)
    rank = np.zeros((keys, log.size), np.int64)
    begin = 0
    for part in parts:
        end = begin + part.log_ns.size
        rank[: part.rank.shape[-1], begin:end] = part.rank.T.reshape(part.rank.shape[-1], -1)
        begin = end
    return np.lexsort((*rank[::-1], log) if by_time else rank[::-1])
