"""Encode rows of values as protobuf messages."""

from __future__ import annotations

import operator
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.rows.columns import Column, Mine, columns_of_doubles, columns_of_rows
from cosim.trace.rows.layout import Signal, field_names
from cosim.trace.rows.wire import FIXED64, Bytes, equal_rows, field_tag


def tag(number: int) -> bytes:
    """Return the wire tag of a double with this field number."""
    return field_tag(number, FIXED64)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a string is expected")
    return value


_CONVERT: dict[str, Callable[[Any], Any]] = {
    "float": float,
    "uint": operator.index,
    "int": operator.index,  # int() would cut 2.7 down to 2 and say nothing
    "bool": bool,
    "string": _text,
}


_HEAD = struct.Struct("<BHIQQ")
"""Head of a row that waits: what follows, channel, sequence, log and publish time [ns]."""

_MESSAGE, _DOUBLES = 0, 1
_HEAD_FIELDS = np.dtype(
    [("what", "u1"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)


class RowEncoder:
    """An encoder of the rows of one topic.

    A row of doubles, none absent, is tag, value, tag, value, ... and has a fixed length: all rows
    are encoded as one array. Other rows are encoded together by the lengths of their fields.
    """

    def __init__(self, topic: str, signals: Sequence[Signal], message: type[Any]) -> None:
        self._topic = topic
        self._signals = tuple(signals)
        self._fields = field_names([signal.name for signal in signals])
        self._message = message
        tags = [tag(i + 1) for i in range(len(signals))]
        self._doubles = bool(signals) and all(signal.kind == "float" for signal in signals)
        doubles = struct.Struct(f"{_HEAD.format}{len(tags)}d")
        self._pack = doubles.pack if self._doubles else None
        self._blank = np.frombuffer(b"".join(t + bytes(8) for t in tags), np.uint8)
        self._runs = _runs(tags)

    def waiting(
        self, channel: int, sequence: int, log_ns: int, publish_ns: int, values: Sequence[Any]
    ) -> bytes:
        """Check one row, None for absent, and return it as `laid_out` takes it.

        Raises
        ------
        InputError : wrong number or kind of values.
        struct.error : another number is none, or out of the range that MCAP has for it.
        """
        if self._pack is not None:
            try:
                return self._pack(_DOUBLES, channel, sequence, log_ns, publish_ns, *values)
            except (struct.error, TypeError, OverflowError):  # we find out below what is wrong
                pass
        if len(values) != len(self._signals):
            raise self._wrong_number(str(len(self._signals)), str(len(values)))
        return waiting_message(channel, sequence, log_ns, publish_ns, self._message_of(values))

    def many(
        self, rows: NDArray[np.float64] | Sequence[Sequence[Any]], room: int = 0
    ) -> Iterator[tuple[Mine, Bytes]]:
        """Yield numbers and bytes, uint8 (k, room + size), of the rows of each shape.

        Parameters
        ----------
        rows : (m, signals), doubles (which stand for integers and booleans too), or m lists of
            values of the signals' own kinds, None where absent.
        room : bytes left free in front of each row.

        Raises
        ------
        InputError : a row has the wrong number of values, or one of the wrong kind.
        """
        if isinstance(rows, np.ndarray):
            if rows.ndim != 2 or rows.shape[1] != len(self._signals):
                count = f"rows of {len(self._signals)}"
                raise self._wrong_number(count, f"shape {rows.shape}")
            if self._doubles:
                yield slice(None), self.of_doubles(rows, room)
                return
            columns = columns_of_doubles(self._topic, self._signals, rows)
            yield from self._by_shape(columns, _shapes(columns, len(rows)), room)
            return
        found = columns_of_rows(self._signals, rows)
        shapes = [] if found is None else _shapes(found, len(rows))
        if found is None or len(shapes) > max(16, len(rows) // 8):
            # absent values, wrong ones (reported one by one), or hardly two rows of one shape
            yield from self._one_by_one(rows, room)
            return
        yield from self._by_shape(found, shapes, room)

    def of_doubles(self, rows: NDArray[np.float64], room: int) -> Bytes:
        """Return rows of doubles, (m, signals), as uint8 (m, room + size)."""
        size = room + self._blank.size
        lines = np.empty((len(rows), size), np.uint8)
        lines[:, room:] = self._blank
        for first, last, at, stride in self._runs:
            shape, strides = (len(rows), last - first), (size, stride)
            into: NDArray[np.float64] = np.ndarray(shape, "<f8", lines, room + at, strides)
            into[:] = rows[:, first:last]
        return lines

    def _by_shape(
        self, columns: Sequence[Column], shapes: Sequence[tuple[Mine, int]], room: int
    ) -> Iterator[tuple[Mine, Bytes]]:
        for mine, members in shapes:
            parts = [column.size_of(mine) for column in columns]
            lines = np.empty((members, room + sum(parts)), np.uint8)
            at = room
            for column, size in zip(columns, parts, strict=True):
                column.put(lines[:, at : at + size], mine)
                at += size
            yield mine, lines

    def _one_by_one(self, rows: Sequence[Sequence[Any]], room: int) -> Iterator[tuple[Mine, Bytes]]:
        checked = [self.waiting(0, 0, 0, 0, row) for row in rows]
        for mine, _, lines in laid_out(checked, {0: self}, room):
            yield mine, lines

    def _wrong_number(self, expected: str, got: str) -> InputError:
        return InputError(
            "wrong number of values", where=f"topic {self._topic}", expected=expected, got=got
        )

    def _message_of(self, values: Sequence[Any]) -> bytes:
        message = self._message()
        for signal, field, value in zip(self._signals, self._fields, values, strict=True):
            if value is None:
                continue
            try:
                setattr(message, field, _CONVERT[signal.kind](value))
            except (TypeError, ValueError, OverflowError) as error:
                raise InputError(
                    "a value of the wrong kind",
                    where=f"topic {self._topic}, signal {signal.name!r}",
                    expected=f"{signal.kind}, or None for absent",
                    got=f"{value!r} ({type(value).__name__})",
                ) from error
        encoded: bytes = message.SerializeToString(deterministic=True)
        return encoded


def waiting_message(
    channel: int, sequence: int, log_ns: int, publish_ns: int, message: bytes
) -> bytes:
    """Return a message as `laid_out` takes it; `struct.error` as `RowEncoder.waiting`."""
    return _HEAD.pack(_MESSAGE, channel, sequence, log_ns, publish_ns) + message


def laid_out(
    waiting: Sequence[bytes], encoders: Mapping[int, RowEncoder], room: int
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.void], Bytes]]:
    """Yield numbers, heads and bytes, uint8 (k, room + size), of the rows of each shape.

    Parameters
    ----------
    waiting : rows as `RowEncoder.waiting` and `waiting_message` returned them.
    encoders : of their channels.
    room : bytes left free in front of each row.
    """
    if not waiting:
        return
    sizes = np.fromiter(map(len, waiting), np.int64, len(waiting))
    joined = np.frombuffer(b"".join(waiting), np.uint8)
    places = np.cumsum(sizes) - sizes
    heads = joined[places[:, None] + np.arange(_HEAD.size)].view(_HEAD_FIELDS)[:, 0]
    for mine in equal_rows(np.column_stack([heads["what"], heads["channel"], sizes])):
        count, first, own = mine.size, heads[mine[0]], joined
        if count < len(waiting):
            own = np.frombuffer(b"".join([waiting[i] for i in mine.tolist()]), np.uint8)
        rows = own.reshape(count, -1)
        if first["what"] == _DOUBLES:
            shape, strides = (count, (rows.shape[1] - _HEAD.size) // 8), (rows.shape[1], 8)
            values: NDArray[np.float64] = np.ndarray(shape, "<f8", own, _HEAD.size, strides)
            lines = encoders[int(first["channel"])].of_doubles(values, room)
        else:
            lines = np.empty((count, room + rows.shape[1] - _HEAD.size), np.uint8)
            lines[:, room:] = rows[:, _HEAD.size :]
        yield mine, heads[mine], lines


def _runs(tags: Sequence[bytes]) -> list[tuple[int, int, int, int]]:
    """Group neighbouring doubles whose tags have one length: first, last, place, distance.

    Each group is filled by one strided assignment.
    """
    runs: list[tuple[int, int, int, int]] = []
    at = 0
    for i, t in enumerate(tags):
        stride = len(t) + 8
        if runs and runs[-1][3] == stride:
            first, _, place, _ = runs[-1]
            runs[-1] = (first, i + 1, place, stride)
        else:
            runs.append((i, i + 1, at + len(t), stride))
        at += stride
    return runs


def _shapes(columns: Sequence[Column], count: int) -> list[tuple[Mine, int]]:
    """Group rows whose fields have the same lengths, with the size of each group."""
    varying = [column.size for column in columns if isinstance(column.size, np.ndarray)]
    if not varying:
        return [(slice(None), count)]
    return [(mine, mine.size) for mine in equal_rows(np.column_stack(varying))]
