"""A proved damping ratio: as sharp as the roots are, never beyond them, and met by design."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext
from fractions import Fraction
from itertools import pairwise
from typing import Any

import flint
import numpy as np
import pytest
from scipy.special import lambertw
from shared import sampled
from truth_of_loops import collocated, loop_of

from cosim.core import InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, Result, analyse, check_certificate, design
from cosim.hinf.certificate import Damping, standalone, system_to_json
from cosim.hinf.exact import Contour
from cosim.hinf.synthesis import greatest_ratio

NO_GAIN = np.zeros((0, 1))


def _asked(ratio: float, within: float) -> Damping:
    return Damping(flint.fmpq(*ratio.as_integer_ratio()), flint.fmpq(*within.as_integer_ratio()))


def _true_ratio(system: DelaySystem, K: Any, within: float) -> float:
    """Least damping ratio of the roots with Re s >= -within, from a fine collocation; 1: none."""
    roots = np.linalg.eigvals(collocated(loop_of(system, K), 40)[0])
    near = roots[(roots.real >= -within) & (np.abs(roots) < 60)]
    return float((-near.real / np.abs(near)).min(initial=1.0))


@pytest.mark.parametrize(("a", "d", "within"), [(1.0, 1.0, 4.0), (2.0, 0.7, 0.4), (0.3, 1.0, 4.0)])
def test_the_ratio_is_sharp_where_the_roots_are_known(a: float, d: float, within: float) -> None:
    """x' = -a x(t-d): s = W_k(-a d)/d. Proved a billionth below the truth, refused above, twice."""
    loop = DelaySystem([[0.0]], delays=[Delay(d, [[-a]])])
    roots = [complex(lambertw(-a * d, k)) / d for k in range(-40, 40)]
    true = min(-s.real / abs(s) for s in roots if s.real >= -within)
    assert _asked(true * (1 - 1e-9), within).failure(loop, NO_GAIN) is None
    reason = str(_asked(true * (1 + 1e-9), within).failure(loop, NO_GAIN))
    assert "2 characteristic roots" in reason
    second = standalone.Loop(standalone.loaded(json.dumps(system_to_json(loop)).encode()))
    standalone.damped(second, Fraction(true * (1 - 1e-9)), Fraction(within))
    with pytest.raises(standalone.RefusedError, match="2 roots"):
        standalone.damped(second, Fraction(true * (1 + 1e-9)), Fraction(within))
    assert greatest_ratio(loop, NO_GAIN, _asked(0.5, within).within) == int(1000 * true) / 1000


def test_roots_further_left_do_not_count_and_the_others_all_do() -> None:
    """x' = -x(t-1): a pair at -0.318 +- 1.337j; nothing counts right of it, all pairs far left."""
    loop = DelaySystem([[0.0]], delays=[Delay(1.0, [[-1.0]])])
    assert _asked(0.999, 0.318).failure(loop, NO_GAIN) is None
    for within, count in ((0.319, 2), (2.1, 4), (2.7, 6), (4.0, 18)):
        roots = [complex(lambertw(-1, k)) for k in range(-40, 40)]
        assert sum(s.real >= -within for s in roots) == count
        reason = str(_asked(0.999, within).failure(loop, NO_GAIN))
        assert reason.startswith(f"{count} characteristic roots")


@pytest.mark.parametrize("seed", sampled(range(6), 3))
def test_the_ratio_is_that_of_a_fine_discretisation(seed: int) -> None:
    """Random loops of two to five states and two delays: within a thousandth of the truth."""
    rng = np.random.default_rng([14, seed])
    n = 2 + seed % 4
    A = rng.standard_normal((n, n)) - 2.0 * np.eye(n)
    late = [
        Delay(0.3, 0.5 * rng.standard_normal((n, n))),
        Delay(0.8, np.zeros((n, n)), feedback=True),
    ]
    system = DelaySystem(A, rng.standard_normal((n, 1)), delays=late)
    K = 0.3 * rng.standard_normal((1, n))
    for within in (0.7, 2.0):
        true = _true_ratio(system, K, within)
        proved = _asked(max(true - 1e-3, 1e-3), within).failure(system, K) is None
        assert proved == (true > 0)
        if 0 < true < 0.999:
            assert _asked(true + 1e-3, within).failure(system, K) is not None


