"""A least gamma that asks for an unbounded gain: one of moderate size is designed in its place."""

from __future__ import annotations

import json

import numpy as np
import pytest
from benchmarks.design_sizes import K_LIMIT, gains_by_cvxpy
from shared import sampled
from varied_systems import steered_chain

from cosim.hinf import analyse, design
from cosim.hinf.certificate import standalone


@pytest.mark.slow
@pytest.mark.parametrize("n", sampled([6, 8], 1))
def test_no_gain_of_cvxpy_is_clearly_better(n: int) -> None:
    """The design is as good as the best of the gains that cvxpy finds, each analysed."""
    found = design(steered_chain(n))
    others = [analyse(steered_chain(n), K).gamma for K in gains_by_cvxpy(n, (0.5, 1.0))[0]]
    best = min(gamma for gamma in others if gamma is not None)
    assert found.gamma is not None
    assert found.gamma <= 1.02 * best
    assert np.abs(found.K).max() < K_LIMIT
    assert standalone.check(json.dumps(dict(found.certificate)).encode())
