"""The worst disturbance of a loop, against closed forms, and against every other direction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import DelaySystem, characteristic_roots, hinf_norm, system_by_name
from cosim.hinf.delay_lti import ClosedLoop, close, gain_at, worst_case, worst_uncertainty

LAG = ClosedLoop([[[-1.0]]], [0.0], [[1.0, 0.0]], [[[1.0]]], [[0.0, 1.0]])
"""x' = -x + w1, z = x + w2: G = (1/(1 + jw), 1)."""


@pytest.mark.parametrize("omega", [0.0, 0.3, 1.0, 7.0])
def test_worst_case_of_a_lag_beside_a_direct_term(omega: float) -> None:
    """w1 leads w2 by atan(w), so that both arrive in phase, and weighs 1/sqrt(1 + w^2)."""
    found = worst_case(LAG, omega)
    through = 1 / math.sqrt(1 + omega**2)
    size = math.hypot(through, 1.0)
    assert found.gain == float(f"{size:.5e}")
    assert found.amplitude == pytest.approx((through / size, 1.0 / size), abs=1e-6)
    lead = math.remainder(found.phase[0] - found.phase[1], 2 * math.pi)
    assert lead == pytest.approx(math.atan(omega), abs=2e-6)


def vehicle() -> ClosedLoop:
    """The vehicle under a gain that couples its axes, feedback late."""
    K = np.hstack([-0.06 * np.eye(4), -0.53 * np.eye(4)])
    K[0, 3], K[1, 3], K[3, 1], K[2, 4] = 0.02, -0.03, 0.01, 0.05
    return close(system_by_name("auv").system, K)


@pytest.mark.parametrize("omega", [0.0, 0.1, 0.6, 2.0])
def test_no_direction_is_amplified_more(omega: float) -> None:
    """Steady sinusoids through the loop, entry by entry: the one found beats 2000 others."""
    loop = vehicle()
    s = 1j * omega
    A = sum(M * np.exp(-s * d) for M, d in zip(loop.A, loop.delays, strict=True))
    D = sum(M * np.exp(-s * d) for M, d in zip(loop.D, loop.delays, strict=True))
    G = D @ np.linalg.inv(s * np.eye(8) - A) @ loop.C + loop.D1
    found = worst_case(loop, omega)
    v = np.array(found.amplitude) * np.exp(1j * np.array(found.phase))
    assert np.linalg.norm(v) == pytest.approx(1.0, abs=1e-5)
    attained = np.linalg.norm(G @ v) / np.linalg.norm(v)
    assert attained == pytest.approx(float(gain_at(loop, omega)), rel=1e-9)
    draw = np.random.default_rng(1).normal(size=(2, 4, 2000))
    others = draw[0] + 1j * draw[1]
    gains = np.linalg.norm(G @ others, axis=0) / np.linalg.norm(others, axis=0)
    assert gains.max() <= attained * (1 + 1e-12)


def test_peak_of_the_paper_is_the_norm() -> None:
    """At the norm's own frequency, rounded to six digits, the norm is lost by less than 1e-9."""
    loop = close(system_by_name("paper").system, [[0.6432, -0.5679]])
    norm = hinf_norm(loop)
    assert norm is not None
    found = worst_case(loop, norm.frequency)
    assert found.omega == pytest.approx(22.905, abs=1e-3)
    assert 0 <= 1 - float(gain_at(loop, found.omega)) / norm.value < 1e-9
    assert found.gain == float(f"{norm.value:.5e}")
    assert (found.amplitude, found.phase) == ((1.0,), (0.0,))


def test_equal_axes_give_one_of_them_whatever_the_last_digits() -> None:
    """Four loops alike: the first axis, and the same after noise far below six digits."""
    A = [[0.0, 1.0], [-0.09, -0.12]]

    def loop(noise: float) -> ClosedLoop:
        rng = np.random.default_rng(2)
        state = np.kron(np.eye(4), A) + noise * rng.normal(size=(8, 8))
        entry = np.kron(np.eye(4), [[0.0], [1.0]])
        return ClosedLoop([state], [0.0], entry, [np.kron(np.eye(4), [[1.0, 0.0]])])

    clean = worst_case(loop(0.0), 0.28)
    assert clean.amplitude == (1.0, 0.0, 0.0, 0.0)
    noisy = worst_case(loop(1e-12), 0.28)
    assert (noisy.omega, noisy.amplitude, noisy.phase) == (
        clean.omega,
        clean.amplitude,
        clean.phase,
    )
    assert characteristic_roots(loop(0.0), 4)[0].real < 0


@pytest.mark.parametrize("omega", [math.inf, math.nan, -1.0])
def test_no_frequency_is_refused(omega: float) -> None:
    """Infinity, NaN and less than zero: no sinusoid has such a frequency."""
    with pytest.raises(InputError, match="not a frequency"):
        worst_case(LAG, omega)


def test_loop_without_a_gain_has_no_worst_case() -> None:
    """Without w and z there is nothing to amplify."""
    with pytest.raises(InputError, match="no gain from w to z"):
        worst_case(ClosedLoop([[[-1.0]]], [0.0]), 1.0)


def test_the_worst_constant_uncertainty_of_two_blocks() -> None:
    """x' = (-2 + F_1 + 0.5 F_2) x + w, z = x: the gain is 1 / (2 - 1.5), at both blocks 1."""
    system = DelaySystem(
        [[-2]], [[0]], [[1]], [[1]], E=[[1, 0.5]], H=[[1], [1]], uncertainty_blocks=[(1, 1)] * 2
    )
    found = worst_uncertainty(system, [[0]])
    assert found.gain == pytest.approx(2.0)
    assert np.array_equal(found.F, np.eye(2))
    unstable = replace(system, E=[[2, 1]])
    assert worst_uncertainty(unstable, [[0]]).gain == np.inf
