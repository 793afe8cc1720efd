"""Exact matrices: NumPy arrays of fractions, so that one formula serves proof and solver."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import flint
import numpy as np
from numpy.typing import NDArray

from cosim.hinf import first_bad_pivot

Exact = NDArray[np.object_]
"""A matrix of `Fraction` (and int)."""


def fractions(matrix: Any) -> Exact:
    """Decimals or doubles, exactly as they are."""
    given = np.asarray(matrix, dtype=object)
    return np.array([Fraction(x) for x in given.ravel()], dtype=object).reshape(given.shape)


def decimals(matrix: Any) -> Exact:
    """Doubles as the decimals that they are printed as."""
    given = np.asarray(matrix, dtype=object)
    return np.array([Fraction(repr(float(x))) for x in given.ravel()], dtype=object).reshape(
        given.shape
    )


class Draw:
    """Small matrices with no structure of their own, the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def matrix(self, rows: int, columns: int) -> Exact:
        """Integers from -3 to 3."""
        drawn: Exact = self._rng.integers(-3, 4, size=(rows, columns)).astype(object)
        return fractions(drawn)

    def positive(self, n: int) -> Exact:
        """L L' + I."""
        L = self.matrix(n, n)
        product: Exact = L @ L.T + identity(n)
        return product


def identity(n: int) -> Exact:
    """The n x n identity."""
    return fractions(np.eye(n, dtype=int))


def zeros(rows: int, columns: int) -> Exact:
    """Nothing but zeros."""
    none: Exact = np.zeros((rows, columns), dtype=int).astype(object)
    return none


def inverse(matrix: Exact) -> Exact:
    """Of a regular matrix."""
    inverted: Any = rational_matrix(matrix).inv()
    entries = [fraction(e) for e in inverted.entries()]
    return np.array(entries, dtype=object).reshape(matrix.shape)


def schur(matrix: Exact, keep: int) -> Exact:
    """S11 - S12 S22^-1 S21, S11 the leading `keep` rows."""
    left, right = matrix[:keep, keep:], matrix[keep:, :keep]
    result: Exact = matrix[:keep, :keep] - left @ inverse(matrix[keep:, keep:]) @ right
    return result


def is_positive(matrix: Exact) -> bool:
    """Whether a symmetric matrix is proved positive definite."""
    whole = rational_matrix(matrix)
    n = matrix.shape[0]
    return first_bad_pivot([[whole[i, j] for j in range(i + 1)] for i in range(n)]) is None


def is_zero(matrix: Exact) -> bool:
    """Whether every entry is exactly zero."""
    return not any(x != 0 for x in np.asarray(matrix).ravel())


def mirrored(upper: list[list[Any]]) -> list[list[Any]]:
    """All blocks of a symmetric matrix whose block rows are given from the diagonal on."""
    n = len(upper)
    return [[upper[i][j - i] if j >= i else upper[j][i - j].T for j in range(n)] for i in range(n)]


def rational(value: Any) -> Any:
    """A number as the `flint.fmpq` of the proofs."""
    exact = Fraction(value)
    return flint.fmpq(exact.numerator, exact.denominator)


def rational_matrix(matrix: Exact) -> Any:
    """A matrix as the `flint.fmpq_mat` of the proofs."""
    rows, columns = matrix.shape
    return flint.fmpq_mat(rows, columns, [rational(x) for x in matrix.ravel()])


def fraction(value: Any) -> Fraction:
    """A `flint.fmpq` as a `Fraction`."""
    return Fraction(int(value.p), int(value.q))
