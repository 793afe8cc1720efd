"""Designs of order N: no worse than Theorem 2, sound, proved, and where they end."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from shared import sampled
from solver_points import random_system
from truth_of_loops import first_loss, loop_of, norm

from cosim.core import InputError, NotAchievableError
from cosim.hinf import (
    Result,
    auv_system,
    check_certificate,
    design,
    greatest_delay,
    spectral_abscissa,
)
from cosim.hinf.delay_lti import close
from cosim.hinf.lmi import Condition, GainLmi, multiplier_of, scalar_multiplier
from cosim.models import Delay, DelaySystem, paper_example

LINK = DelaySystem(
    [[0, 1], [0, -0.1]],
    [[0], [1]],
    [[0], [1]],
    [[1, 0], [0, 0]],
    D2=[[0], [0.1]],
    delays=[Delay(1.0, np.zeros((2, 2)), feedback=True)],
)
"""A mass that is steered over one second."""


@pytest.mark.slow
@pytest.mark.parametrize("order", sampled([2, 0, 1], 1))
@pytest.mark.parametrize(("late", "any_age"), [(False, False), (True, False), (True, True)])
def test_multipliers_of_a_gain_do_not_raise_its_gamma(
    order: int, *, late: bool, any_age: bool
) -> None:
    """With the multipliers of K the least gamma of the design is not above that of K.

    And what the design says of its gain, the analysis of that gain confirms: the two LMIs,
    written apart, bound each other from both sides.
    """
    rng = np.random.default_rng(10 * order + 1)
    met = 0
    for blocks in (None, [[1, 1], [2, 1]]) * 3:
        settings: Any = {"late": late, "any_age": any_age, "uncertain": True, "blocks": blocks}
        system = random_system(rng, scale=0.3, **settings)
        delays = [x.d for x in system.delays]
        K = 0.1 * rng.standard_normal((1, 2))
        if not spectral_abscissa(close(system, K)) < 0:
            continue  # the solver may take what is no solution for one
        analysis = Condition(system, K, order, performance=True)
        gamma = analysis.least_gamma(delays, 1.0)
        if gamma is None:
            continue
        found = analysis.margin(delays, 1.01 * gamma)
        assert found is not None
        assert found[0] > 0
        made = GainLmi(system, order, K, gamma).least_gamma(multiplier_of(found[1], system))
        assert made is not None
        least, gain = made
        assert least < 1.0101 * gamma
        again = Condition(system, gain, order, performance=True).least_gamma(delays, gamma)
        assert again is not None
        assert again < least * (1 + 1e-4)
        met += 1
    assert met >= 2


def test_scalar_multipliers_are_sound_and_lose_something() -> None:
    """The usual choice S_0 = b I: its gain has, by its analysis, at most the gamma it says."""
    for b in (0.1, 0.5, 2.0):
        lmi = GainLmi(LINK, 1, np.zeros((1, 2)), 1.0)
        found = lmi.least_gamma(scalar_multiplier(b, LINK))
        if found is None:
            continue
        least = Condition(LINK, found[1], 1, performance=True).least_gamma([1.0], found[0])
        assert least is not None
        assert least < found[0] * (1 + 1e-4)
    assert found is None or found[0] > 3.2


@pytest.mark.slow
def test_gamma_approaches_the_exact_norm_with_the_order() -> None:
    """Over a link Theorem 2 ends at 6.69 with k1, k2 searched; order 1 at less than half."""
    plain = design(LINK, [-0.5], [1.0], search=True, order=None)
    assert plain.order is None
    assert plain.gamma is not None
    last = plain.gamma
    for order, below in ((0, 5.3), (1, 3.2), (2, 3.15)):
        found = design(LINK, [-0.5], [1.0], order=order)
        assert found.gamma is not None
        exact = norm(loop_of(LINK, found.K))
        assert exact <= found.gamma < below
        assert found.gamma < last
        assert found.order == order
        assert found.covers_smaller_delays or order > 0
        assert check_certificate(found.certificate).valid
        last = found.gamma
    assert last < 1.0001 * exact


@pytest.mark.slow
def test_order_1_lowers_the_gamma_of_the_vehicle() -> None:
    """Two delays of any age, eight states: 3.12 from the 4.31 of the same k1, k2."""
    system = auv_system()
    found = design(system, [-0.3, -0.6], [0.3, 0.6], order=0)
    assert found.gamma is not None
    assert norm(loop_of(system, found.K)) < found.gamma < 3.2
    assert found.covers_smaller_delays
    proof = check_certificate(found.certificate)
    assert proof.valid
    assert all(delay["age"].startswith("any") for delay in proof.claim["delays"])


@pytest.mark.slow
def test_a_greatest_delay_beyond_theorem_2() -> None:
    """gamma = 6 of the paper at its printed k1, k2: 1.04 by Theorem 2, no end by order 1."""
    system = paper_example.system()
    assert greatest_delay(system, 6.0, [0.6], [0.2]).delay < 1.05
    found = greatest_delay(system, 6.0, [0.6], [0.2], order=1)
    assert found.limit_reached
    assert found.delay == 20.0
    assert found.refuted_at is None
    proof = check_certificate(found.result.certificate)
    assert proof.valid
    assert proof.claim["delays"][0]["d"] == 20.0


@pytest.mark.slow
def test_a_greatest_delay_is_not_beyond_the_truth() -> None:
    """An unstable state, x' = x - 0.9 x(t-d) + u: more with each order, none past the loss."""
    system = DelaySystem(
        [[0, 0], [0, 1]],
        [[0], [1]],
        [[1], [1]],
        [[0, 1], [0, 0]],
        D2=[[0], [0.1]],
        delays=[Delay(1.0, [[-1, -1], [0, -0.9]])],
    )
    last = greatest_delay(system, 1.0, [-0.5], [1.0], search=True).delay
    for order in (0, 1):
        found = greatest_delay(system, 1.0, [-0.5], [1.0], order=order)
        assert last < found.delay < first_loss(loop_of(system, found.result.K), 0)
        at = loop_of(found.result.system, found.result.K)
        assert norm(at) < 1.0
        last = found.delay


