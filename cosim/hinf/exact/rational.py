"""Exact numbers: doubles and "p/q" texts as rationals, and a proof of positive definiteness.

Every double is a dyadic rational, a `flint.fmpq` without rounding. A ball (`flint.arb`) is a
number with a radius that encloses the exact value after every operation; a comparison of balls
is true only if it holds for all numbers inside.
"""

from __future__ import annotations

import copyreg
import functools
import math
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import flint

from cosim.core import InputError, format_value
from cosim.models import Matrix

MAX_DIGITS = 2000
"""Longest numerator or denominator read: three times what a product of two doubles needs."""

MAX_ODD_DIGITS = 40
"""Longest denominator read that is no power of two: sums of such fractions grow with each."""

_TEXT = re.compile(rf"(-?[0-9]{{1,{MAX_DIGITS}}})(?:/([0-9]{{1,{MAX_DIGITS}}}))?")
_precision_guard: Final = threading.RLock()
_PRECISIONS = (128, 256, 512, 1024, 2048, 4096)  # bits


def _to_pickle(matrix: Any) -> tuple[Any, ...]:
    return flint.fmpq_mat, (matrix.nrows(), matrix.ncols(), matrix.entries())


copyreg.pickle(flint.fmpq_mat, _to_pickle)  # python-flint pickles numbers, but no matrices


@contextmanager
def ball_precision(bits: int) -> Iterator[None]:
    """Compute with balls of a precision in this context.

    python-flint has one precision for all threads: other contexts wait until this one ends.
    """
    with _precision_guard, flint.ctx.workprec(bits):
        yield


def exact(value: float) -> Any:
    """Convert a finite double to the rational that it is.

    Raises
    ------
    OverflowError, ValueError : for an infinity and for a NaN.
    """
    p, q = float(value).as_integer_ratio()
    return flint.fmpq(p, q)


def exact_matrix(matrix: Matrix) -> Any:
    """Convert a two-dimensional array of finite doubles to a `flint.fmpq_mat`."""
    rows, columns = matrix.shape
    return flint.fmpq_mat(rows, columns, [exact(value) for value in matrix.ravel()])


def exact_symmetric(matrix: Matrix) -> Any:
    """Convert a square array of finite doubles as `exact_matrix`, then symmetrise it exactly."""
    rational = exact_matrix(matrix)
    return (rational + rational.transpose()) / 2


def to_text(value: Any) -> str:
    """Return a rational as "p/q" in lowest terms, or "p"."""
    return str(value)


def from_text(text: Any, where: str) -> Any:
    """Read the rational that `to_text` wrote.

    Raises
    ------
    InputError : if `text` is no "p/q" string of decimal integers, or a longer one than any this
        project writes: the cost of what follows stays bounded.
    """
    match = _TEXT.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        raise InputError(
            "not an exact number",
            where=where,
            expected=f'a string "p" or "p/q" of integers with at most {MAX_DIGITS} digits each',
            got=format_value(text),
        )
    p, q = flint.fmpz(match[1]), flint.fmpz(match[2] or "1")
    if q == 0:
        raise InputError(
            "a denominator is zero", where=where, expected="p/q", got=format_value(text)
        )
    if len(match[2] or "") > MAX_ODD_DIGITS and q & (q - 1) != 0:
        raise InputError(
            "a long denominator is no power of two",
            where=where,
            expected=f"a power of two, or at most {MAX_ODD_DIGITS} digits",
            got=f"{len(match[2])} digits",
        )
    return flint.fmpq(p, q)


def matrix_to_text(value: Any) -> list[list[str]]:
    """Return a `flint.fmpq_mat` as rows of "p/q"."""
    return [[to_text(value[i, j]) for j in range(value.ncols())] for i in range(value.nrows())]


def matrix_from_text(rows: Any, where: str, height: int, width: int) -> Any:
    """Read the matrix that `matrix_to_text` wrote.

    Raises
    ------
    InputError : if it has another shape, or an entry is no "p/q".
    """
    fits = (
        isinstance(rows, list)
        and len(rows) == height
        and all(isinstance(row, list) and len(row) == width for row in rows)
    )
    if not fits:
        raise InputError(
            "wrong shape", where=where, expected=f"{height} rows of {width} numbers as p/q"
        )
    entries = [
        from_text(entry, f"{where}[{i}][{j}]")
        for i, row in enumerate(rows)
        for j, entry in enumerate(row)
    ]
    return flint.fmpq_mat(height, width, entries)