def test_a_root_at_zero_or_on_the_line_of_the_sector_is_no_proof() -> None:
    """An integrator, and -3 +- 4j at a ratio of 0.6 to the last digit: refused, not crashed."""
    assert _asked(0.5, 1.0).failure(DelaySystem([[0.0]]), NO_GAIN) is not None
    oscillator = DelaySystem([[-3.0, 4.0], [-4.0, -3.0]])
    on = Damping(flint.fmpq(3, 5), flint.fmpq(5))
    assert on.failure(oscillator, np.zeros((0, 2))) is not None
    assert _asked(0.5999999, 5.0).failure(oscillator, np.zeros((0, 2))) is None


def test_units_of_the_states_change_nothing() -> None:
    """A pair of 0.6 whose states count in mm and km: both checkers balance, and need few steps."""
    T = np.diag([1e-6, 1e6])
    system = DelaySystem(np.linalg.inv(T) @ [[-3.0, 4.0], [-4.0, -3.0]] @ T)
    data = standalone.loaded(json.dumps(system_to_json(system)).encode())
    for ratio, holds in ((0.599, True), (0.601, False)):
        assert (_asked(ratio, 5.0).failure(system, np.zeros((0, 2))) is None) == holds
        outcome = nullcontext() if holds else pytest.raises(standalone.RefusedError)
        with outcome:
            standalone.damped(standalone.Loop(data), Fraction(ratio), Fraction(5))


def test_no_step_is_longer_than_its_bound() -> None:
    """x' = -x(t-10), where e^{-d Re s} triples on a step: det H changes by less than itself."""
    loop = flint.fmpq_mat([[-1]])
    start, end = (flint.acb(2 * complex(-1, math.sqrt(1 / 0.99**2 - 1)) * x) for x in (0, 1))
    points = [complex(c) for c, _ in Contour({10.0: loop}).walk(start, end)]
    assert len(points) > 20
    for c, following in pairwise(points):
        s = c + np.linspace(0, 1, 50) * (following - c)
        assert np.abs((s + np.exp(-10 * s)) / (c + np.exp(-10 * c)) - 1).max() < 1


NETWORKED = DelaySystem(
    [[0, 1], [0, -0.1]],
    [[0], [0.1]],
    C=[[0], [1]],
    D=[[1, 0], [0, 0]],
    D2=[[0], [0.1]],
    delays=[Delay(0.5, np.zeros((2, 2)), feedback=True, any_age=True)],
)


@pytest.fixture(scope="module")
def plain() -> Result:
    """The networked loop designed without damping."""
    return design(NETWORKED)


@pytest.mark.slow
def test_a_design_meets_the_damping_that_the_least_gamma_misses(plain: Result) -> None:
    """The networked loop: .46 without, 0.7 with; gamma grows a little; the file proves it again."""
    assert plain.gamma is not None
    assert 0.4 < _true_ratio(NETWORKED, plain.K, 3.0) < 0.5
    found = design(NETWORKED, damping=0.7, within=3.0)
    assert found.gamma is not None
    assert plain.gamma < found.gamma < 1.3 * plain.gamma
    assert _true_ratio(NETWORKED, found.K, 3.0) > 0.7
    saved = json.loads(json.dumps(found.to_json()))
    assert check_certificate(saved).valid
    assert "nominal loop (F = 0" in saved["theorem"][-1]
    assert Result.from_json(saved, where="file").to_json() == saved
    # the claim is that of this gain
    other = {**plain.certificate, "guarantees": saved["guarantees"]}
    other["claim"] = {**other["claim"], "guarantees": saved["claim"]["guarantees"]}
    del other["theorem"]
    assert "damping: 2 characteristic roots" in str(check_certificate(other).reason)


def test_a_gamma_to_meet_goes_with_damping() -> None:
    """2.5 is met."""
    assert design(NETWORKED, gamma=2.5, damping=0.6, within=3.0).gamma == 2.5


@pytest.mark.slow
def test_a_gamma_that_damping_does_not_leave_is_refused(plain: Result) -> None:
    """Hardly above that of the design without damping: the message says so."""
    assert plain.gamma is not None
    with pytest.raises(NotAchievableError, match="design constraints") as refused:
        design(
            NETWORKED,
            gamma=1.01 * plain.gamma,
            damping=0.8,
            within=3.0,
            order=None,
            alternatives=False,
        )
    assert "was not reached" in str(refused.value.got)


