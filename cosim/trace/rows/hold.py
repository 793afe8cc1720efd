"""Sample and hold: the value in force at an instant.

It is the last one delivered up to that instant; of several at one instant, the last in the file.
Everything that puts rows of different times side by side uses these functions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


def rows_in_force(times_ns: Integers, at_ns: Integers) -> Integers:
    """Return the number of the row in force at each instant, int64 (n,); -1 before the first.

    times_ns : of the rows [ns], (m,), in any order; of equal times the later row counts.
    """
    if (np.diff(times_ns) < 0).any():
        order = np.argsort(times_ns, kind="stable")
        return np.append(order, -1)[np.searchsorted(times_ns[order], at_ns, side="right") - 1]
    return np.searchsorted(times_ns, at_ns, side="right") - 1


def sample_and_hold(values: NDArray[Any], rows: Integers) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return the values of `rows_in_force`, and where there is one.

    Where there is none, the value is NaN, 0, False or "", as in a `Table`.
    """
    padded = np.append(values, blanks(values.dtype, 1))
    return padded[rows], rows >= 0  # row -1, before the first, is the blank at the end


def interpolated(
    values: NDArray[np.float64], times_ns: Integers, at_ns: Integers
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return values on the straight lines between rows, and where there is one.

    There is none before the first row; after the last one it is in force. At an instant with two
    rows, where a signal jumps, the line before it leads to the first, and the second is in force.

    times_ns : of the rows [ns], (m,), in any order.
    """
    if not times_ns.size:
        return np.full(at_ns.size, np.nan), np.zeros(at_ns.size, np.bool_)
    order = np.argsort(times_ns, kind="stable")
    times, ordered = times_ns[order], values[order]
    row = np.searchsorted(times, at_ns, side="right") - 1
    there = row >= 0
    before, after = np.maximum(row, 0), np.minimum(row + 1, times.size - 1)
    length = times[after] - times[before]
    share = (at_ns - times[before]) / np.where(length > 0, length, 1)
    lines = ordered[before] + np.where(length > 0, share, 0.0) * (ordered[after] - ordered[before])
    return np.where(there, lines, np.nan), there


def blanks(dtype: Any, count: int) -> NDArray[Any]:
    """Return a column of absent values: NaN, 0, False or "" by its type, (count,)."""
    kind = np.dtype(dtype).kind
    return np.full(count, {"f": np.nan, "O": ""}.get(kind, 0), dtype)
