"""Encode many values at once in protobuf's wire format, as arrays of bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

VARINT, FIXED64, LENGTH = 0, 1, 2
"""Wire types: integers and booleans; doubles; strings and messages."""


def field_tag(number: int, wire: int) -> bytes:
    """Return the tag of a field: one byte for numbers up to 15, then two, three."""
    return varint(number << 3 | wire)


def varint(value: int) -> bytes:
    """Encode one unsigned integer."""
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def varint_lengths(values: Integers) -> Integers:
    """Return the number of bytes of each varint: 1 for 0 to 127, ..., 10 for negative values."""
    length = np.ones(values.shape, np.int64)
    rest = values.view(np.uint64) >> np.uint64(7)
    while rest.any():
        length += rest > 0
        rest >>= np.uint64(7)
    return length


def put_varints(into: Bytes, values: Integers) -> None:
    """Fill `into`, (m, length), with varints that all have this length."""
    length = into.shape[1]
    unsigned = values.view(np.uint64)
    for j in range(length):
        more = 0x80 if j < length - 1 else 0
        into[:, j] = (unsigned >> np.uint64(7 * j) & np.uint64(0x7F)) | np.uint64(more)


def equal_rows(shapes: Integers) -> list[NDArray[np.intp]]:
    """Group equal rows of `shapes`, (m, k) and not negative: row numbers, by their entries."""
    sizes = shapes.max(axis=0, initial=0).tolist()
    code, room = np.zeros(len(shapes), np.int64), 1
    for j, size in enumerate(sizes):
        code = code * (size + 1) + shapes[:, j]
        room *= size + 1
    if room > 2**62:  # one number cannot hold them
        _, code = np.unique(shapes, axis=0, return_inverse=True)
    order = np.argsort(code.ravel(), kind="stable")
    ends = np.flatnonzero(np.diff(code.ravel()[order])) + 1
    return np.split(order, ends)
