"""Estimators of rare events against closed forms: right in the mean, with honest intervals."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats
from shared import sampled

from cosim.study import RareEstimate, estimated, importance_sampling, subset_simulation

Limit = Callable[[Any], Any]


def linear(probability: float, dimensions: int) -> Limit:
    """Beyond a plane at the distance beta."""
    beta = stats.norm.isf(probability)
    return lambda u: u.sum(axis=1) / math.sqrt(dimensions) - beta


def outside(probability: float, dimensions: int) -> Limit:
    """Outside a sphere: the squared distance is a chi-square number."""
    radius = stats.chi2.isf(probability, dimensions)
    return lambda u: np.sum(u * u, axis=1) - radius


def two_sided(probability: float, _: int) -> Limit:
    """Beyond either of two planes."""
    beta = stats.norm.isf(0.5 * probability)
    return lambda u: np.abs(u[:, 0]) - beta


CASES = {
    "1e-3": (linear, 1e-3, 3),
    "1e-7": (linear, 1e-7, 10),
    "many dimensions": (linear, 1e-4, 40),
    "chi-square": (outside, 1e-5, 5),
}


def subset(limit: Limit, dimensions: int, seed: int) -> RareEstimate:
    """One estimate."""
    return estimated(subset_simulation(dimensions, 1000, 12, seed), limit)


def importance(limit: Limit, dimensions: int, seed: int) -> RareEstimate:
    """One estimate."""
    return estimated(importance_sampling(dimensions, 1000, 1000, 12, seed), limit)


def check(found: list[RareEstimate], truth: float, least_share: float) -> None:
    """The mean is the truth within 3.5 standard errors; 95 % intervals cover it, but for chance."""
    known = [one for one in found if one.probability is not None]
    assert len(known) >= least_share * len(found)
    ratio = np.array([one.probability for one in known], float) / truth
    assert abs(ratio.mean() - 1.0) < 3.5 * ratio.std(ddof=1) / math.sqrt(ratio.size)
    covered = [low <= truth <= high for low, high in (one.interval(0.95) for one in known)]
    assert sum(covered) >= stats.binom.ppf(1e-3, len(known), 0.94)
    stated = np.median([one.deviation for one in known])
    assert 0.65 < stated / ratio.std(ddof=1) < 1.5


@pytest.mark.parametrize("case", sampled(CASES, 2))
def test_subset_simulation_finds_the_closed_form(case: str) -> None:
    make, truth, dimensions = CASES[case]
    limit = make(truth, dimensions)
    # comparisons object to what differs by chance alone, one in a hundred times
    check([subset(limit, dimensions, seed) for seed in range(100)], truth, 0.9)


@pytest.mark.parametrize("case", ["1e-7", "chi-square", "two-sided"])
def test_importance_sampling_finds_the_closed_form(case: str) -> None:
    make, truth, dimensions = {**CASES, "two-sided": (two_sided, 1e-5, 3)}[case]
    limit = make(truth, dimensions)
    check([importance(limit, dimensions, seed) for seed in range(12)], truth, 0.7)


def test_the_correlation_of_chains_is_in_the_deviation() -> None:
    """Independent points would give sqrt(levels (1 - p) / (p n)): too little."""
    found = subset(linear(1e-5, 2), 2, 1)
    assert found.deviation is not None
    alone = [(1.0 - level.share) / (level.share * 1000) for level in found.levels]
    assert found.deviation > 1.3 * math.sqrt(sum(alone))
    first, *later = found.levels
    assert first.correlation == 0.0
    assert all(level.correlation > 0.3 for level in later)
    assert all(0.3 < (level.acceptance or 0.44) < 0.6 for level in found.levels)


def test_the_same_seed_gives_the_same_and_another_seed_another() -> None:
    limit = linear(1e-4, 3)
    assert subset(limit, 3, 1) == subset(limit, 3, 1)
    assert subset(limit, 3, 1) != subset(limit, 3, 2)


def test_a_seed_among_the_dimensions_is_kept_by_every_second_move() -> None:
    """The event depends on a normal number and on noise that any move of the other changes."""

    def limit(u: Any) -> Any:
        noise = stats.norm.ppf((np.abs(u[:, 1]) * 1e6) % 1.0)
        return (u[:, 0] + 0.5 * noise) / math.sqrt(1.25) - stats.norm.isf(1e-4)

    rough = np.array([False, True])
    made = [estimated(subset_simulation(2, 1000, 12, s, rough), limit) for s in range(50)]
    check(made, 1e-4, 1.0)


def test_a_sample_that_is_too_small_gives_no_estimate() -> None:
    """In 100 dimensions the weights vary too much."""
    found = importance(linear(1e-5, 100), 100, 1)
    assert found.probability is None
    assert "effective sample size" in (found.reason or "")
    assert found.effective is not None
    assert found.effective < 100.0


def test_weights_of_a_sample_have_the_mean_one() -> None:
    """They are a ratio of densities, whatever the mixture: over all points, not the event's alone.

    The estimate of a limit that all points of the sample are said to be beyond is their mean.
    """
    for make, truth, dimensions in ((outside, 1e-3, 2), (two_sided, 1e-3, 2)):
        limit = make(truth, dimensions)
        means = []
        for seed in range(25):
            found = estimated(
                importance_sampling(dimensions, 8010, 1000, 12, seed),
                lambda u, limit=limit: np.ones(len(u)) if len(u) == 8010 else limit(u),
            )
            assert found.effective is not None
            assert found.effective > 10.0
            means.append(math.exp(found.logarithm))
        error = np.std(means, ddof=1) / math.sqrt(len(means))
        assert error < 0.05
        assert np.mean(means) == pytest.approx(1.0, abs=4.0 * error)


def test_a_sample_that_contradicts_its_pilot_gives_no_estimate() -> None:
    """The limit is another one when the sample, of 390 points, is drawn."""
    limit = linear(1e-3, 2)

    def moved(u: Any) -> Any:
        return limit(u) - (0.5 if len(u) == 390 else 0.0)

    found = estimated(importance_sampling(2, 390, 1000, 12, 1), moved)
    assert found.probability is None
    assert "missed a part of the event" in (found.reason or "")


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (lambda u: u[:, 0] - 9.0, "not reached after 4 levels"),
        (lambda u: np.minimum(u[:, 0], 1.0) - 2.0, "nothing to follow"),
        (lambda u: np.full(len(u), -math.inf), "nothing to follow"),
    ],
)
def test_an_event_that_is_not_reached_has_no_estimate(limit: Limit, words: str) -> None:
    """Too far, or a metric that no longer grows; the pilot says the same."""
    found = estimated(subset_simulation(2, 200, 4, 1), limit)
    assert found.probability is None
    assert words in (found.reason or "")
    piloted = estimated(importance_sampling(2, 200, 200, 4, 1), limit)
    assert "pilot did not find" in (piloted.reason or "")


def test_an_event_that_is_not_rare_is_plain_monte_carlo() -> None:
    """One level, the share itself, the binomial deviation."""
    found = estimated(subset_simulation(1, 1000, 4, 3), lambda u: u[:, 0])
    assert len(found.levels) == 1
    assert found.probability == pytest.approx(sum(found.populations) / 2, rel=1e-12)
    assert found.populations[0] == pytest.approx(found.levels[0].share, rel=1e-12)
    assert found.deviation == pytest.approx(1.0 / math.sqrt(1000), rel=0.05)
