"""Encode rows of values as protobuf messages of a fixed width.

Every number is of a protobuf type of fixed width (double, sfixed64, fixed64, bool), so that a row
without gaps is tag, value, tag, value, ... at places that are the same in all rows of a topic: they
are filled together, as arrays. Texts follow behind the numbers. A row in which a value is absent
goes through protobuf's own class.
"""

from __future__ import annotations

import operator
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.file.messages import groups
from cosim.trace.rows.layout import Signal, field_names

Bytes = NDArray[np.uint8]
Mine = NDArray[np.intp] | slice

_FORMS: Mapping[str, tuple[str, str, int]] = {
    "float": ("<f8", "d", 1),
    "int": ("<i8", "q", 1),
    "uint": ("<u8", "Q", 1),
    "bool": ("?", "?", 0),
}
"""By kind of a number: its form for NumPy and for `struct`, and protobuf's wire type of it."""
_TEXT = 2
"""Protobuf's wire type of a text."""


def varint(value: int) -> bytes:
    """Encode an unsigned integer as protobuf does, seven bits a byte."""
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])


def tag(number: int, wire: int = 1) -> bytes:
    """Return the tag of a field, by default of a double."""
    return varint(number << 3 | wire)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a string is expected")
    return value


def _truth(value: Any) -> bool:
    if value is None:
        raise TypeError("a value is absent")
    return bool(value)


_CONVERT: dict[str, Callable[[Any], Any]] = {
    "float": float,
    "uint": operator.index,
    "int": operator.index,  # int() would cut 2.7 down to 2 and say nothing
    "bool": _truth,
    "string": _text,
}


_HEAD = struct.Struct("<BHIQQ")
"""Head of a row that waits: what follows, channel, sequence, log and publish time [ns]."""

