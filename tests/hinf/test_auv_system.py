"""The vehicle's design: its letters of Eq. (7), its proof, and what the link does to a gain."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.hinf import Result, auv_system, design
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2, AuvDesignSettings
from cosim.models import DelaySystem

DAMPING, STATE_DELAY, LINK, SHORT = 0.05, 0.5, 1.25, 0.05


@pytest.fixture(scope="module")
def aware() -> Result:
    """The gain designed for the link."""
    return design(auv_system(), DEFAULT_K1, DEFAULT_K2)


@pytest.fixture(scope="module")
def naive() -> Result:
    """The gain designed with the same weights as if the loop were 0.05 s."""
    return design(auv_system(AuvDesignSettings(loop_delay=SHORT)), DEFAULT_K1, DEFAULT_K2)


def _axis_abscissa(position: float, speed: float, loop_delay: float) -> float:
    """Rightmost root of one axis: s^2 + a s e^{-0.5 s} - (position + speed s) e^{-d s} = 0.

    For a diagonal gain the nominal vehicle is four such axes. Newton from a grid over the part
    of the plane that can hold roots with real part above -0.4: there
    |s|^2 <= a |s| e^{0.2} + (|position| + |speed| |s|) e^{0.4 d}, so |s| < 8 for these gains.
    """
    best = -math.inf
    for start in (complex(x, y) for x in np.arange(-0.4, 2.0, 0.1) for y in np.arange(0, 8, 0.2)):
        s = start
        for _ in range(40):
            late, state = cmath.exp(-loop_delay * s), DAMPING * cmath.exp(-STATE_DELAY * s)
            gain = (position + speed * s) * late
            value = s * s + s * state - gain
            slope = 2 * s + (1 - STATE_DELAY * s) * state - speed * late + loop_delay * gain
            step = value / slope
            s -= step
            if not abs(s) < 50:
                break
            if abs(step) < 1e-14:
                best = max(best, s.real)
                break
    return best


def _abscissa(K: NDArray[np.float64], loop_delay: float) -> float:
    return max(_axis_abscissa(K[i, i], K[i, 4 + i], loop_delay) for i in range(4))


def _gain_over_frequency(
    system: DelaySystem,
    K: NDArray[np.float64],
    F: NDArray[np.float64],
    ages: tuple[float, ...],
    omega: NDArray[np.float64],
) -> float:
    """Largest gain from w to z over a grid, with a constant F and constant ages of the data."""
    s = 1j * omega[:, None, None]
    matrix = s * np.eye(8) - system.A - system.E @ F @ system.H
    output = np.zeros((omega.size, 8, 8), dtype=complex) + system.D
    for delay, age in zip(system.delays, ages, strict=True):
        late = np.exp(-s * age)
        acts = system.B @ K if delay.feedback else 0.0
        matrix = matrix - (delay.A + system.E @ F @ delay.H + acts) * late
        if delay.feedback:
            output = output + system.D2 @ K * late
    T = output @ np.linalg.solve(matrix, np.broadcast_to(system.C, (omega.size, 8, 4)))
    return float(np.linalg.norm(T + system.D1, 2, axis=(1, 2)).max())


def test_matrices_of_the_vehicle() -> None:
    """Rest on station: eta' = nu, nu' = u - 0.05 nu(t-0.5) + w, z = (0.1 eta, u)."""
    system = auv_system()
    assert system.A.tolist() == np.eye(8, k=4).tolist()
    damping, link = system.delays
    assert (damping.d, link.d, link.feedback) == (STATE_DELAY, LINK, True)
    assert damping.any_age
    assert link.any_age
    assert damping.A.tolist() == np.diag([0.0] * 4 + [-DAMPING] * 4).tolist()
    assert not link.A.any()
    entry = np.eye(8)[:, 4:].tolist()
    assert system.B.tolist() == system.C.tolist() == system.D2.tolist() == entry
    assert system.D.tolist() == np.diag([0.1] * 4 + [0.0] * 4).tolist()
    assert not system.D1.any()


def test_without_a_loop_delay_the_feedback_is_immediate() -> None:
    """loop_delay = 0 leaves one delay, the damping loop's, and u = K x(t)."""
    system = auv_system(AuvDesignSettings(loop_delay=0.0))
    assert len(system.delays) == 1
    assert system.immediate_feedback
    assert not auv_system().immediate_feedback


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"loop_delay": -1.0}, "loop_delay"),
        ({"loop_delay": math.nan}, "loop_delay"),
        ({"state_delay": math.inf}, "state_delay"),
        ({"damping": (0.1, 0.1, math.nan, 0.1)}, "damping"),
        ({"damping": (0.1, 0.1)}, "damping"),
        ({"position_weight": -0.1}, "position_weight"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float], name: str) -> None:
    """A negative or undefined delay is no immediate feedback, but an error."""
    with pytest.raises(InputError, match=rf"design\.{name}"):
        AuvDesignSettings(**settings)  # type: ignore[arg-type]


