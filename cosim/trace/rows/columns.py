"""Encode columns of many rows as protobuf fields: the length of each value, and its bytes."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.rows.layout import Signal
from cosim.trace.rows.wire import (
    FIXED64,
    LENGTH,
    VARINT,
    Bytes,
    Integers,
    field_tag,
    put_varints,
    varint,
    varint_lengths,
)

Mine = NDArray[np.intp] | slice


class Column:
    """One field of many rows, present in each; `size` [bytes], tag included: int, or int64 (m,)."""

    def __init__(self, head: bytes, size: int | Integers) -> None:
        self._head = np.frombuffer(head, np.uint8)
        self.size: int | Integers = size
        if isinstance(size, np.ndarray) and size.size and (size == size[0]).all():
            self.size = int(size[0])

    def size_of(self, mine: Mine) -> int:
        """Return the bytes of the field in the rows `mine`, which have one shape."""
        return self.size if isinstance(self.size, int) else int(self.size[mine][0])

    def put(self, into: Bytes, mine: Mine) -> None:
        """Fill `into`, uint8 (k, size), with the field of the rows `mine`."""
        into[:, : self._head.size] = self._head
        self._value(into[:, self._head.size :], mine)

    def _value(self, into: Bytes, mine: Mine) -> None:
        raise NotImplementedError


class _Doubles(Column):
    def __init__(self, number: int, values: NDArray[np.float64]) -> None:
        head = field_tag(number, FIXED64)
        super().__init__(head, len(head) + 8)
        self._values = values

    def _value(self, into: Bytes, mine: Mine) -> None:
        chosen = np.ascontiguousarray(self._values[mine], dtype="<f8")
        into[:] = chosen.view(np.uint8).reshape(chosen.size, 8)


class _Whole(Column):
    """Integers, and booleans, which are 0 and 1."""

    def __init__(self, number: int, values: Integers) -> None:
        head = field_tag(number, VARINT)
        super().__init__(head, len(head) + varint_lengths(values))
        self._values = values

    def _value(self, into: Bytes, mine: Mine) -> None:
        put_varints(into, self._values[mine])


class _Texts(Column):
    def __init__(self, number: int, values: Sequence[str]) -> None:
        encoded = {text: text.encode() for text in set(values)}
        known = {text: varint(len(data)) + data for text, data in encoded.items()}
        self._values = [known[text] for text in values]
        head = field_tag(number, LENGTH)
        sizes = np.fromiter(map(len, self._values), np.int64, len(self._values))
        super().__init__(head, len(head) + sizes)

    def _value(self, into: Bytes, mine: Mine) -> None:
        chosen = self._values
        if not isinstance(mine, slice):
            chosen = [chosen[i] for i in mine.tolist()]
        into[:] = np.frombuffer(b"".join(chosen), np.uint8).reshape(into.shape)


def columns_of_doubles(
    topic: str, signals: Sequence[Signal], rows: NDArray[np.float64]
) -> list[Column]:
    """Return the columns of rows of doubles, which stand for integers and booleans too.

    `InputError` for a double that is not of its signal's kind.
    """
    columns: list[Column] = []
    for j, signal in enumerate(signals):
        values = np.asarray(rows[:, j], np.float64)
        if signal.kind == "float":
            columns.append(_Doubles(j + 1, values))
            continue
        if signal.kind == "int":
            right = (np.rint(values) == values) & (np.abs(values) < 2.0**63)
        elif signal.kind == "uint":
            right = (np.rint(values) == values) & (values >= 0) & (values < 2.0**64)
        else:
            # any number but zero is true, in C and so in FMI
            right = ~np.isnan(values) & (signal.kind == "bool")
        if not right.all():
            raise InputError(
                "a value of the wrong kind",
                where=f"topic {topic}, signal {signal.name!r}",
                expected=signal.kind,
                got=f"the double {values[~right][0]!r}",
            )
        if signal.kind == "uint":
            whole = values.astype(np.uint64).view(np.int64)
        else:
            whole = (values if signal.kind == "int" else values != 0).astype(np.int64)
        columns.append(_Whole(j + 1, whole))
    return columns


def columns_of_rows(
    signals: Sequence[Signal], rows: Sequence[Sequence[Any]]
) -> list[Column] | None:
    """Return the columns of rows of the signals' kinds; None if a value is absent or unusual."""
    if any(len(row) != len(signals) for row in rows):
        return None
    try:
        return [
            _column(j + 1, signal.kind, values)
            for j, (signal, values) in enumerate(zip(signals, zip(*rows, strict=True), strict=True))
        ]
    except (TypeError, ValueError, OverflowError):
        return None


def _column(number: int, kind: str, values: Sequence[Any]) -> Column:
    if type(None) in set(map(type, values)):
        raise TypeError("a value is absent")
    if kind == "float":
        return _Doubles(number, np.fromiter(map(float, values), np.float64, len(values)))
    if kind == "int":
        return _Whole(number, np.fromiter(map(operator.index, values), np.int64, len(values)))
    if kind == "uint":
        whole = np.fromiter(map(operator.index, values), np.uint64, len(values))
        return _Whole(number, whole.view(np.int64))
    if kind == "bool":
        return _Whole(number, np.fromiter(map(bool, values), np.int64, len(values)))
    if set(map(type, values)) != {str}:
        raise TypeError("a string is expected")
    return _Texts(number, values)