_MESSAGE, _VALUES = 0, 1
_HEAD_FIELDS = np.dtype(
    [("what", "u1"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)


class _Run(NamedTuple):
    """Neighbouring numbers of one form: the first and the one behind the last, place, distance."""

    form: np.dtype[Any]
    first: int
    last: int
    at: int
    stride: int


class RowEncoder:
    """An encoder of the rows of one topic.

    Parameters
    ----------
    topic, signals : of the topic.
    message : protobuf's class of its rows.
    """

    def __init__(self, topic: str, signals: Sequence[Signal], message: type[Any]) -> None:
        self._topic, self._signals, self._message = topic, tuple(signals), message
        self._fields = field_names([signal.name for signal in signals])
        self._numbers = [j for j, signal in enumerate(signals) if signal.kind != "string"]
        others = [j for j, signal in enumerate(signals) if signal.kind == "string"]
        self._texts = [(j, tag(j + 1, _TEXT)) for j in others]
        own = [(j, *_FORMS[signals[j].kind]) for j in self._numbers]
        forms = self._forms = [np.dtype(form) for _, form, _, _ in own]
        tags = [tag(j + 1, wire) for j, _, _, wire in own]
        filled = b"".join(t + bytes(form.itemsize) for t, form in zip(tags, forms, strict=True))
        self._blank = np.frombuffer(filled, np.uint8)
        self._runs = list(_runs(forms, tags))
        self._plain = not self._texts and all(form == np.float64 for form in forms)
        self._gaps_show = np.bool_ not in forms  # None is false to `struct`, and else an error
        self._pack = struct.Struct(_HEAD.format + "".join(letter for _, _, letter, _ in own)).pack
        self._packed = np.dtype([(str(i), form) for i, form in enumerate(forms)])

    def waiting(
        self, channel: int, sequence: int, log_ns: int, publish_ns: int, values: Sequence[Any]
    ) -> bytes:
        """Check one row, None for absent, and return it as `laid_out` takes it.

        Raises
        ------
        InputError : wrong number or kind of values.
        struct.error : another number is none, or out of the range that MCAP has for it.
        """
        head = channel, sequence, log_ns, publish_ns
        try:
            if self._gaps_show or None not in values:
                if not self._texts:
                    return self._pack(_VALUES, *head, *values)
                if len(values) == len(self._signals):
                    numbers = [values[j] for j in self._numbers]
                    return self._pack(_VALUES, *head, *numbers) + self._texts_of(values)
        except (struct.error, TypeError, OverflowError):  # it is found out below what is wrong
            pass
        if len(values) != len(self._signals):
            raise self._wrong_number(str(len(self._signals)), str(len(values)))
        return waiting_message(*head, self._message_of(values))

    def many(
        self, rows: NDArray[np.float64] | Sequence[Sequence[Any]], room: int = 0
    ) -> Iterator[tuple[Mine, Bytes]]:
        """Yield numbers and bytes, uint8 (k, room + size), of the rows of each size.

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
            found = rows if self._plain else [*map(self._cast, self._signals, rows.T)]
            yield slice(None), self._filled(found, len(rows), room)
            return
        columns = self._columns(rows)
        if columns is None:  # absent values, and wrong ones, which are reported one by one
            checked = [self.waiting(0, 0, 0, 0, row) for row in rows]
            for mine, _, lines in laid_out(checked, {0: self}, room):
                yield mine, lines
            return
        lines = self._filled(columns, len(rows), room)
        if not self._texts:
            yield slice(None), lines
            return
        texts = [*map(self._texts_of, rows)]
        for size, mine in groups(np.fromiter(map(len, texts), np.int64, len(texts))):
            behind = np.frombuffer(b"".join([texts[i] for i in mine.tolist()]), np.uint8)
            yield mine, np.hstack([lines[mine], behind.reshape(mine.size, size)])

    def unpacked(self, packed: Bytes, room: int) -> Bytes:
        """Return the rows that `waiting` packed, of one size, uint8 (k, room + size)."""
        count, texts = len(packed), _HEAD.size + self._packed.itemsize
        columns: Any = np.ndarray((count,), self._packed, packed, _HEAD.size, packed.strides[:1])
        if self._plain:
            shape, strides = (count, len(self._numbers)), (packed.strides[0], 8)
            columns = np.ndarray(shape, "<f8", packed, _HEAD.size, strides)
        else:
            columns = [columns[name] for name in self._packed.names or ()]
        lines = self._filled(columns, count, room, packed.shape[1] - texts)
        lines[:, room + self._blank.size :] = packed[:, texts:]
        return lines

    def _filled(
        self, numbers: NDArray[Any] | Sequence[Any], count: int, room: int, behind: int = 0
    ) -> Bytes:
        """Return rows with these numbers, (count, numbers) or a column of each, and room behind."""
        size = room + self._blank.size + behind
        lines = np.empty((count, size), np.uint8)
        lines[:, room : room + self._blank.size] = self._blank
        for form, first, last, at, stride in self._runs:
            shape, strides = (count, last - first), (size, stride)
            into: NDArray[Any] = np.ndarray(shape, form, lines, room + at, strides)
            if isinstance(numbers, np.ndarray):
                into[:] = numbers[:, first:last]
                continue
            for place in range(first, last):
                into[:, place - first] = numbers[place]
        return lines

    def _columns(self, rows: Sequence[Sequence[Any]]) -> list[NDArray[Any]] | None:
        """Return a column per number; None if a value is absent or not of its signal's kind."""
        if any(len(row) != len(self._signals) for row in rows):
            return None
        columns = [*zip(*rows, strict=True)] or [()] * len(self._signals)
        try:
            for j, _ in self._texts:
                [*map(_text, columns[j])]
            return [
                np.fromiter(map(_CONVERT[self._signals[j].kind], columns[j]), form, len(rows))
                for j, form in zip(self._numbers, self._forms, strict=True)
            ]
        except (TypeError, ValueError, OverflowError):
            return None

    def _texts_of(self, values: Sequence[Any]) -> bytes:
        encoded = [(head, _text(values[j]).encode()) for j, head in self._texts]
        return b"".join(part for h, text in encoded for part in (h, varint(len(text)), text))

    def _cast(self, signal: Signal, values: NDArray[np.float64]) -> NDArray[Any]:
        """Return doubles as values of their signal's kind; `InputError` for one that is none."""
        whole = np.rint(values) == values
        right = {
            "float": np.ones(values.shape, np.bool_),
            "int": whole & (np.abs(values) < 2.0**63),
            "uint": whole & (values >= 0) & (values < 2.0**64),
            "bool": ~np.isnan(values),  # any number but zero is true, in C and so in FMI
        }.get(signal.kind, np.zeros(values.shape, np.bool_))
        if not right.all():
            raise InputError(
                "a value of the wrong kind",
                where=f"topic {self._topic}, signal {signal.name!r}",
                expected=signal.kind,
                got=f"the double {values[~right][0]!r}",
            )
        return values if signal.kind == "float" else values.astype(_FORMS[signal.kind][0])

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
    """Yield numbers, heads and bytes, uint8 (k, room + size), of the rows of each size.

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
    shapes = (sizes << 17) | (heads["what"].astype(np.int64) << 16) | heads["channel"]
    for _, mine in groups(shapes):
        first, own = heads[mine[0]], joined
        if mine.size < len(waiting):
            own = np.frombuffer(b"".join([waiting[i] for i in mine.tolist()]), np.uint8)
        packed = own.reshape(mine.size, -1)
        if first["what"] == _VALUES:
            lines = encoders[int(first["channel"])].unpacked(packed, room)
        else:
            lines = np.empty((mine.size, room + packed.shape[1] - _HEAD.size), np.uint8)
            lines[:, room:] = packed[:, _HEAD.size :]
        yield mine, heads[mine], lines


def _runs(forms: Sequence[np.dtype[Any]], tags: Sequence[bytes]) -> Iterator[_Run]:
    """Group neighbouring numbers of one form whose tags have one length.

    Each group is filled by one strided assignment.
    """
    at, run = 0, None
    for place, (form, t) in enumerate(zip(forms, tags, strict=True)):
        stride = len(t) + form.itemsize
        if run is not None and (run.form, run.stride) == (form, stride):
            run = run._replace(last=place + 1)
        else:
            if run is not None:
                yield run
            run = _Run(form, place, place + 1, at + len(t), stride)
        at += stride
    if run is not None:
        yield run
