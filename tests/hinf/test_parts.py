"""A system that falls into parts is solved part by part, and nothing is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag
from solver_points import random_system

from cosim.hinf import analyse, auv_system, check_certificate, design
from cosim.hinf.lmi import Answer, Problem, scaling_of
from cosim.hinf.theorems import Scalars
from cosim.models import Delay, DelaySystem


def side_by_side(a: DelaySystem, b: DelaySystem) -> DelaySystem:
    """Two systems with the same delays that do not act on each other."""
    delays = [
        Delay(x.d, block_diag(x.A, y.A), block_diag(x.H, y.H), x.feedback, x.any_age)
        for x, y in zip(a.delays, b.delays, strict=True)
    ]
    names = ("A", "B", "C", "D", "D1", "D2", "E", "H")
    values = {name: block_diag(getattr(a, name), getattr(b, name)) for name in names}
    return DelaySystem(**values, delays=delays)


def pair() -> DelaySystem:
    """Two random uncertain systems side by side."""
    made = [
        random_system(
            np.random.default_rng(seed), late=True, any_age=False, uncertain=True, scale=0.3
        )
        for seed in (3, 4)
    ]
    return side_by_side(*made)


def turned(system: DelaySystem, turn: NDArray[np.float64]) -> DelaySystem:
    """The system in states turn x."""
    back = turn.T
    return DelaySystem(
        turn @ system.A @ back,
        turn @ system.B,
        C=turn @ system.C,
        D=system.D @ back,
        D1=system.D1,
        D2=system.D2,
        E=turn @ system.E,
        H=system.H @ back,
        delays=[replace(x, A=turn @ x.A @ back, H=x.H @ back) for x in system.delays],
    )


def test_parts_are_found() -> None:
    """Two systems are two parts, the vehicle four axes; a gain across them joins them."""
    assert [len(at) for at in Problem(pair()).rows_of_parts()] == [16, 16]
    assert len(Problem(auv_system()).rows_of_parts()) == 4
    assert len(Problem(pair()).rows_of_parts(np.ones((2, 4)))) == 1


def test_the_scale_of_an_answer_is_of_any_gain() -> None:
    """That of a design, in two parts, scales the rows of a loop whose gain joins them."""
    problem, d = Problem(pair()), tuple(x.d for x in pair().delays)
    p = Scalars((-0.6, -0.5), (0.6, 0.5), d)
    free = problem.least_gamma(p)
    assert isinstance(free, Answer)
    gain = np.linalg.solve(free.unknowns["X"], free.unknowns["Y"].T).T
    gain[:, 2:] += 1e-3 * np.abs(gain).max()
    joined = problem.margin(p, 2 * free.value, gain, free)
    assert isinstance(joined, Answer)
    assert joined.value > 0


@pytest.mark.parametrize("performance", [True, False])
def test_the_optimum_and_its_slopes_are_those_of_the_whole(*, performance: bool) -> None:
    """Least gamma or greatest margin, and the derivatives by k1, k2, d from the multipliers.

    The whole is the same two systems in states that connect them.
    """
    system = pair()
    p = Scalars((-0.6, -0.5), (0.6, 0.5), tuple(x.d for x in system.delays))

    def answer(system: DelaySystem) -> Answer:
        problem = Problem(system, scaling=units)
        found = problem.least_gamma(p) if performance else problem.margin(p, 50.0)
        assert isinstance(found, Answer)
        assert len(problem.rows_of_parts()) == (2 if system is cut_apart else 1)
        return found

    cut_apart, units = system, replace(scaling_of(system), state=np.ones(4))
    turn = np.kron(np.array([[0.8, -0.6], [0.6, 0.8]]), np.eye(2))  # X <= 1000 I stays as it is
    cut, whole = answer(cut_apart), answer(turned(system, turn))
    assert not cut.unknowns["X"][:2, 2:].any()
    assert cut.value == pytest.approx(whole.value, rel=1e-5)
    np.testing.assert_allclose(cut.slopes, whole.slopes, rtol=1e-3, atol=1e-4)


def test_a_gain_for_two_is_proved_for_both() -> None:
    """The certificate is of the whole; an analysis of a gain that joins the parts as well."""
    system = pair()
    found = design(system, (-0.6, -0.5), (0.6, 0.5), order=None, search=False)
    assert check_certificate(found.certificate).valid
    assert not found.K[0, 2:].any()
    joined = found.K + 1e-3 * np.abs(found.K).max()
    both = analyse(system, joined, order=0)
    assert both.certified
    assert check_certificate(both.certificate).valid
