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


def blanks(dtype: Any, count: int) -> NDArray[Any]:
    """Return a column of absent values: NaN, 0, False or "" by its type, (count,)."""
    kind = np.dtype(dtype).kind
    return np.full(count, {"f": np.nan, "O": ""}.get(kind, 0), dtype)
