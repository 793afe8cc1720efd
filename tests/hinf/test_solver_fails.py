"""A solver that fails has not shown that there is no solution: what each route says then."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from broken_solvers import break_all, break_clarabel
from cli.shell import cosim
from shared import sampled

from cosim.core import NotAchievableError
from cosim.hinf import (
    Result,
    analyse,
    auv_system,
    certified_delay,
    check_certificate,
    design,
    greatest_delay,
)
from cosim.hinf.lmi import (
    FAILED,
    Constraint,
    Solution,
    not_found,
    proved_peak_control,
    solve,
    solver_words,
    widest_margin,
)
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2, design_constraints_of, with_delays
from cosim.hinf.synthesis import checked_scalars, proved_decay
from cosim.models import paper_example

PRINTED = [list(paper_example.PRINTED_K)]
AT = ((0.6,), (0.2,))
NEVER = ("has no solution", "cannot be", "not feasible", "does not exist", "there is no")
"""What may only be said with a proof."""


@pytest.fixture(params=["NumericalError", "MaxIterations", "InsufficientProgress", "AlmostSolved"])
def status(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Clarabel stops at zero and says so with this status; the dense solver gets stuck."""
    break_all(monkeypatch, request.param)
    return str(request.param)


ROUTES: dict[str, Callable[[], Any]] = {
    "least gamma": lambda: design(
        paper_example.system(), *AT, order=None, search=False, alternatives=False
    ),
    "every route": lambda: design(paper_example.system(), *AT, alternatives=False),
    "a gamma": lambda: design(paper_example.system(), *AT, gamma=6.0, alternatives=False),
    "a gain": lambda: design(paper_example.system(), *AT, gain=PRINTED, alternatives=False),
    "searched": lambda: design(paper_example.system(), alternatives=False),
    "order 1": lambda: design(paper_example.system(), *AT, order=1, alternatives=False),
    "order 1, a gamma": lambda: design(
        paper_example.system(), *AT, order=1, gamma=6.0, alternatives=False
    ),
    "order 1, a gain": lambda: design(
        paper_example.system(), *AT, order=1, gain=PRINTED, alternatives=False
    ),
    "gain limit": lambda: design(paper_example.system(), *AT, gain_limit=2.0, alternatives=False),
    "decay": lambda: design(paper_example.system(), *AT, decay=1.0, alternatives=False),
    "peak": lambda: design(
        paper_example.system(), *AT, peak_control=3.0, offset=(1.0, 0.0), alternatives=False
    ),
    "delay": lambda: greatest_delay(paper_example.system(), 6.0, *AT),
    "delay, searched": lambda: greatest_delay(paper_example.system(), 6.0),
    "delay, order 1": lambda: greatest_delay(paper_example.system(), 6.0, *AT, order=1),
}


@pytest.mark.parametrize("route", sampled(ROUTES, 1))
def test_a_failure_is_never_called_no_solution(route: str, status: str) -> None:
    """The solver's status is named, other ways are, and nothing is claimed of the problem."""
    with pytest.raises(NotAchievableError) as refused:
        ROUTES[route]()
    error = refused.value
    assert (error.exit_code, error.certificate) == (5, None)
    text = str(error)
    assert not [words for words in NEVER if words in text]
    if status == "NumericalError":  # of the others there is a point, which the proof refuses
        assert f"{FAILED} (status {status}" in text
        assert "before it found or excluded a solution" in text
        assert error.hint
    if route == "least gamma" and status == "NumericalError":
        assert "units" in str(error.hint)


