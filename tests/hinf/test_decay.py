"""A proved rate of decay: never beyond what a loop does, and close to it where that is known."""

from __future__ import annotations

import math

import flint
import numpy as np
import pytest
from heun_integrator import integrate, sawtooth, turning
from shared import sampled
from solver_points import random_system

from cosim.core import InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, design, spectral_abscissa
from cosim.hinf.certificate import acting_delays, corners, growth_of, is_above_exponential
from cosim.hinf.delay_lti import ClosedLoop, close
from cosim.hinf.exact import exact
from cosim.hinf.problem import with_delays
from cosim.hinf.synthesis import checked_scalars, proved_decay
from cosim.hinf.theorems import Scalars
from cosim.models import paper_example


def _scalars(system: DelaySystem) -> Scalars:
    k2 = [0.5 / delay.d for delay in system.delays]
    return checked_scalars(system, [-x for x in k2], k2)


def test_without_a_delay_the_rate_is_the_eigenvalue() -> None:
    """x' = -2 x decays at 2 and at no more: proved at 1.999, not at 2.001."""
    system = DelaySystem([[-2.0]])
    K = np.zeros((0, 1))
    assert proved_decay(system, K, 1.999, _scalars(system))[0] is not None
    assert proved_decay(system, K, 2.001, _scalars(system))[0] is None


@pytest.mark.parametrize("seed", sampled(range(12), 3))
def test_proved_rate_holds_for_all_delays_and_uncertainties(seed: int) -> None:
    """At constant F and at delays of 0, half and all of d, the rightmost root lies left of it."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, late=bool(seed % 2), any_age=seed % 3 == 0, uncertain=seed % 4 < 2)
    system = DelaySystem(
        system.A - 2 * np.eye(2),
        system.B,
        E=0.3 * system.E if system.E.size else None,
        H=system.H if system.E.size else None,
        delays=system.delays,
    )
    K = 0.3 * rng.standard_normal((1, 2))
    abscissa = spectral_abscissa(close(system, K))
    proved = 0
    for share in (0.2, 0.5, 0.9, 1.01):
        rate = -share * abscissa
        if rate <= 0:
            continue
        decay, _ = proved_decay(system, K, rate, _scalars(system))
        if decay is None:
            continue
        proved += 1
        assert decay.failure(system, K) is None
        for scale in (1.0, 0.5, 0.0):
            shorter = with_delays(system, [scale * x.d for x in system.delays])
            for F in [np.zeros((3, 2)), np.eye(3, 2), -np.eye(3, 2)] if system.E.size else [None]:
                assert spectral_abscissa(_disturbed(shorter, K, F)) <= -rate + 1e-9
    assert abscissa < 0
    assert proved >= (0 if seed in {0, 3, 8, 9} else 1)


def _disturbed(system: DelaySystem, K: np.ndarray, F: np.ndarray | None) -> ClosedLoop:
    loop = close(system, K)
    if F is None:
        return loop
    more = [system.E @ F @ H for H in (system.H, *(x.H for x in system.delays))]
    delays = [0.0, *(x.d for x in system.delays)]
    return ClosedLoop([*loop.A, *more], [*loop.delays, *delays])


def test_sampled_feedback_is_covered_by_any_age() -> None:
    """x' = K x(t_k), a sample held for d: x(t_k + d) = (1 + K d) x(t_k), in closed form."""
    d = 0.5
    system = DelaySystem([[0.0]], [[1.0]], delays=[Delay(d, [[0.0]], feedback=True, any_age=True)])
    best = 0.0
    for rate in (0.1, 0.2, 0.3, 0.4, 0.6, 0.8):
        try:
            found = design(system, decay=rate, alternatives=False)
        except NotAchievableError:
            continue
        best = rate
        assert abs(1 + d * float(found.K[0, 0])) <= math.exp(-rate * d)
    assert best >= 0.3


def test_design_with_decay_costs_gamma_and_decays_at_varying_ages() -> None:
    """Section 5 at 4 1/s: a larger gamma; the flight falls as proved while F and the age turn."""
    system = paper_example.system()
    plain = design(system, (0.6,), (0.2,))
    found = design(system, (0.6,), (0.2,), decay=4.0)
    assert found.guarantees.decay is not None
    assert plain.gamma is not None
    assert found.gamma is not None
    assert found.gamma > plain.gamma
    assert found.abscissa <= -4.0
    for phase in (0.0, 1.0, 2.0):
        t, x, _ = integrate(
            system,
            found.K,
            np.array([1.0, -1.0]),
            3.0,
            ages=[lambda _: 0.3],
            F=turning(2, 2, 3.0, phase),
        )
        size = np.linalg.norm(x, axis=1) * np.exp(4.0 * t)
        # bounded by its history's measure, and falling: nothing grows after the first second
        assert size[t > 1.0].max() <= size[t <= 1.0].max()


def test_an_age_that_varies_is_covered_where_any_age_is_claimed() -> None:
    """A sawtooth age through the plant: the flight falls at the proved rate."""
    system = DelaySystem(
        [[-3.0, 1.0], [0.0, -2.0]],
        delays=[Delay(0.4, [[0.3, 0.0], [0.5, -0.4]], any_age=True)],
    )
    K = np.zeros((0, 2))
    decay, reason = proved_decay(system, K, 1.0, _scalars(system))
    assert decay is not None, reason
    t, x, _ = integrate(system, K, np.array([1.0, 1.0]), 6.0, ages=[sawtooth(0.4, 0.3)])
    size = np.linalg.norm(x, axis=1) * np.exp(t)
    assert size[t > 2.0].max() <= size[t <= 2.0].max()


def test_the_box_of_growth_is_rounded_outward() -> None:
    """The double above e^{rate d} is proved to be above it, the one below it is not."""
    system = DelaySystem([[-1.0]], delays=[Delay(0.7, [[0.1]]), Delay(0.9, [[0.0]])])
    growth = growth_of(system, 0.3)
    power = flint.fmpq(*(0.3).as_integer_ratio()) * flint.fmpq(*(0.7).as_integer_ratio())
    assert growth[0] == pytest.approx(math.exp(0.21), rel=1e-15)
    assert growth[1] == 1.0  # nothing acts through it
    assert is_above_exponential(flint.fmpq(*growth[0].as_integer_ratio()), power)
    below = math.exp(0.21) * (1 - 1e-12)
    assert not is_above_exponential(flint.fmpq(*below.as_integer_ratio()), power)
    ends = corners(tuple(exact(s) for s in growth), acting_delays(system))
    assert [[float(s.p) / float(s.q) for s in corner] for corner in ends] == [
        [1, 1],
        [growth[0], 1],
    ]


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan, math.inf, 1e5])
def test_invalid_rate_is_refused(rate: float) -> None:
    """Not positive, not finite, or e^{rate d} beyond any proof."""
    with pytest.raises(InputError, match="decay"):
        design(paper_example.system(), (0.6,), (0.2,), decay=rate)


def test_unachievable_rate_is_refused() -> None:
    """A mode that no input reaches decays at 1 and no faster."""
    system = DelaySystem([[-1.0, 0.0], [0.0, 1.0]], [[0.0], [1.0]])
    assert design(system, decay=0.9).abscissa <= -0.9
    with pytest.raises(NotAchievableError, match=r"decay at 1\.1"):
        design(system, decay=1.1, alternatives=False)
