"""Sample and hold: what was in force at an instant.

A run holds what was sent or delivered last until something newer comes; of several at the same
instant, the last in the file holds. So does everything here that puts rows of different times
side by side.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


def rows_in_force(times_ns: Integers, at_ns: Integers) -> Integers:
    """Number of the row in force at each instant, int64 (n,); -1 before the first.

    times_ns : of the rows, (m,), in any order; of equal times the later row counts.
    """
    if (np.diff(times_ns) < 0).any():
        order = np.argsort(times_ns, kind="stable")
        return np.append(order, -1)[np.searchsorted(times_ns[order], at_ns, side="right") - 1]
    return np.searchsorted(times_ns, at_ns, side="right") - 1


def sample_and_hold(values: NDArray[Any], rows: Integers) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Values in force, and where there were any; as `Table`, blanks are NaN, 0, False or "".

    rows : as `rows_in_force` gives them.
    """
    there = rows >= 0
    blank: Any = {"f": np.nan, "O": ""}.get(values.dtype.kind, 0)
    padded = np.append(values, np.array([blank], values.dtype))
    return padded[np.where(there, rows, values.size)], there