def test_a_gain_that_is_damped_already_is_kept(plain: Result) -> None:
    """No other gain than without the constraint; its proof is in the certificate."""
    found = design(NETWORKED, damping=0.4, within=3.0)
    assert found.K.tolist() == plain.K.tolist()
    assert found.certificate["claim"].keys() - plain.certificate["claim"].keys() == {"guarantees"}


@pytest.mark.slow
def test_damping_stands_beside_the_other_constraints() -> None:
    """Decay and |K| with it: all three proved of one gain."""
    found = design(NETWORKED, damping=0.6, within=3.0, decay=0.2, gain_limit=12.0)
    assert set(found.certificate["claim"]["guarantees"]) == {"damping", "decay", "gain_limit"}
    assert check_certificate(found.certificate).valid
    assert _true_ratio(NETWORKED, found.K, 3.0) > 0.6


@pytest.mark.slow
def test_feedback_of_single_states_takes_damping() -> None:
    """Only a position is fed back, late: without damping 0.35, with it the same proof."""
    late = np.zeros((2, 2))
    system = DelaySystem(
        [[0, 1], [-1, -1.2]],
        [[0], [1]],
        C=[[0], [1]],
        D=[[1, 0], [0, 0]],
        D2=[[0], [0.1]],
        delays=[Delay(0.2, late, feedback=(True, False))],
    )
    found = design(system, damping=0.5, within=3.0)
    assert found.K[0, 1] == 0
    assert greatest_ratio(system, found.K, flint.fmpq(3)) >= 0.5
    assert check_certificate(found.certificate).claim["guarantees"]["damping"]["ratio"] == "1/2"


def test_what_no_gain_can_damp_is_refused_with_the_best_ratio() -> None:
    """A mode at -0.1 +- j that no input moves has 0.0995, whatever K is."""
    mode = [[-0.1, 1, 0], [-1, -0.1, 0], [0, 0, 0]]
    system = DelaySystem(mode, [[0], [0], [1]])
    assert design(system, damping=0.09, within=1.0).guarantees.damping is not None
    with pytest.raises(NotAchievableError) as refused:
        design(system, damping=0.2, within=1.0, alternatives=False)
    assert "0.2 where Re s >= -1/s" in str(refused.value.expected)
    assert "a damping ratio of 0.099, the best of" in str(refused.value.got)


def test_an_analysis_proves_the_damping_of_its_gain_or_counts_the_roots() -> None:
    """In the certificate where it is proved; a reason where it is not, gamma certified."""
    K = [[-6.839, -13.496]]
    proved = analyse(NETWORKED, K, damping=0.4, within=3.0, order=0)
    assert proved.certificate is not None
    assert proved.damping_reason is None
    assert check_certificate(proved.certificate).claim["guarantees"].keys() == {"damping"}
    missed = analyse(NETWORKED, K, damping=0.5, within=3.0, order=0)
    assert missed.certified
    assert missed.certificate is not None
    assert "guarantees" not in missed.certificate
    assert "2 characteristic roots" in str(missed.damping_reason)


@pytest.mark.parametrize(
    ("damping", "within", "where"),
    [
        (0.5, None, "within"),
        (None, 1.0, "damping"),
        (0.0, 1.0, "damping"),
        (1.0, 1.0, "damping"),
        (float("nan"), 1.0, "damping"),
        (0.5, 0.0, "within"),
        (0.5, float("inf"), "within"),
        (0.5, 50.0, "within"),  # e^{50 d} is beyond any proof
    ],
)
def test_what_is_no_damping_is_named(damping: float, within: float, where: str) -> None:
    """One without the other, out of range, or too far to the left; in both verbs."""
    for verb in (design, analyse):
        with pytest.raises(InputError) as refused:
            verb(NETWORKED, damping=damping, within=within)
        assert refused.value.where == where


def test_a_sampled_age_has_no_roots_to_damp() -> None:
    """Bad input where it is asked for, and no proof where a file claims it."""
    sampled = Delay(0.5, [[0.0]], feedback=True, sampled=True)
    system = DelaySystem([[0.0]], [[1.0]], delays=[sampled])
    with pytest.raises(InputError, match="sampled"):
        design(system, damping=0.5, within=1.0)
    assert "sampled" in str(_asked(0.5, 1.0).failure(system, np.array([[-0.5]])))
