"""Lay out ROS 2 messages in CDR (OMG DDSI-RTPS, XCDR1, little endian), many at a time.

A value stands at a multiple of its size, counted from behind the four bytes that name the encoding.
Messages of one type whose texts have the same lengths have all values at the same places: they are
copies of one, with columns filled in.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.file.block import HEAD

Bytes = NDArray[np.uint8]

_ENCODING = b"\x00\x01\x00\x00"
"""CDR, little endian; no options."""


class Message:
    """A message laid out value by value, in the order of its definition."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._places: dict[str, tuple[int, str]] = {}

    def value(self, form: str, value: float = 0, *, column: str | None = None) -> Message:
        """Add a number, `form` as in `struct`; `column` : name under which it can be filled in."""
        size = struct.calcsize(f"<{form}")
        self._data += bytes(-len(self._data) % size)
        if column is not None:
            self._places[column] = len(self._data), form
        self._data += struct.pack(f"<{form}", value)
        return self

    def values(self, form: str, columns: str) -> Message:
        """Add numbers that are filled in, their names separated by blanks."""
        for column in columns.split():
            self.value(form, column=column)
        return self

    def text(self, text: str) -> Message:
        """Add a text: its length, its bytes and a zero."""
        data = text.encode() + b"\0"
        self.value("I", len(data))
        self._data += data
        return self

    def stamp(self, column: str = "") -> Message:
        """Add an instant: whole seconds and nanoseconds."""
        return self.value("i", column=f"{column}sec").value("I", column=f"{column}nanosec")

    def header(self, frame: str) -> Message:
        """Add a std_msgs/Header."""
        return self.stamp().text(frame)

    def filled(self, count: int, columns: Mapping[str, Any]) -> Bytes:
        """Return so many messages, uint8 (count, room + size), with room for a record's head.

        columns : values (count,) by name, or one for all; what is not named stays as it is.
        """
        whole = np.frombuffer(bytes(HEAD.size) + _ENCODING + self._data, np.uint8)
        lines = np.tile(whole, (count, 1))
        for name, values in columns.items():
            at, form = self._places[name]
            into: NDArray[Any] = np.ndarray(
                (count,),
                f"<{_NUMPY[form]}",
                lines,
                HEAD.size + len(_ENCODING) + at,
                (lines.shape[1],),
            )
            into[:] = values
        return lines


_NUMPY = {"d": "f8", "q": "i8", "i": "i4", "I": "u4", "B": "u1"}
