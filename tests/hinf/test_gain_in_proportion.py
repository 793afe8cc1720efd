"""A least gamma that asks for an unbounded gain: one of moderate size is designed in its place."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from benchmarks.design_sizes import K_LIMIT, gains_by_cvxpy
from shared import sampled
from varied_systems import steered_chain, varied_system

from cosim.hinf import analyse, design
from cosim.hinf.certificate import standalone
from cosim.hinf.lmi import Problem
from cosim.hinf.theorems import Scalars


@pytest.mark.slow
@pytest.mark.parametrize(("n", "late", "price"), sampled([(6, 0.1, 0.3), (8, 0.3, 0.1)], 1))
def test_no_gain_of_cvxpy_is_clearly_better(n: int, late: float, price: float) -> None:
    """The design is as good as the best of the gains that cvxpy finds, each analysed."""
    system = steered_chain(n, late, price)
    found = design(system)
    others = [analyse(system, K).gamma for K in gains_by_cvxpy(system, (0.5, 1.0))[0]]
    best = min(gamma for gamma in others if gamma is not None)
    assert found.gamma is not None
    assert found.gamma <= 1.01 * best
    assert np.abs(found.K).max() < K_LIMIT
    assert standalone.check(json.dumps(dict(found.certificate)).encode())


def test_a_search_ends_where_its_best_gain_is_out_of_all_proportion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Along k1 = -k2 the gain only grows: few solves, and none of a point that was solved."""
    asked: list[tuple[float, ...]] = []
    least_gamma = Problem.least_gamma

    def counted(problem: Problem, p: Scalars, *rest: Any) -> Any:
        asked.append((*p.k1, *p.k2))
        return least_gamma(problem, p, *rest)

    monkeypatch.setattr(Problem, "least_gamma", counted)
    found = design(steered_chain(8))
    assert found.certified
    assert len(asked) == len(set(asked)) < 12


@pytest.mark.parametrize(("seed", "before"), [(6, 14.69772), (21, 4.618161)])
def test_the_gain_of_a_small_system_is_improved_from_its_own_multipliers(
    seed: int, before: float
) -> None:
    """Less gamma than by the search for k1, k2 and the analysis of its gain, and proved."""
    found = design(varied_system(seed))
    assert found.gamma is not None
    assert found.gamma < 0.99 * before
    assert standalone.check(json.dumps(dict(found.certificate)).encode())
    again = analyse(varied_system(seed), found.K).gamma
    assert again == found.gamma


def test_a_proof_stands_where_no_better_gain_can_be_computed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Numbers that leave the range of doubles end the improvement, not the design."""

    def overflows(*_: object) -> None:
        raise FloatingPointError("overflow")

    monkeypatch.setattr("cosim.hinf.synthesis.routes.improved_gain", overflows)
    assert design(varied_system(6)).certified