@pytest.mark.parametrize("order", [0, 1])
def test_an_analysis_is_not_certified_because_the_solver_failed(order: int, status: str) -> None:
    """Not certified is a result; its reason is the solver's, not the loop's."""
    found: list[Result] = [
        analyse(paper_example.system(), PRINTED, order=order),
        certified_delay(paper_example.system(), PRINTED, 6.0, order=order).result,
    ]
    for one in found:
        assert not one.certified
        assert one.reason is not None
        assert not [words for words in NEVER if words in one.reason]
        if status == "NumericalError":
            assert f"{FAILED} (status {status}" in one.reason


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("clarabel", ["NumericalError", "AlmostSolved"])
def test_what_clarabel_does_not_solve_the_dense_solver_tries_again(
    clarabel: str, order: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small analysis does not hang on one solver: the same gamma is proved."""
    usual = analyse(paper_example.system(), PRINTED, order=order)
    break_clarabel(monkeypatch, clarabel)
    found = analyse(paper_example.system(), PRINTED, order=order)
    assert found.certified
    assert found.gamma == pytest.approx(usual.gamma, rel=1e-3)


def test_constrained_design_reports_a_solver_failure(status: str) -> None:
    """Decay and the peak of the control, of a gain that is given."""
    system, K = paper_example.system(), np.array(PRINTED)
    p = checked_scalars(system, *AT)
    design_constraints = design_constraints_of(system, peak_control=3.0, offset=(1.0, 0.0))
    for found, reason in (
        proved_decay(system, K, 1.0, p),
        proved_peak_control(system, K, design_constraints, [p]),
    ):
        assert found is None
        assert not [words for words in NEVER if words in reason]
        if status == "NumericalError":
            assert f"{FAILED} (status {status}" in reason


@pytest.mark.slow
def test_the_vehicle_at_half_a_second_and_three(tmp_path: Path) -> None:
    """Nothing is certified at these k1, k2: exit 5, no claim; with a gamma that is proved."""
    late = with_delays(auv_system(), [0.5, 3.0])
    with pytest.raises(NotAchievableError) as failed:
        design(late, DEFAULT_K1, DEFAULT_K2, order=None, search=False, alternatives=False)
    # which of the two it says at a gamma of millions depends on last digits; neither is a claim
    undecided = (
        "which does not prove that there is none",
        "before it found or excluded a solution",
    )
    assert any(words in str(failed.value) for words in undecided)
    with pytest.raises(NotAchievableError, match="meets the design constraints") as constrained:
        design(
            *(late, DEFAULT_K1, DEFAULT_K2),
            gain_limit=0.01,
            search=False,
            alternatives=False,
        )
    assert "none of 4 starts led to a proof" in str(constrained.value)
    refused = cosim(
        *("design", "auv", "--delays", "0.5,3.0", "--gamma", "20", "--order", "theorem-2"),
        *("--save-refutation", "r.json", "--json"),
        cwd=tmp_path,
    ).error
    assert "gamma = 20 cannot be reached by Theorem 2" in refused["what"]
    proof = check_certificate(json.loads((tmp_path / "r.json").read_text("utf-8")))
    assert proof.valid
    assert proof.claim["gamma"] == "20"


def test_a_point_with_a_margin_is_tried_though_the_solver_fails() -> None:
    """Whatever it says of its last point: the proof decides. A point without one is left."""

    def failing(constraints: Any, q: Any, *, tolerance: float) -> Solution:
        return replace(solve(constraints, q, tolerance=tolerance), status="failed")

    above = Constraint(1, np.zeros(1), np.ones((1, 1)))  # y >= 0, and y at most the bound
    found = widest_margin([above], [above], 1e3, solver=failing)
    assert found is not None
    assert found[0] == pytest.approx(1.0, rel=1e-6)
    below = Constraint(1, -np.ones(1), np.zeros((1, 1)))  # -1 >= 0
    assert widest_margin([below], [above], 1e3, solver=failing) is None


def test_words_for_each_status(monkeypatch: pytest.MonkeyPatch) -> None:
    """A failure counts more than what other solves say; multipliers are not called a proof."""
    assert "status MaxIterations)" in not_found({"MaxIterations": 1})
    assert "NumericalError in 2 of 5 problems" in not_found({"Solved": 3, "NumericalError": 2})
    assert "not proved exactly" in not_found({"PrimalInfeasible": 1})
    assert "no bound" in not_found({"DualInfeasible": 1})
    assert "does not prove" in not_found({"Solved": 1})
    above = Constraint(1, np.zeros(1), np.ones((1, 1)))  # y >= 0
    with solver_words() as outer:
        assert solve([above], np.ones(1)).status == "solved"
        break_clarabel(monkeypatch, "MaxTime")
        with solver_words() as inner:
            assert solve([above], np.ones(1)).status == "failed"
    assert solve([above], np.ones(1)).status == "failed"
    assert (dict(outer), dict(inner)) == ({"Solved": 1, "MaxTime": 1}, {"MaxTime": 1})
