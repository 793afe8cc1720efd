"""Sums of complete rows, by which a process sees whether another one has altered them since.

The sum of rows is that of the bits of every output times an odd number of its column, times an odd
number of its row, modulo 2**64. The numbers of the columns are those that come out where pairs of
columns are added up, and the sums again: the loop needs no products, which would cost more than
all else it does to complete a row. The loop adds each row as soon as it is complete (`Table.word`),
the reader adds the rows as it finds them; inputs are copies of outputs and do not count.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_MODULUS: Final = 1 << 64
_SIGN: Final = 1 << 63


@cache
def column_weights(outputs: int) -> NDArray[np.uint64]:
    """Return the number of each column, (outputs,)."""
    pair, second = np.divmod(np.arange(outputs, dtype=np.int64), 2)
    weights: NDArray[np.int64] = 4 * (outputs // 2 - 1 - pair) + 1 + 2 * second
    weights[outputs // 2 * 2 :] = 2 * outputs - 1  # of the one without a second
    numbers = weights.astype(np.uint64)
    numbers.setflags(write=False)
    return numbers


def sum_of_rows(rows: Any, outputs: int, first: int, last: int) -> int:
    """Return the sum of rows first to last - 1, as a signed integer of 64 bits."""
    if first >= last:
        return 0
    bits = np.ascontiguousarray(rows[first:last, :outputs]).view(np.uint64)
    of_rows = 2 * np.arange(first, last, dtype=np.uint64) + np.uint64(1)
    return signed(int((bits @ column_weights(outputs) * of_rows).sum(dtype=np.uint64)))


def signed(total: int) -> int:
    """Return a sum modulo 2**64 as a signed integer of 64 bits."""
    return (total + _SIGN) % _MODULUS - _SIGN
