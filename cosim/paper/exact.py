"""Exact matrices as NumPy arrays of fractions, so that one formula serves proof and solver."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import flint
import numpy as np
from numpy.typing import NDArray

from cosim.hinf.exact import first_bad_pivot

Exact = NDArray[np.object_]
"""A matrix of `Fraction` (and int)."""


def fractions(matrix: Any) -> Exact:
    """Return decimals or doubles as fractions, without rounding."""
    given = np.asarray(matrix, dtype=object)
    return np.array([Fraction(x) for x in given.ravel()], dtype=object).reshape(given.shape)


def decimals(matrix: Any) -> Exact:
    """Return doubles as fractions of their shortest decimals: 0.1 as 1/10."""
    given = np.asarray(matrix, dtype=object)
    return np.array([Fraction(repr(float(x))) for x in given.ravel()], dtype=object).reshape(
        given.shape
    )


class Draw:
    """Draws small random matrices of integers; the same seed gives the same matrices."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def matrix(self, rows: int, columns: int) -> Exact:
        """Return a matrix of integers from -3 to 3."""
        drawn: Exact = self._rng.integers(-3, 4, size=(rows, columns)).astype(object)
        return fractions(drawn)

    def positive(self, n: int) -> Exact:
        """Return a positive definite n x n matrix L L' + I."""
        L = self.matrix(n, n)
        product: Exact = L @ L.T + identity(n)
        return product


def identity(n: int) -> Exact:
    """Return the n x n identity."""
    return fractions(np.eye(n, dtype=int))


def inverse(matrix: Exact) -> Exact:
    """Return the inverse of a regular matrix."""
    inverted: Any = rational_matrix(matrix).inv()
    entries = [fraction(e) for e in inverted.entries()]
    return np.array(entries, dtype=object).reshape(matrix.shape)


def schur(matrix: Exact, keep: int) -> Exact:
    """Return the Schur complement S11 - S12 S22^-1 S21; S11 has the leading `keep` rows."""
    left, right = matrix[:keep, keep:], matrix[keep:, :keep]
    result: Exact = matrix[:keep, :keep] - left @ inverse(matrix[keep:, keep:]) @ right
    return result


def is_positive(matrix: Exact) -> bool:
    """Return whether a symmetric matrix is proved positive definite."""
    rational = rational_matrix(matrix)
    n = matrix.shape[0]
    return first_bad_pivot([[rational[i, j] for j in range(i + 1)] for i in range(n)]) is None


def is_zero(matrix: Exact) -> bool:
    """Return whether every entry is exactly zero."""
    return not any(x != 0 for x in np.asarray(matrix).ravel())


def rational(value: Any) -> Any:
    """Return a number as `flint.fmpq`, the type of the proofs."""
    exact = Fraction(value)
    return flint.fmpq(exact.numerator, exact.denominator)


def rational_matrix(matrix: Exact) -> Any:
    """Return a matrix as `flint.fmpq_mat`, the type of the proofs."""
    rows, columns = matrix.shape
    return flint.fmpq_mat(rows, columns, [rational(x) for x in matrix.ravel()])


def fraction(value: Any) -> Fraction:
    """Return a `flint.fmpq` as a `Fraction`."""
    return Fraction(int(value.p), int(value.q))
