"""`as_cvxpy`: the LMI for users with constraints of their own, proved by the project in the end."""

from __future__ import annotations

import doctest
import subprocess
import sys

import cvxpy as cp
import numpy as np
import pytest

from cosim.core import InputError, NotAchievableError
from cosim.hinf import analyse, as_cvxpy, check_certificate
from cosim.hinf.lmi import Answer, Problem
from cosim.hinf.theorems import Scalars
from cosim.models import Delay, DelaySystem, paper_example

K1, K2 = (0.6,), (0.2,)


def _two_delays() -> DelaySystem:
    """Two states, an uncertain loop, a link of any age."""
    link = Delay(0.1, np.zeros((2, 2)), feedback=True, any_age=True)
    return DelaySystem(
        [[0.0, 1.0], [-1.0, -0.5]],
        [[0.0], [1.0]],
        [[0.0], [1.0]],
        [[1.0, 0.0], [0.0, 0.0]],
        None,
        [[0.0], [0.3]],
        [[0.0], [0.1]],
        [[1.0, 0.0]],
        [Delay(0.2, [[0.0, 0.0], [0.1, -0.1]]), link],
    )


@pytest.mark.parametrize(
    ("system", "k1", "k2"),
    [(paper_example.system(), K1, K2), (_two_delays(), (-1.0, -2.0), (1.0, 4.0))],
    ids=["paper", "two delays"],
)
def test_least_gamma_equals_that_of_the_solver_s_form(
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...]
) -> None:
    """Two formulations, no line in common: for section 5 at k1 = .6, k2 = .2 it is 5.0132."""
    asked = as_cvxpy(system, k1, k2)
    least = asked.problem.solve(solver=cp.CLARABEL)
    own = Problem(system).least_gamma(Scalars(k1, k2, tuple(x.d for x in system.delays)))
    assert isinstance(own, Answer)
    assert least == pytest.approx(own.value, rel=1e-5)
    if system.name == "paper":
        assert least == pytest.approx(5.0132, abs=5e-5)


def test_the_variables_have_names_and_shapes() -> None:
    """Users write constraints with these."""
    asked = as_cvxpy(_two_delays(), (-1.0, -2.0), (1.0, 4.0))
    shapes = {variable.name(): variable.shape for variable in asked.problem.variables()}
    n = (2, 2)
    assert shapes == {"X": n, "Y": (1, 2), "Q1": n, "R1": n, "R2": n, "eps": (), "gamma": ()}
    assert not np.any(asked.Q[1])  # any age
    assert [asked.X.name(), asked.Y.name(), asked.gamma.name()] == ["X", "Y", "gamma"]


def test_a_constraint_is_kept_and_the_gain_is_proved() -> None:
    """trace(X) <= half of what is best: gamma rises, and the gain is certified at no more."""
    asked = as_cvxpy(paper_example.system(), K1, K2)
    free = asked.problem.solve(solver=cp.CLARABEL)
    size = float(np.trace(asked.X.value))
    mine = cp.trace(asked.X) <= size / 2
    kept = cp.Problem(asked.problem.objective, [*asked.constraints, mine]).solve(solver=cp.CLARABEL)
    assert kept > free * (1 + 1e-6)
    assert np.trace(asked.X.value) <= size / 2 * (1 + 1e-6)
    found = asked.design()
    assert found.gamma is not None
    assert free * (1 - 1e-6) < found.gamma < kept * (1 + 1e-3)
    assert check_certificate(found.certificate).valid
    np.testing.assert_allclose(found.K, asked.Y.value @ np.linalg.inv(asked.X.value), rtol=1e-4)
    assert asked.design(6.0).gamma == 6.0


def test_a_given_gamma_and_stability_alone_ask_for_a_margin() -> None:
    """What is homogeneous has its size set: the gain of widest margin is certified."""
    for asked in (
        as_cvxpy(paper_example.system(), K1, K2, gamma=6.0),
        as_cvxpy(
            DelaySystem([[1.0]], [[1.0]], delays=[Delay(0.2, [[0.1]], feedback=True)]),
            (-2.0,),
            (2.0,),
        ),
    ):
        assert asked.problem.solve(solver=cp.CLARABEL) > 0
        found = asked.design()
        assert check_certificate(found.certificate).valid
        assert analyse(asked.system, found.K).certified


def test_given_gain_is_kept() -> None:
    """Y = K X; its gain is K again, to the digits that a design keeps."""
    asked = as_cvxpy(paper_example.system(), K1, K2, gain=[list(paper_example.PRINTED_K)])
    asked.problem.solve(solver=cp.CLARABEL)
    assert asked.gain() == pytest.approx(np.array([paper_example.PRINTED_K]), abs=2e-6)


def test_invalid_requests_are_refused() -> None:
    """Not solved, k2 = 0, no B, gamma at ||D1||."""
    with pytest.raises(InputError, match=r"no gain in X and Y(?s:.)*solve\(\)"):
        as_cvxpy(paper_example.system(), K1, K2).design()
    with pytest.raises(InputError, match="k2 must not be zero"):
        as_cvxpy(paper_example.system(), K1, (0.0,))
    with pytest.raises(InputError, match="B is missing"):
        as_cvxpy(DelaySystem([[-1.0]]), (), ())
    with pytest.raises(NotAchievableError, match="D1"):
        as_cvxpy(paper_example.system(), K1, K2, gamma=5.0)


def test_the_example_of_its_docstring_runs() -> None:
    """A structured gain, in five lines."""
    results = doctest.testmod(sys.modules[as_cvxpy.__module__])
    assert results.failed == 0
    assert results.attempted >= 7


def test_cvxpy_is_imported_when_it_is_asked_for() -> None:
    """It takes a second to load, and a design does not need it."""
    program = "import sys, cosim.hinf; sys.exit('cvxpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0  # noqa: S603
