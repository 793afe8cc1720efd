"""Inequalities of `cosim.hinf.theorems` as cvxpy expressions, for constraints of a user's own.

Slower to build and to solve than `program`, and open: what stands beside them may be anything that
cvxpy knows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cosim.hinf.theorems import Inequality, shapes_of


def variables_of(inequalities: Iterable[Inequality]) -> dict[str, Any]:
    """Return a cvxpy variable for every unknown by its name; its shape follows from the terms."""
    import cvxpy as cp  # noqa: PLC0415 - slow to import, and nothing else here needs it

    return {
        name: cp.Variable() if x.is_number else cp.Variable(x[:2], symmetric=x.symmetric)
        for name, x in shapes_of(inequalities).items()
    }


def in_cvxpy(one: Inequality, unknowns: Mapping[str, Any]) -> Any:
    """Return the matrix that must be positive definite, as an expression in the unknowns.

    Parameters
    ----------
    unknowns : by name, cvxpy variables or expressions, or arrays and numbers.
    """
    size = sum(one.rows.values())
    matrix: Any = np.zeros((size, size))
    for unknown, left, right, weight, is_number in one.terms:
        L, R = left.floats_on(one.rows), right.floats_on(one.rows)
        if unknown is None:
            half: Any = float(weight) * (L.T @ R)
        elif is_number:
            half = unknowns[unknown] * (float(weight) * (L.T @ R))
        else:
            half = L.T @ unknowns[unknown] @ (float(weight) * R)
        matrix = matrix + half + half.T
    return matrix
