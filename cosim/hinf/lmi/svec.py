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


def product(left: Array, right: Array, *, weight: float = 1.0) -> Array:
    """Return the svec columns of `weight` (left'V right + right'V left) by V_ab, a <= b.

    Parameters
    ----------
    left, right : (m, s), for a symmetric V of size m.

    Returns
    -------
    (s (s+1)/2, m (m+1)/2), in the order of `symmetric`.
    """
    m = left.shape[0]
    parts = []
    for a in range(m):
        outer = left[a][None, :, None] * right[a:, None, :]
        outer = outer + right[a][None, :, None] * left[a:, None, :]
        outer[0] /= 2.0  # V_aa stands once, V_ab twice
        parts.append(svec(outer + np.swapaxes(outer, 1, 2)))
    return weight * np.concatenate(parts).T


def products(left: Array, right: Array, *, weight: float = 1.0) -> Array:
    """Return the svec columns of `weight` (left'V right + right'V'left) by V_ab, any V.

    Parameters
    ----------
    left, right : (a, s), (b, s), for V of a rows and b columns.

    Returns
    -------
    (s (s+1)/2, a b), the columns by the entries of V row by row.
    """
    parts = []
    for row in left:
        outer = row[None, :, None] * right[:, None, :]
        parts.append(svec(outer + np.swapaxes(outer, 1, 2)))
    return weight * np.concatenate(parts).T


def symmetric(values: Array, size: int) -> Array:
    """Return the symmetric matrix V whose entries V_ab, a <= b, are `values`."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = values
    return matrix + np.triu(matrix, 1).T
