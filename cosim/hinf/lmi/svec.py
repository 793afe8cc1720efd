"""Symmetric matrices as vectors: the upper triangle by columns, off-diagonal entries times sqrt 2.

Inner products are kept, <M, N> = svec(M)'svec(N), and the order is the solver's for the entries
of a semidefinite cone.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@cache
def places(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return rows, columns and factors of the entries of an svec."""
    columns, rows = np.tril_indices(size)  # row by row below is column by column above
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def svec(matrix: Array) -> Array:
    """Return the svec of the last two axes."""
    rows, columns, factors = places(matrix.shape[-1])
    return np.asarray(matrix[..., rows, columns] * factors)


def smat(vector: Array, size: int) -> Array:
    """Return the symmetric matrix of an svec."""
    rows, columns, factors = places(size)
    matrix = np.zeros((size, size))
    matrix[rows, columns] = matrix[columns, rows] = vector / factors
    return matrix
