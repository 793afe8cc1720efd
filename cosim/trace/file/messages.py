"""Find the messages of one chunk, as arrays.

The message index behind a chunk has the places of its messages. It is used if its entries and the
declarations between them cover the chunk without a gap; else the chunk is read record by record.
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from cosim.core import distinct
from cosim.trace.file.records import DamageError, inner_records, may_follow, parsed

Integers = NDArray[np.int64]

HEAD = np.dtype(
    [
        ("opcode", "<u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
        ("publish", "<u8"),
    ]
)
_BEFORE = 9  # opcode and length
_INDEX = struct.Struct("<HI")
_DECLARING = (Opcode.SCHEMA, Opcode.CHANNEL)
Others = list[tuple[int, memoryview]]


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages in a buffer.

    Attributes
    ----------
    data : the buffer.
    places : beginning of each record, int64 (m,), in file order.
    heads : opcode, length, channel, sequence, log and publish time, (m,) of `HEAD`.
    """

    data: bytes
    places: Integers
    heads: NDArray[Any]

    @classmethod
    def at(cls, data: bytes, places: Integers) -> Messages:
        """Return the messages that begin at these places of a buffer, all inside it."""
        return cls(data, places, structs_at(data, places, HEAD))

    def __len__(self) -> int:
        return int(self.places.size)

    def part(self, which: NDArray[Any]) -> Messages:
        """Return the messages that a mask or indices select."""
        return Messages(self.data, self.places[which], self.heads[which])

    def by_channel(self) -> Iterator[tuple[int, Integers]]:
        """Yield the id of each channel, and the numbers of its messages in order, (k,)."""
        return groups(self.heads["channel"])

    def spans(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield id, least and greatest log time, and number of messages of each channel."""
        if not len(self):
            return
        order = np.argsort(self.heads["channel"], kind="stable")
        found, starts = np.unique(self.heads["channel"][order], return_index=True)
        times = self.heads["log"][order]
        low, high = np.minimum.reduceat(times, starts), np.maximum.reduceat(times, starts)
        counts = np.diff(starts, append=len(self))
        columns = (column.tolist() for column in (found, low, high, counts))
        yield from zip(*columns, strict=True)

    @property
    def sizes(self) -> Integers:
        """Bytes of each payload, int64 (m,)."""
        return self.heads["length"].astype(np.int64) - (HEAD.itemsize - _BEFORE)

    def records(self) -> Iterator[bytes]:
        """Yield the whole records one by one."""
        ends = self.places + _BEFORE + self.heads["length"].astype(np.int64)
        for start, end in zip(self.places.tolist(), ends.tolist(), strict=True):
            yield self.data[start:end]

    def compact(self) -> Messages:
        """Return the same messages in a buffer that has nothing else."""
        sizes = _BEFORE + self.heads["length"].astype(np.int64)
        places = np.cumsum(sizes) - sizes
        begin = int(self.places[0]) if len(self) else 0
        if np.array_equal(self.places, places + begin):
            data = self.data[begin : begin + int(sizes.sum())]
        elif (sizes == sizes[0]).all():
            data = structs_at(self.data, self.places, np.dtype(f"V{sizes[0]}")).tobytes()
        else:
            data = b"".join(self.records())
        return Messages(data, places, self.heads)

    @classmethod
    def joined(cls, parts: Sequence[Messages]) -> Messages:
        """Return the messages of several buffers in one."""
        if len(parts) == 1:
            return parts[0]
        ends = np.cumsum([len(part.data) for part in parts])
        places = [part.places + at for part, at in zip(parts, np.append(0, ends), strict=False)]
        heads = np.concatenate([part.heads for part in parts])
        return cls(b"".join([part.data for part in parts]), np.concatenate(places), heads)

    def payloads(self) -> Iterator[memoryview]:
        """Yield the payloads one by one."""
        view = memoryview(self.data)
        starts = self.places + HEAD.itemsize
        for start, end in zip(starts.tolist(), (starts + self.sizes).tolist(), strict=True):
            yield view[start:end]

    def by_size(self) -> Iterator[tuple[Integers, NDArray[np.uint8]]]:
        """Yield the messages of each size: their numbers (k,), and payloads, uint8 (k, size)."""
        sizes = self.sizes
        if sizes.size and (sizes == sizes[0]).all():
            yield np.arange(sizes.size), self._matrix(self.places, int(sizes[0]))
            return
        for size in distinct(sizes).tolist():
            which = np.flatnonzero(sizes == size)
            yield which, self._matrix(self.places[which], size)

    def _matrix(self, places: Integers, size: int) -> NDArray[np.uint8]:
        if size == 0:
            return np.zeros((places.size, 0), np.uint8)
        step = _step(places)
        if step:
            at, shape = int(places[0]) + HEAD.itemsize, (places.size, size)
            return np.ndarray(shape, np.uint8, self.data, at, (step, 1))
        found = structs_at(self.data, places + HEAD.itemsize, np.dtype(f"V{size}"))
        return found.view(np.uint8).reshape(places.size, size)


def groups(numbers: NDArray[Any]) -> Iterator[tuple[int, Integers]]:
    """Yield each number, ascending, and the places of it, in order, (k,)."""
    if numbers.size and (numbers == numbers[0]).all():
        yield int(numbers[0]), np.arange(numbers.size)
        return
    order = np.argsort(numbers, kind="stable")
    found, starts = np.unique(numbers[order], return_index=True)
    yield from zip(found.tolist(), np.split(order, starts[1:]), strict=False)


def together(blocks: Iterable[Messages], least_bytes: int) -> Iterator[Messages]:
    """Join neighbours until they have so many bytes."""
    waiting: list[Messages] = []
    size = 0
    for block in blocks:
        waiting.append(block)
        size += len(block.data)
        if size >= least_bytes:
            yield Messages.joined(waiting)
            waiting, size = [], 0
    if waiting:
        yield Messages.joined(waiting)


def on_channels(messages: Messages, channels: Iterable[int]) -> NDArray[np.bool_]:
    """Return which messages are on one of these channels, by id."""
    wanted = np.zeros(2**16, np.bool_)
    wanted[list(channels)] = True
    found: NDArray[np.bool_] = wanted[messages.heads["channel"]]
    return found


def structs_at(data: bytes, places: Integers, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the structures at places of a buffer; all must lie inside."""
    count = len(data) - dtype.itemsize + 1
    if count < 1:
        return np.zeros(0, dtype)
    step = _step(places)
    if step:  # one distance between all of them: half the time
        return np.ndarray(places.shape, dtype, data, int(places[0]), (step,)).copy()
    everywhere = np.ndarray((count,), dtype, data, strides=(1,))
    found: NDArray[Any] = everywhere[places]
    return found


def _step(places: Integers) -> int:
    """Return the distance between neighbours if it is everywhere the same, and else 0."""
    steps = np.diff(places)
    return int(steps[0]) if steps.size and (steps == steps[0]).all() else 0


def find_messages(
    data: bytes, index: Sequence[bytes | memoryview]
) -> tuple[Messages, Others, DamageError | None]:
    """Return messages and declarations of an opened chunk, and the damage that cut it short.

    Parameters
    ----------
    data : the records of the chunk.
    index : contents of its message index records, or none.
    """
    places = _indexed(index)
    if places is not None:
        found = _from_index(data, places)
        if found is not None:
            return *found, None
    return _from_scan(data)


def entries_of(content: bytes | memoryview) -> tuple[int, NDArray[np.uint64]] | None:
    """Return channel and (log time, place), (m, 2), of a message index record; None if damaged."""
    if len(content) < _INDEX.size:
        return None
    channel, size = _INDEX.unpack_from(content)
    end = _INDEX.size + size
    if end > len(content) or size % 16 or not may_follow(content[end:]):
        return None
    return channel, np.frombuffer(content, "<u8", size // 8, _INDEX.size).reshape(-1, 2)


def _indexed(index: Sequence[bytes | memoryview]) -> NDArray[np.uint64] | None:
    found = [entries_of(content) for content in index]
    if not found or any(entry is None for entry in found):
        return None
    places = np.concatenate([entry[1][:, 1] for entry in found if entry is not None])
    places.sort()
    return places


def _from_index(data: bytes, places_in_index: NDArray[np.uint64]) -> tuple[Messages, Others] | None:
    """Return the messages at these places; None unless they and declarations fill the chunk."""
    if places_in_index.size == 0 or int(places_in_index[-1]) > len(data) - HEAD.itemsize:
        return None
    places = places_in_index.astype(np.int64)
    heads = structs_at(data, places, HEAD)
    lengths = heads["length"]
    strange = (heads["opcode"] != Opcode.MESSAGE) | (lengths > len(data))
    if (strange | (lengths < HEAD.itemsize - _BEFORE)).any():
        return None
    ends = places + _BEFORE + lengths.astype(np.int64)
    gaps = np.append(places, len(data)) - np.append(0, ends)
    if (gaps < 0).any():
        return None
    others: Others = []
    view = memoryview(data)
    for k in np.flatnonzero(gaps):
        begin = int(ends[k - 1]) if k else 0
        try:
            between = [(o, c) for o, _, c in inner_records(view[begin : begin + int(gaps[k])])]
        except DamageError:
            between = [(Opcode.MESSAGE, view)]
        if any(opcode == Opcode.MESSAGE for opcode, _ in between):
            return None
        others += between
    return Messages(data, places, heads), others


def _from_scan(data: bytes) -> tuple[Messages, Others, DamageError | None]:
    places: list[int] = []
    others: Others = []
    damage = None
    try:
        for opcode, at, content in inner_records(data):
            if opcode == Opcode.MESSAGE:
                places.append(at)
            else:
                others.append((opcode, content))
    except DamageError as error:
        damage = error
    return Messages.at(data, np.array(places, np.int64)), others, damage


def salvaged_messages(
    data: bytes, index: Sequence[bytes | memoryview], channels: Collection[int], *, cut: bool
) -> tuple[Messages, Others]:
    """Return what is left of a damaged chunk: record by record, helped by its index.

    A record whose length is false ends where the next one begins: where the index has one, or
    where the first of two records lies that follow each other. Of a message that the index names,
    the opcode, and a channel that is not among `channels`, are as the index has them. cut : whether
    the end of the chunk is missing.
    """
    entries = [entries_of(content) for content in index]
    named = {int(at): entry[0] for entry in entries if entry is not None for at in entry[1][:, 1]}
    starts = sorted(at for at in named if at < len(data))
    found = _Damaged(data, channels, named)
    places: dict[int, int] = {}
    others: Others = []
    view, at, size = memoryview(data), 0, len(data)
    while at <= size - _BEFORE:
        place = bisect_right(starts, at)
        after = starts[place] if place < len(starts) else size
        opcode, end = found.head(at)
        if found.begins(at):
            end = found.end(at, after)
        elif at in named:
            opcode, end = Opcode.MESSAGE, after
        elif opcode in _DECLARING or found.is_message(at):
            end = found.next(at + _BEFORE, after)
        else:
            at = found.next(at + 1, after)
            continue
        whole = end < size or not cut or end == found.head(at)[1]
        if opcode == Opcode.MESSAGE and whole and end - at >= HEAD.itemsize:
            places[at] = end - at - _BEFORE
        elif opcode in _DECLARING:
            with suppress(DamageError):
                found.declare(opcode, view[at + _BEFORE : end])
                others.append((opcode, view[at + _BEFORE : end]))
        at = end
    messages = Messages.at(data, np.array([*places], np.int64))
    messages.heads["length"] = [*places.values()]
    for k, at in enumerate(places):
        if messages.heads["channel"][k] not in found.channels:
            messages.heads["channel"][k] = named.get(at, messages.heads["channel"][k])
    return messages, others


class _Damaged:
    """The records of a damaged chunk.

    `channels` : those declared so far; `named` : where the index has messages.
    """

    def __init__(self, data: bytes, channels: Collection[int], named: Collection[int]) -> None:
        self._data, self._size, self._named = data, len(data), named
        self.channels = set(channels)

    def head(self, at: int) -> tuple[int, int]:
        """Return opcode and end of the record at a place, as it has them."""
        length = int.from_bytes(self._data[at + 1 : at + _BEFORE], "little")
        return self._data[at], at + _BEFORE + length

    def is_message(self, at: int) -> bool:
        """Whether a message of a known channel lies at a place, whatever its length."""
        channel = int.from_bytes(self._data[at + _BEFORE : at + _BEFORE + 2], "little")
        return self._data[at] == Opcode.MESSAGE and channel in self.channels

    def begins(self, at: int) -> bool:
        """Whether a record lies at a place, and fits in the chunk."""
        if at > self._size - _BEFORE:
            return False
        opcode, end = self.head(at)
        least = HEAD.itemsize if opcode == Opcode.MESSAGE else _BEFORE + 1
        return opcode in (*_DECLARING, Opcode.MESSAGE) and at + least <= end <= self._size

    def end(self, at: int, after: int) -> int:
        """Return where the record ends that lies at a place; `after` : the next that is named."""
        end = self.head(at)[1]
        if after < end:  # its length is false, or the index
            return after if self.begins(after) else end
        if end in (after, self._size) or self.begins(end):
            return end
        if at in self._named:
            return after
        return min(end, self.next(at + _BEFORE, end))

    def next(self, first: int, last: int) -> int:
        """Return where the first of two records lies that follow each other; else `last`."""
        for match in _RECORD.finditer(self._data, first, min(last + _BEFORE, self._size)):
            at = match.start()
            if at < last and self.begins(at):
                end = self.head(at)[1]
                if end == self._size or self.begins(end):
                    return at
        return last

    def declare(self, opcode: int, content: memoryview) -> None:
        """Take note of a schema or channel; `DamageError` if it is none."""
        if opcode == Opcode.CHANNEL:
            self.channels.add(parsed(Channel, content).id)
        else:
            parsed(Schema, content)


_RECORD = re.compile(rb"(?=[\x03-\x05].{4}\x00\x00\x00\x00)", re.DOTALL)
"""Where a record within a chunk could begin."""
