"""Sums and products in a fixed order of operations, term by term from the left.

Python's `sum` starts from the integer 0 and, from 3.12 on, compensates rounding, so that the
last bits would depend on the interpreter, and differ from those of the generated C. Standard
library only: this file is also part of the FMU.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add
from typing import Any

Matrix = Sequence[Sequence[Any]]


def total(terms: Iterable[Any]) -> Any:
    """Return ((t_1 + t_2) + t_3) + ...; 0.0 without terms."""
    listed = list(terms)
    return reduce(add, listed) if listed else 0.0


def product(matrix: Matrix, vector: Sequence[Any]) -> list[Any]:
    """Return matrix @ vector; without rows it is empty, without columns zeros."""
    return [total(a * b for a, b in zip(row, vector, strict=True)) for row in matrix]
