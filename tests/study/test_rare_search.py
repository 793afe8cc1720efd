"""Intervals of rare events hold, or are refused: several regions, islands, what one search missed.

Each problem has a closed form. Without two populations, the exploration and the check of regions
these intervals cover 0 to 70 % of the time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats
from shared import share_of
from study.rare_problems import (
    ISLANDS,
    MODES,
    PLAIN,
    Problem,
    ball,
    box,
    chi_square,
    linear,
    only_ball,
    two_planes,
)

from cosim.study import RareEstimate, estimated, importance_sampling, subset_simulation


def one(problem: Problem, method: str, seed: int, samples: int = 1000) -> RareEstimate:
    """One estimate."""
    make: Any = subset_simulation(problem.dimensions, samples, 12, seed)
    if method == "importance":
        make = importance_sampling(problem.dimensions, samples, samples, 12, seed)
    return estimated(make, problem.limit)


def covered(problem: Problem, method: str, repeats: int) -> tuple[int, int]:
    """Return how many intervals are given, and how many of them cover the truth."""
    found = [one(problem, method, seed) for seed in range(repeats)]
    given = [each.interval(0.95) for each in found if each.probability is not None]
    return len(given), sum(low <= problem.truth <= high for low, high in given)


def check_coverage(problem: Problem, method: str, repeats: int) -> None:
    """Fail if fewer are covered than has a probability of 1e-3 at 93 %, or plain ones refused."""
    given, inside = covered(problem, method, repeats)
    assert inside >= stats.binom.ppf(1e-3, given, 0.93), (problem.name, method, inside, given)
    if problem.kind == "plain":
        refused = repeats - given
        assert refused <= stats.binom.isf(1e-3, repeats, 0.05), (problem.name, method, refused)


STEEP = two_planes(3, 3.5, 3.5, 4.0)
HIDDEN = box(5, 3.5, 4.0, 0.8, flat=True)


@pytest.mark.parametrize("problem", [linear(5, 3.5), chi_square(3, 4.0)], ids=lambda p: p.name)
@pytest.mark.parametrize("method", ["subset", "importance"])
def test_one_region_has_an_interval(problem: Problem, method: str) -> None:
    check_coverage(problem, method, 25)


@pytest.mark.parametrize("problem", [STEEP, HIDDEN], ids=lambda p: p.name)
def test_subset_simulation_tells_nothing_of_several_regions(problem: Problem) -> None:
    """Its chains find one of them, or too much of the other; the reason says so."""
    found = [one(problem, "subset", seed) for seed in range(25)]
    assert sum(each.probability is None for each in found) >= 24
    words = " ".join(each.reason or "" for each in found)
    assert "regions that do not hang together" in words
    assert "method = 'importance' samples each" in words


@pytest.mark.parametrize("problem", [STEEP, HIDDEN], ids=lambda p: p.name)
def test_importance_sampling_finds_each_region(problem: Problem) -> None:
    """Also what the metric does not lead to: the exploration does."""
    given, inside = covered(problem, "importance", 25)
    assert given >= 8
    assert inside >= stats.binom.ppf(1e-3, given, 0.93)


@pytest.mark.slow
@pytest.mark.parametrize("problem", share_of([*PLAIN, *MODES, *ISLANDS]), ids=lambda p: p.name)
@pytest.mark.parametrize("method", ["subset", "importance"])
def test_intervals_hold_or_are_refused(problem: Problem, method: str) -> None:
    """Over 120 repeats of each; `tests.benchmarks.rare_coverage` has more."""
    check_coverage(problem, method, 120)


def test_what_the_exploration_cannot_meet_has_no_interval() -> None:
    """A ball in 12 dimensions: nothing that is wide meets it, so another may be there."""
    found = one(only_ball(12, 4.0, 2.6), "subset", 1)
    assert found.probability is None
    assert "cannot be told" in (found.reason or "")


def test_populations_that_disagree_are_named() -> None:
    """Another limit for each half of the points: one population finds ten times the other."""

    def limit(u: Any) -> Any:
        half = np.arange(len(u)) < len(u) // 2
        return u[:, 0] - np.where(half, 2.0, 3.0)

    found = estimated(subset_simulation(2, 1000, 12, 1), limit)
    assert found.probability is None
    assert "two independent populations find" in (found.reason or "")
    assert found.to_json(0.95)["low"] is None
    assert len(found.to_json(0.95)["populations"]) == 2


@pytest.mark.parametrize("problem", [linear(3, 3.5), chi_square(10, 3.5), ball(2, 3.5, 4.0, 1.0)])
def test_the_exploration_is_right_in_the_mean(problem: Problem) -> None:
    """By the indicator alone; its deviation is that of its estimates."""
    smooth = np.ones(problem.dimensions, np.bool_)
    beta = float(stats.norm.isf(problem.truth))
    ratios, stated = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        found: Any = estimated(
            explore(rng, problem.dimensions, 2000, beta, smooth),
            lambda u: np.where(problem.limit(u) > 0.0, 1.0, -1.0),
        )
        ratios.append(found.probability / problem.truth)
        stated.append(found.deviation)
    spread = float(np.std(ratios, ddof=1))
    assert abs(np.mean(ratios) - 1.0) < 3.5 * spread / math.sqrt(60) + 0.02
    assert 0.6 < np.median(stated) / spread < 1.8


def test_arcs_tell_regions_apart() -> None:
    """A half-space and the outside of a ball are one region, opposite planes two: with shares."""
    rng = np.random.default_rng(1)

    def of(problem: Problem, away: Any) -> Any:
        x = rng.standard_normal((400, problem.dimensions))
        x = away(x)
        assert np.all(problem.limit(x) > 0.0)
        found = Found(x, np.arange(len(x)))
        return estimated(regions_of(rng, [found, found]), problem.limit)

    def beyond(x: Any) -> Any:
        first = 3.0 + rng.exponential(0.3, len(x))
        return np.column_stack([first * np.where(rng.random(len(x)) < 0.3, -1.0, 1.0), x[:, 1:]])

    one_sided = of(two_planes(8, 3.0, 9.0), lambda x: np.abs(beyond(x)) * [1.0, *[0.3] * 7])
    assert one_sided.count == 1
    outside = of(
        chi_square(6, 3.0),
        lambda x: x / np.linalg.norm(x, axis=1)[:, None] * (5.0 + rng.random((len(x), 1))),
    )
    assert outside.count == 1
    both = of(two_planes(8, 3.0, 3.0), beyond)
    assert both.count == 2
    assert np.sort(both.shares[0]) == pytest.approx([0.3, 0.7], abs=0.1)
    assert both.variances[0] == pytest.approx([0.3 * 0.7 / 400] * 2, rel=0.3)


def test_points_beyond_a_radius_are_those_of_the_standard_normal() -> None:
    """Their squared length is a chi-square number above a bound, their direction is even."""
    mixture = Mixture(np.ones(1), np.zeros((1, 4)), np.ones(1), np.array([3.0]))
    rng = np.random.default_rng(3)
    x = mixture.placed(rng.standard_normal((4000, 4)), rng.random(4000))
    tail = stats.chi2.sf(np.sum(x * x, axis=1), 4) / stats.chi2.sf(9.0, 4)
    assert stats.kstest(tail, "uniform").pvalue > 0.01
    assert abs(x.mean()) < 4.0 * 3.5 / 2.0 / math.sqrt(16000)
    assert mixture.weights(x) == pytest.approx(stats.chi2.sf(9.0, 4))


def test_a_region_of_one_point_has_a_component() -> None:
    """As one of which only a representative was found; the weights there are bounded."""
    rng = np.random.default_rng(1)
    lone = np.array([[-4.0, 0.0, 0.0]])
    mixture = fitted([(0.5, [lone[:0], lone]), (0.5, [-lone + 0.1, -lone])], rng)
    assert math.fsum(mixture.shares) == pytest.approx(1.0)
    assert float(mixture.weights(lone)[0]) < 0.01


def test_the_same_seed_gives_the_same() -> None:
    for method in ("subset", "importance"):
        assert one(STEEP, method, 3) == one(STEEP, method, 3)
