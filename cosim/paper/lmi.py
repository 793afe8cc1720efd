"""Blocks of symmetric matrices in fractions, and how Clarabel is asked."""

from __future__ import annotations

import warnings
from typing import Any

import cvxpy as cp
import numpy as np


def mirrored(upper: list[list[Any]]) -> list[list[Any]]:
    """Return all blocks of a symmetric matrix, given its block rows from the diagonal on."""
    n = len(upper)
    return [[upper[i][j - i] if j >= i else upper[j][i - j].T for j in range(n)] for i in range(n)]


def zeros(rows: int, columns: int) -> Any:
    """Return a block of zeros, as integers: they fit fractions."""
    return np.zeros((rows, columns), dtype=int)


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
