"""Margins, Nyquist, roots and norm of loops with delays, against closed forms and each other."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest
from truth_of_late_loops import LateLoop

from cosim.core import InputError, NotAchievableError
from cosim.hinf import analyse, check_certificate, lti
from cosim.hinf.delay_lti import dead_time, feedback, parallel

LOOPS = [(2.0, 1.0, 0.5), (0.5, 0.0, 1.0), (3.0, 0.1, 0.2)]


def loop_of(k: float, a: float, tau: float) -> Any:
    return lti(control.tf([k], [1, a])) * dead_time(tau)


@pytest.mark.parametrize("numbers", LOOPS)
def test_margins_have_closed_forms(numbers: tuple[float, float, float]) -> None:
    """Of L = k e^{-s tau} / (s + a); at each margin a root lies on the axis."""
    L, truth = loop_of(*numbers), LateLoop(*numbers)
    found = L.margins()
    assert found.stable
    assert found.phase == pytest.approx(truth.phase_margin(), rel=1e-14)
    assert found.delay == pytest.approx(truth.delay_margin(), rel=1e-14)
    assert found.gain == pytest.approx(truth.ultimate_gain(), rel=1e-13)
    assert abs((found.gain * L).feedback().roots(1)[0].real) < 1e-12
    assert abs((L * dead_time(found.delay)).feedback().roots(1)[0].real) < 1e-12


def test_a_loop_that_needs_its_gain_has_a_least_one() -> None:
    """3 e^{-0.1 s} / (s - 1): a third is the least."""
    L = 3 * dead_time(0.1) * control.tf([1], [1, -1])
    found = L.margins()
    assert found.gain_decrease == pytest.approx(1 / 3, rel=1e-14)
    assert found.decrease_frequency == 0.0
    assert "gain down to 0.3333" in str(found)


@pytest.mark.slow
def test_of_many_crossings_the_nearest_counts() -> None:
    """A lightly damped mode crosses |L| = 1 twice more, and its delay margin is far less."""
    mode = control.tf([1, 0], [1, 0.02, 100.0])
    L = dead_time(0.05) * parallel(control.tf([0.3], [1, 0]), 0.05 * lti(mode))
    found = L.margins()
    omega = np.linspace(0.05, 30, 600_001)
    values = L.value(1j * omega)
    crossed = np.flatnonzero(np.diff(np.sign(np.abs(values) - 1)))
    assert crossed.size == 3
    lags = (np.angle(values[crossed]) + np.pi) % (2 * np.pi)
    assert found.delay == pytest.approx((lags / omega[crossed]).min(), rel=1e-3)
    assert found.phase == pytest.approx(np.minimum(lags, 2 * np.pi - lags).min(), rel=1e-2)


@pytest.mark.parametrize("gain", [0.5, 1.2, 5.0, 40.0])
def test_encirclements_count_the_roots_of_the_closed_loop(gain: float) -> None:
    """However often the delay turns the curve."""
    L = gain * loop_of(2.0, 1.0, 0.5)
    right = int((L.feedback().roots(40).real > 0).sum())
    found = L.nyquist()
    assert (found.encirclements, found.open_poles, found.closed_roots) == (right, 0, right)
    assert found.stable == (right == 0)


@pytest.mark.parametrize(
    ("model", "tau", "expected"),
    [
        (control.tf([3], [1, -1]), 0.1, (-1, 1, 0)),  # unstable alone, stable in the loop
        (control.tf([1], [1, -1]) * 0.5, 0.1, (0, 1, 1)),  # too little gain
        (control.tf([1], [1, 0]), 1.0, (0, 0, 0)),  # a pole at zero
        (control.tf([1, 1], [1, 0, 0]), 0.1, (0, 0, 0)),  # two of them
        (control.tf([1], [1, 0, 0]), 0.1, (2, 0, 2)),
        (control.tf([-0.2, 0], [1, 0, 4.0]), 0.3, (2, 0, 2)),  # poles at +-2j
        (control.tf([0.2, 0], [1, 0, 4.0]), 0.3, (0, 0, 0)),
        (control.tf([0.5, 1], [1, 1]), 0.7, (0, 0, 0)),  # a direct part, neutral when closed
        (control.tf([3.0], [1e-4, 1, -1]), 0.1, (-1, 1, 0)),  # a stiff one
    ],
)
def test_nyquist_with_poles_everywhere(
    model: Any, tau: float, expected: tuple[int, int, int]
) -> None:
    """Right of the axis, on it, at zero: encirclements + open poles = closed roots."""
    L = lti(model) * dead_time(tau)
    found = L.nyquist()
    assert (found.encirclements, found.open_poles, found.closed_roots) == expected
    assert int((L.feedback().roots(4).real > 0).sum()) == found.closed_roots


def test_nyquist_of_several_loops_at_once() -> None:
    """det(I + L): beyond its gain the closed loop has as many roots as the curve turns."""
    G = lti(
        control.tf([[[1], [2]], [[1], [3]]], [[[1, 1], [1, 2]], [[1, 3], [1, 1]]]),
        io_delay=[[0.1, 0.2], [0.3, 0.4]],
    )
    for gain, expected in ((0.5, 0), (5.0, 2)):
        roots = feedback(gain * G, np.eye(2)).roots(4)
        assert int((roots.real > 0).sum()) == expected
        assert (gain * G).nyquist().closed_roots == expected
    with pytest.raises(InputError, match="one input and one output"):
        G.margins()


@pytest.mark.parametrize("numbers", LOOPS)
def test_the_norm_has_a_closed_form_and_a_proof(numbers: tuple[float, float, float]) -> None:
    """Found, bounded, proved in balls."""
    T, truth = loop_of(*numbers).feedback(), LateLoop(*numbers).norm()
    found = T.norm()
    assert found.value == pytest.approx(truth, rel=1e-12)
    assert truth <= found.bound * (1 + 1e-15) <= truth * (1 + 1e-8)
    proved = T.norm_proved()
    assert proved is not None
    assert truth <= proved <= truth * (1 + 1e-5)


def test_norms_that_only_the_general_bounds_cover() -> None:
    """Inputs and outputs late in different ways, a late direct part, a neutral loop."""
    P = lti(control.tf([1], [1, 1]))
    for G in (
        parallel(dead_time(0.3), dead_time(1.0)) * P * parallel(1, dead_time(0.7)),
        parallel(2 * P, dead_time(1.0)),
        (lti(control.tf([0.3, 1], [1, 1])) * dead_time(0.5)).feedback(),
    ):
        omega = np.linspace(0.0, 60.0, 60_001)
        highest = np.abs(G.value(1j * omega)).max()
        found = G.norm()
        assert highest * (1 - 1e-12) <= found.value <= highest * (1 + 1e-5)
        assert found.value <= found.bound <= found.value * (1 + 1e-5)
        assert G.norm_proved() is None
    assert (0.5 * dead_time(0.3)).feedback().norm().value == pytest.approx(1.0)
    assert (1.2 * dead_time(0.3)).feedback().norm() is None
    assert loop_of(9.0, 1.0, 0.5).feedback().norm() is None


def test_roots_of_a_neutral_loop() -> None:
    """1 + 0.5 e^{-0.3 s} = 0: log(0.5) / 0.3 +- j pi (2k + 1) / 0.3, behind a delay as well."""
    loop = (0.5 * dead_time(0.3)).feedback()
    expected = math.log(0.5) / 0.3 + 1j * np.pi / 0.3 * np.array([1, -1, 3, -3, 5, -5])
    np.testing.assert_allclose(loop.roots(5), expected, rtol=1e-12)
    np.testing.assert_allclose((dead_time(0.7) * loop).roots(5), expected, rtol=1e-12)
    assert (0.5 * dead_time(0.3)).feedback().is_stable()
    assert not (1.5 * dead_time(0.3)).feedback().is_stable()
    with pytest.raises(NotAchievableError, match="direct part"):
        (1.5 * dead_time(0.3)).nyquist()


def test_a_loop_at_the_limit_is_not_counted() -> None:
    """A closed-loop root on the axis: no encirclement, in words."""
    with pytest.raises(NotAchievableError, match="axis"):
        loop_of(math.pi / 2, 0.0, 1.0).nyquist()


def test_the_certificate_stands_beside_it() -> None:
    """In rational arithmetic, above the norm, and checked without a solver."""
    T = loop_of(2.0, 1.0, 0.5).feedback()
    found = analyse(T)
    norm = T.norm().value
    assert found.gamma is not None
    assert norm <= found.gamma <= 1.001 * norm
    assert check_certificate(found.certificate).valid