def identity(n: int) -> Any:
    """Return the n x n identity as a new `flint.fmpq_mat`."""
    return flint.fmpq_mat(_identity(n))  # whoever writes to it changes no other proof


@functools.cache
def _identity(n: int) -> Any:
    return flint.fmpq_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def asymmetric(matrices: Iterable[tuple[str, Any]]) -> str | None:
    """Return the name of the first square `flint.fmpq_mat` that is not symmetric, or None."""
    return next((name for name, one in matrices if one != one.transpose()), None)


def lower_triangle(
    names: Sequence[str], sizes: dict[str, int], blocks: dict[tuple[str, str], Any]
) -> list[list[Any]]:
    """Return the lower triangle, row by row, of the symmetric matrix with these blocks.

    `blocks` has a `flint.fmpq_mat` per pair (row, column) with row not after column in `names`;
    absent pairs are zero.
    """
    zero = flint.fmpq(0)
    rows: list[list[Any]] = []
    for i, row in enumerate(names):
        for a in range(sizes[row]):
            entries: list[Any] = []
            for column in names[: i + 1]:
                block = blocks.get((column, row))
                entries += (
                    [zero] * sizes[column]
                    if block is None
                    else [block[b, a] for b in range(sizes[column])]
                )
            rows.append(entries[: len(rows) + 1])
    return rows


def first_bad_pivot(lower: Sequence[Sequence[Any]]) -> int | None:
    """Prove a symmetric matrix positive definite: None, or the index of the first bad pivot.

    Elimination without pivoting, A = L diag(p) L', in balls. If every ball p_k lies right of
    zero, then so do the exact pivots inside them (each is defined, because the ones before
    it are not zero), and a symmetric matrix with positive pivots is positive definite. If a
    ball contains zero, the precision is doubled; a matrix still undecided at 4096 bits (almost
    certainly singular) counts as not proved.

    Parameters
    ----------
    lower : row i has the i+1 rational entries up to the diagonal.
    """
    bad: int | None = None
    for bits in _PRECISIONS:
        with ball_precision(bits):
            bad, decided = _eliminate([[flint.arb(entry) for entry in row] for row in lower])
        if decided:
            break
    return bad


def _eliminate(rows: list[list[Any]]) -> tuple[int | None, bool]:
    """Return the first pivot not proved positive, or None, and whether that is decided."""
    n = len(rows)
    for k in range(n):
        pivot = rows[k][k]
        if not pivot > 0:
            return k, bool(pivot <= 0)
        column = [(i, rows[i][k]) for i in range(k + 1, n) if not rows[i][k] == 0]  # noqa: SIM201 - `!=` of balls says "surely different"
        for place, (i, entry) in enumerate(column):
            row, factor = rows[i], entry / pivot
            for j, other in column[: place + 1]:
                row[j] -= factor * other
    return None, True


def first_bad_matrix(matrices: Iterable[tuple[str, Any]]) -> str | None:
    """Return the name of the first `flint.fmpq_mat` not proved positive definite, or None."""
    for name, matrix in matrices:
        n = matrix.nrows()
        if first_bad_pivot([[matrix[i, j] for j in range(i + 1)] for i in range(n)]) is not None:
            return name
    return None


def norm_is_below(matrix: Any, bound: Any) -> bool:
    """Prove |matrix| < bound, the 2-norm of a `flint.fmpq_mat` and a `flint.fmpq` >= 0."""
    rest = bound * bound * identity(matrix.nrows()) - matrix * matrix.transpose()
    return first_bad_matrix([("rest", rest)]) is None


def root_above(square: float, is_enough: Callable[[Any], bool]) -> float:
    """Return sqrt(square) rounded up to seven digits, raised until its exact value is enough."""
    root = math.sqrt(max(square, 0.0))
    value = rounded_up(root) if root > 0 else 0.0
    while not is_enough(exact(value)):
        value = value * (1 + 1e-12) or math.ulp(0.0)
    return value


def rounded_up(value: float) -> float:
    """Round a positive number up to seven significant digits."""
    digits = 6 - math.floor(math.log10(value))
    return float(math.ceil(value * 10**digits) / 10**digits)
