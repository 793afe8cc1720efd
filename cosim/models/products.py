"""Sums and products in one stated order of operations, term by term from the left.

`sum` of floats is no such thing: it starts from the integer 0 and, from Python 3.12 on,
carries a correction, so the last bits would depend on the interpreter, and on whether the
equation runs in Python or as the C made from it. Standard library only: this file also
travels inside the FMU.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add
from typing import Any

Matrix = Sequence[Sequence[Any]]


def total(terms: Iterable[Any]) -> Any:
    """((t_1 + t_2) + t_3) + ...; 0.0 without terms."""
    listed = list(terms)
    return reduce(add, listed) if listed else 0.0


def product(matrix: Matrix, vector: Sequence[Any]) -> list[Any]:
    """matrix @ vector; a matrix without rows gives no entries, one without columns zeros."""
    return [total(a * b for a, b in zip(row, vector, strict=True)) for row in matrix]
