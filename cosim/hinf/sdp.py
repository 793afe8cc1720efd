"""Semidefinite programs as plain arrays, straight to Clarabel: no modelling layer to rebuild.

A constraint is M(v) = M0 + sum_k v_k M_k >= 0. Symmetric matrices travel as `svec`: the upper
triangle, column after column, off-diagonal entries times sqrt(2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, vstack

Array = NDArray[np.float64]

_USABLE = ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations")
"""Statuses that leave a point worth a proof; the exact proof decides, not the status."""


@dataclass(frozen=True)
class Constraint:
    """M0 + sum_k v_k M_k >= 0: the size of M, svec(M0), and the svec(M_k) side by side."""

    size: int
    constant: Array
    columns: Array

    def at(self, v: Array) -> Array:
        """M(v) as a full matrix."""
        return unsvec(self.constant + self.columns @ v, self.size)

    def less(self, column: Array) -> Constraint:
        """M(v) - t W >= 0 with one more unknown t; `column` is svec(W)."""
        return Constraint(self.size, self.constant, np.column_stack([self.columns, -column]))

    def below(self, bound: float) -> Constraint:
        """Bound I - M(v) >= 0."""
        return Constraint(self.size, bound * svec(np.eye(self.size)) - self.constant, -self.columns)


@cache
def _places(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Rows, columns and factors of an svec."""
    columns, rows = np.tril_indices(size)  # row by row below is column by column above
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def svec(matrix: Array) -> Array:
    """The svec of the last two axes."""
    rows, columns, factors = _places(matrix.shape[-1])
    return np.asarray(matrix[..., rows, columns] * factors)


def unsvec(vector: Array, size: int) -> Array:
    """The symmetric matrix of an svec."""
    rows, columns, factors = _places(size)
    matrix = np.zeros((size, size))
    matrix[rows, columns] = matrix[columns, rows] = vector / factors
    return matrix


def product(left: Array, right: Array, *, weight: float = 1.0) -> Array:
    """Columns of `weight` (left'V right + right'V left) over the entries V_ab, a <= b.

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


def symmetric(values: Array, size: int) -> Array:
    """The matrix V whose entries V_ab, a <= b, are `values`."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = values
    return matrix + np.triu(matrix, 1).T


def minimise(cost: Array, constraints: Sequence[Constraint]) -> Array | None:
    """The point that Clarabel returns; None if it says that there is none, or has none."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1  # the same digits on every machine
    n = cost.size
    solver = clarabel.DefaultSolver(
        csc_matrix((n, n)),
        cost,
        csc_matrix(vstack([csc_matrix(-c.columns) for c in constraints])),
        np.concatenate([c.constant for c in constraints]),
        [clarabel.PSDTriangleConeT(c.size) for c in constraints],
        settings,
    )
    solution = solver.solve()
    point = np.asarray(solution.x, dtype=np.float64)
    if str(solution.status) not in _USABLE or not np.isfinite(point).all():
        return None
    return point
