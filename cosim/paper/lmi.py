"""LMIs that are written once, as blocks, for fractions (proof) and for cvxpy (solver)."""

from __future__ import annotations

import warnings
from typing import Any

import cvxpy as cp
import numpy as np


def mirrored(upper: list[list[Any]]) -> list[list[Any]]:
    """Return all blocks of a symmetric matrix, given its block rows from the diagonal on."""
    n = len(upper)
    return [[upper[i][j - i] if j >= i else upper[j][i - j].T for j in range(n)] for i in range(n)]


def symmetric_expression(upper: list[list[Any]]) -> Any:
    """Return the cvxpy expression of a symmetric matrix, given its block rows as `mirrored`."""
    expression: Any = cp.bmat(mirrored(upper))  # type: ignore[attr-defined]  # re-exported by a wildcard
    return (expression + expression.T) / 2


def zeros(rows: int, columns: int) -> Any:
    """Return a block of zeros, as integers: they fit fractions and cvxpy."""
    return np.zeros((rows, columns), dtype=int)


def unit_block(size: int) -> Any:
    """Return an identity block, as integers."""
    return np.eye(size, dtype=int)


def solve(goal: Any, bounds: list[Any]) -> bool:
    """Solve with Clarabel; return whether values came back, accurate or not."""
    problem = cp.Problem(goal, bounds)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
        except cp.SolverError:
            return False
    return problem.status in {cp.OPTIMAL, cp.OPTIMAL_INACCURATE}
