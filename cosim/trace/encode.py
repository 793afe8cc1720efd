"""Rows of values to protobuf bytes."""

from __future__ import annotations

import operator
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.trace.layout import field_names

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cosim.trace.layout import Signal

_FIXED64 = 1  # protobuf wire type of a double


def tag(number: int) -> bytes:
    """Wire tag of a double with this field number: one byte up to 15, then two, three."""
    value = number << 3 | _FIXED64
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a string is expected")
    return value


_CONVERT: dict[str, Callable[[Any], Any]] = {
    "float": float,
    "int": operator.index,  # int() would cut 2.7 down to 2 and say nothing
    "bool": bool,
    "string": _text,
}


class RowEncoder:
    """Encodes the rows of one topic.

    A row of doubles with no value absent is tag, value, tag, value, ... with every field
    present, hence of a fixed length: one `struct` call writes it, ten times faster than a
    protobuf message object, and the reader takes all rows at once as one NumPy array. Other
    rows go through the message class.
    """

    def __init__(self, topic: str, signals: Sequence[Signal], message: type[Any]) -> None:
        self._topic = topic
        self._signals = tuple(signals)
        self._fields = field_names([signal.name for signal in signals])
        self._message = message
        tags = self._tags = [tag(i + 1) for i in range(len(signals))]
        self._doubles = all(signal.kind == "float" for signal in signals)
        self._packer = struct.Struct("<" + "".join(f"{len(t)}sd" for t in tags))
        self._parts: list[Any] = [part for t in tags for part in (t, 0.0)]

    def __call__(self, values: Sequence[Any]) -> bytes:
        """Bytes of one row; None is absent.

        Raises
        ------
        InputError : the wrong number of values, or one of the wrong kind.
        """
        if len(values) != len(self._signals):
            raise InputError(
                "wrong number of values",
                where=f"topic {self._topic}",
                expected=str(len(self._signals)),
                got=str(len(values)),
            )
        if self._doubles:
            self._parts[1::2] = values
            try:
                return self._packer.pack(*self._parts)
            except struct.error:  # a value is absent, or no number: the general way tells which
                pass
        return self._general(values)

    @property
    def fixed(self) -> bool:
        """Whether every row is doubles, and so of one length."""
        return self._doubles

    def many(self, rows: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Bytes of many rows of doubles, (m, signals) to (m, bytes); only where `fixed`.

        Raises
        ------
        InputError : the wrong number of values in a row.
        """
        if rows.ndim != 2 or rows.shape[1] != len(self._signals):
            raise InputError(
                "wrong number of values",
                where=f"topic {self._topic}",
                expected=f"rows of {len(self._signals)}",
                got=f"shape {rows.shape}",
            )
        layout = [
            (f"{kind}{i}", form)
            for i, t in enumerate(self._tags)
            for kind, form in (("t", f"S{len(t)}"), ("v", "<f8"))
        ]
        lines = np.zeros(len(rows), np.dtype(layout))
        for i, t in enumerate(self._tags):
            lines[f"t{i}"] = t
            lines[f"v{i}"] = rows[:, i]
        return lines.view(np.uint8).reshape(len(rows), lines.dtype.itemsize)

    def _general(self, values: Sequence[Any]) -> bytes:
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