def test_stability_alone_and_a_given_gamma_or_gain() -> None:
    """Without w and z the design is for stability; a gamma is met; a gain is analysed."""
    bare = DelaySystem(LINK.A, LINK.B, delays=LINK.delays)
    found = design(bare, [-0.5], [1.0], order=1)
    assert found.gamma is None
    assert found.abscissa < 0
    assert check_certificate(found.certificate).valid
    met = design(LINK, [-0.5], [1.0], order=1, gamma=4.0)
    assert met.gamma == 4.0
    assert norm(loop_of(LINK, met.K)) < 4.0
    given = design(LINK, [-0.5], [1.0], order=1, gain=met.K)
    assert given.gamma is not None
    assert given.gamma < 4.0
    with pytest.raises(NotAchievableError, match="not reached"):
        design(LINK, [-0.5], [1.0], order=1, gamma=3.0, alternatives=False)
    with pytest.raises(NotAchievableError, match="could not be certified"):
        design(LINK, [-0.5], [1.0], order=1, gain=[[0.0, 0.0]], alternatives=False)


def test_a_design_of_an_order_comes_back_from_its_file() -> None:
    """JSON there and back; a changed gain is refused."""
    found = design(LINK, [-0.5], [1.0], order=1)
    data = json.loads(json.dumps(found.to_json()))
    back = Result.from_json(data, where="design.json")
    assert np.array_equal(back.K, found.K)
    assert (back.order, back.gamma, back.k1, back.k2) == (1, found.gamma, (), ())
    assert back.certificate == found.certificate
    data["K"][0][0] *= 2
    with pytest.raises(InputError, match="does not hold"):
        Result.from_json(data, where="design.json")


def test_the_same_system_gives_the_same_design() -> None:
    """Same input, same bytes."""
    first, second = (design(LINK, [-0.5], [1.0], order=1) for _ in range(2))
    assert json.dumps(first.certificate) == json.dumps(second.certificate)


def test_invalid_order_is_refused() -> None:
    """An order out of range, no delay, no B."""
    for system, order in (
        (LINK, -1),
        (LINK, 13),
        (DelaySystem([[1.0]], [[1.0]]), 1),
        (DelaySystem([[-1.0]], delays=[Delay(1.0, [[0.1]])]), 1),
    ):
        N = len(system.delays)
        with pytest.raises(InputError):
            design(system, [-0.5] * N, [1.0] * N, order=order)
        if N:
            with pytest.raises(InputError):
                greatest_delay(system, None, [-0.5], [1.0], order=order)
