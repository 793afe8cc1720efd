"""Linear matrix inequalities handed to Clarabel as they stand, without a modelling layer.

    minimise q'y   subject to   S_k = C_k - sum_i y_i A_ki >= 0,   k = 1, 2, ...

with the dual   maximise -sum_k <C_k, Z_k>   subject to   <A_i, Z> = -q_i,  Z_k >= 0.

A cone's rows are the upper triangle of the matrix, column by column, off-diagonal entries
times sqrt(2), so that inner products stay what they are. The solver's word is no proof: what
counts is what the exact certificate makes of the solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Status = Literal["solved", "inaccurate", "infeasible", "failed"]

_STATUS: dict[str, Status] = {
    "Solved": "solved",
    "AlmostSolved": "inaccurate",
    "InsufficientProgress": "inaccurate",
    "MaxIterations": "inaccurate",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
}


@dataclass(frozen=True)
class Cone:
    """C - sum_i y_i A_i >= 0 of one size.

    C : (N, N) symmetric.
    unknowns : indices of the y that take part.
    stacked : (len(unknowns) N, N) sparse, their A_i one below the other.
    """

    C: Array
    unknowns: NDArray[np.int64]
    stacked: sparse.csr_array

    @property
    def flat(self) -> sparse.csr_array:
        """(len(unknowns), N^2): each A_i as a row."""
        n = self.C.shape[0]
        return sparse.csr_array(self.stacked.reshape((len(self.unknowns), n * n)))


@dataclass(frozen=True)
class Solution:
    """What the solver ends with.

    status : `infeasible` only with multipliers that show it.
    y : the unknowns; the last iterate unless solved.
    value : q'y.
    Z : one multiplier per cone; where `infeasible`, -sum <C, Z> = 1 and <A_i, Z> about 0.
    """

    status: Status
    y: Array
    value: float
    Z: tuple[Array, ...]


def solve(cones: Sequence[Cone], q: Array) -> Solution:
    """Minimise q'y over the cones."""
    parts, right, kinds = [], [], []
    for cone in cones:
        n = cone.C.shape[0]
        row, column, scale = _triangle(n)
        entries = cone.flat[:, row * n + column].multiply(scale).T.tocoo()
        shape = (len(row), len(q))
        moved = (entries.data, (entries.row, cone.unknowns[entries.col]))
        parts.append(sparse.coo_array(moved, shape=shape))
        right.append(cone.C[row, column] * scale)
        kinds.append(clarabel.PSDTriangleConeT(n))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    settings.max_threads = 1  # the last digits must not depend on how many there are
    nothing = sparse.csc_matrix((len(q), len(q)))
    A = sparse.csc_matrix(sparse.vstack(parts))
    b = np.concatenate(right)
    found = clarabel.DefaultSolver(nothing, q, A, b, kinds, settings).solve()
    y, z = np.array(found.x), np.array(found.z)
    status = _STATUS.get(str(found.status), "failed")
    if not (np.isfinite(y).all() and np.isfinite(z).all()):
        status = "failed"
    if status == "infeasible":
        z = z / max(-float(b @ z), 1e-300)
    Z, start = [], 0
    for cone in cones:
        n = cone.C.shape[0]
        size = n * (n + 1) // 2
        Z.append(_matrix(z[start : start + size], n))
        start += size
    return Solution(status, y, float(q @ y), tuple(Z))


def _triangle(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Rows, columns and scale of the upper triangle, column by column."""
    low, high = np.tril_indices(n)
    return high, low, np.where(low == high, 1.0, np.sqrt(2.0))


def _matrix(values: Array, n: int) -> Array:
    row, column, scale = _triangle(n)
    matrix = np.zeros((n, n))
    matrix[row, column] = values / scale
    matrix[column, row] = values / scale
    return matrix
