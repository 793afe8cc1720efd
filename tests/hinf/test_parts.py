"""A system that falls into parts is solved part by part, and nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag
from solver_points import random_system

from cosim.hinf import analyse, auv_system, check_certificate, design
from cosim.hinf.lmi import Answer, Problem, Scalars
from cosim.hinf.lmi.conic import solve
from cosim.hinf.lmi.parts import parts_of_system
from cosim.models.delay_system import Delay, DelaySystem


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


def test_parts_are_found() -> None:
    """Two systems are two parts, the vehicle four axes; a gain across them joins them."""
    parts = parts_of_system(pair())
    assert [sorted(set(parts[name].tolist())) for name in "xuwz"] == [[0, 1]] * 4
    assert parts["x"].tolist() == [0, 0, 1, 1]
    assert len(set(parts_of_system(auv_system())["x"].tolist())) == 4
    joined = parts_of_system(pair(), np.ones((2, 4)))
    assert len(set(joined["x"].tolist())) == 1


@pytest.mark.parametrize("performance", [True, False])
def test_the_optimum_and_its_slopes_are_those_of_the_whole(
    monkeypatch: pytest.MonkeyPatch, *, performance: bool
) -> None:
    """Least gamma or greatest margin, and the derivatives by k1, k2, d from the multipliers."""
    system = pair()
    p = Scalars((-0.6, -0.5), (0.6, 0.5), tuple(x.d for x in system.delays))

    def answer() -> Answer:
        problem = Problem(system)
        found = problem.least_gamma(p) if performance else problem.margin(p, 50.0)
        assert isinstance(found, Answer)
        return found

    cut = answer()
    assert not cut.point.X[:2, 2:].any()
    monkeypatch.setattr(
        "cosim.hinf.lmi.problem.solve_in_parts",
        lambda constraints, _, q, **more: solve(constraints, q, **more),
    )
    whole = answer()
    assert cut.value == pytest.approx(whole.value, rel=1e-5)
    np.testing.assert_allclose(cut.slopes, whole.slopes, rtol=1e-3, atol=1e-5)


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
