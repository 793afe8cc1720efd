"""One way to ask the solver; what it says is held to a proof afterwards, or is a sign alone."""

from __future__ import annotations

import warnings
from typing import Any

import cvxpy as cp


def solve(goal: Any, bounds: list[Any]) -> bool:
    """Whether the problem came back with values, accurate or not."""
    problem = cp.Problem(goal, bounds)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
        except cp.SolverError:
            return False
    return problem.status in {cp.OPTIMAL, cp.OPTIMAL_INACCURATE}