def test_the_aware_gain_is_certified_and_near_what_was_computed_elsewhere(aware: Result) -> None:
    """Gains near -0.06 (position) and -0.53 (speed), gamma under 3.84.

    The numbers are those of an independent design for half the envelope, at other k1, k2.
    """
    position, speed = np.diag(aware.K[:, :4]), np.diag(aware.K[:, 4:])
    assert aware.gamma is not None
    assert aware.exact_norm is not None
    assert aware.exact_norm < aware.gamma < 3.84
    assert position == pytest.approx(np.full(4, -0.06), abs=0.02)
    assert speed == pytest.approx(np.full(4, -0.53), abs=0.03)


def test_roots_of_the_aware_loop(aware: Result) -> None:
    """The spectral abscissa is that of four scalar axes, by Newton on each."""
    assert aware.abscissa == pytest.approx(_abscissa(aware.K, LINK), abs=1e-9)
    assert aware.abscissa < -0.05


def test_the_naive_gain_is_stable_where_it_was_designed_and_unstable_over_the_link(
    naive: Result,
) -> None:
    """Near +0.21 1/s over 1.25 s, by Newton on each axis, and well damped at 0.05 s."""
    assert naive.abscissa == pytest.approx(_abscissa(naive.K, SHORT), abs=1e-9)
    assert naive.abscissa < -0.1
    assert _abscissa(naive.K, LINK) == pytest.approx(0.21, abs=0.03)


def test_the_certified_gamma_holds_for_admissible_uncertainty_and_any_constant_age(
    aware: Result,
) -> None:
    """No F with |F| <= 1 and no ages up to the designed ones bring the gain above gamma.

    Also how much is given away: the worst case found reaches 60 % of gamma at least.
    """
    random = np.random.default_rng(1)
    omega = np.concatenate([[0.0], np.geomspace(1e-3, 30.0, 400)])
    assert aware.gamma is not None
    worst = 0.0
    for case in range(60):
        U, _, V = np.linalg.svd(random.normal(size=(6, 6)))
        F = U @ V
        if case % 2:  # rank one: all of F in one direction
            F = np.outer(U[:, 0], V[0])
        age = LINK if case % 3 else float(random.uniform(0.0, LINK))
        gain = _gain_over_frequency(aware.system, aware.K, F, (STATE_DELAY, age), omega)
        worst = max(worst, gain)
    assert 0.6 * aware.gamma < worst <= aware.gamma


def test_nominal_norm_agrees_with_a_sweep(aware: Result) -> None:
    """The exact norm bounds a dense sweep from above and is attained by it to 1e-5."""
    omega = np.concatenate([[0.0], np.geomspace(1e-4, 50.0, 20_000)])
    swept = _gain_over_frequency(
        aware.system, aware.K, np.zeros((6, 6)), (STATE_DELAY, LINK), omega
    )
    assert aware.exact_norm is not None
    assert swept <= aware.exact_norm * (1 + 1e-9)
    assert swept == pytest.approx(aware.exact_norm, rel=1e-5)
