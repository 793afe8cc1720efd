"""A least gamma that asks for an unbounded gain: one of moderate size is designed in its place."""

from __future__ import annotations

import json

import cvxpy as cp
import numpy as np
import pytest
from varied_systems import steered_chain

from cosim.hinf import analyse, as_cvxpy, design
from cosim.hinf.certificate import standalone

K_LIMIT = 1e3
"""Size of a gain, in the units of the chain, that somebody would still fly."""


def gains_by_cvxpy(n: int) -> list[np.ndarray]:
    """Gains as a user of cvxpy finds them: the LMI of Theorem 2 with a weight on Y."""
    found = []
    for k in (0.5, 1.0):
        asked = as_cvxpy(steered_chain(n), (-k,), (k,))
        for weight in (0.0, 0.01, 0.1):
            price = weight * cp.norm(asked.Y, "fro")
            problem = cp.Problem(cp.Minimize(asked.gamma + price), asked.problem.constraints)
            problem.solve(solver="CLARABEL")
            if problem.status == "optimal":
                found.append(np.linalg.solve(asked.X.value, asked.Y.value.T).T)
    return [K for K in found if np.abs(K).max() < K_LIMIT]


@pytest.mark.parametrize("n", [6, 8])
def test_no_gain_of_cvxpy_is_clearly_better(n: int) -> None:
    """The design is as good as the best of the gains that cvxpy finds, each analysed."""
    found = design(steered_chain(n))
    others = [analyse(steered_chain(n), K).gamma for K in gains_by_cvxpy(n)]
    best = min(gamma for gamma in others if gamma is not None)
    assert found.gamma is not None
    assert found.gamma <= 1.02 * best
    assert np.abs(found.K).max() < K_LIMIT
    assert standalone.check(json.dumps(dict(found.certificate)).encode())
