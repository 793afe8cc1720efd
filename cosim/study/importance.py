"""Importance sampling: a small probability from points drawn where the event is.

A pilot (`search`: two populations and an exploration) leads to points in every region of the event
that it found. A mixture with defensive components is fitted to them, region by region (`mixture`).
Then independent points are drawn from it, and the mean of their weights in the event is the
estimate: unbiased whatever the pilot found, with a standard deviation from the points themselves.

What neither pilot nor sample meets is in no estimate. So the estimate is refused if its effective
sample size is small, in all or in one region, if the pilot or the exploration found more of the
event than it, beyond chance, or if the exploration met nothing and so excludes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.study.descent import CHAIN, Population, grow
from cosim.study.mixture import fitted
from cosim.study.rare_events import RareEstimate, Reals
from cosim.study.regions import Regions
from cosim.study.search import LEAST_SHARE, Search, halves_of, missed_by, search, together

LEAST_EFFECTIVE = 30.0
"""Effective sample size below which there is no estimate; in many dimensions twice their number."""
_LEAST_IN_REGION = 30.0
_APART = 2.8  # standard deviations between the shares of a region
_SKEWED = 4.0
"""Effective points for each degree of freedom of the interval: weights are skewed (measured)."""


def importance_sampling(
    dimensions: int,
    samples: int,
    pilot: int,
    levels: int,
    seed: int,
    rough: NDArray[np.bool_] | None = None,
) -> Generator[Reals, Reals, RareEstimate]:
    """Estimate a probability by importance sampling.

    samples : independent points from the fitted mixture.
    pilot : points of each level of the pilot, a multiple of 10.
    levels : most levels of the pilot.
    rough : dimensions in which the metric is not continuous: no mixture is fitted to them.
    """
    rng = tuple(np.random.default_rng([seed, 1, k]) for k in range(3))
    found = yield from search(rng, dimensions, pilot, levels, rough)
    first = found.estimate
    if first.probability is None:
        return replace(first, reason=f"the pilot did not find the event: {first.reason}")
    smooth = np.ones(dimensions, np.bool_) if rough is None else ~rough
    parts: list[Population] = yield from _event(rng, found, pilot, rough)
    mixture = fitted(_halves(parts, found.regions, smooth), rng[0])
    # streams of their own, so that more samples begin with fewer
    points = np.random.default_rng([seed, 2]).standard_normal((samples, dimensions))
    points[:, smooth] = mixture.placed(
        points[:, smooth], np.random.default_rng([seed, 3]).random(samples)
    )
    beyond = yield points
    weights = np.where(beyond > 0.0, mixture.weights(points[:, smooth]), 0.0)
    return _estimate(weights, points, found)


def _event(
    rng: tuple[np.random.Generator, ...],
    found: Search,
    pilot: int,
    rough: NDArray[np.bool_] | None,
) -> Generator[Reals, Reals, list[Population]]:
    """Return points in the event: of each population and, as many as of one, of the exploration."""
    starts = []
    for own, last, half in zip(rng, found.last, halves_of(pilot), strict=False):
        inside = own.permutation(np.flatnonzero(last.beyond > 0.0))[: half // CHAIN]
        starts.append((last, inside))
    seen = found.exploration
    if seen is not None and len(seen.points):
        there = Population(seen.points, np.ones(len(seen.points)), seen.family)
        starts.append((there, rng[-1].permutation(len(seen.points))[: pilot // 2 // CHAIN]))
    grown = yield from together(
        [
            grow(own, before, start, 0.0, rough, strictly=True)
            for own, (before, start) in zip(rng, starts, strict=False)
        ]
    )
    return grown


def _halves(
    parts: list[Population], regions: Regions | None, smooth: NDArray[np.bool_]
) -> list[tuple[float, list[Reals]]]:
    """Return what each region's part of the mixture is fitted to: its share, two halves of points.

    A population is in one half, the exploration by families in both.
    """
    half = [
        np.full(len(part.points), k) if k < 2 else part.family % 2 for k, part in enumerate(parts)
    ]
    points, side = np.concatenate([part.points for part in parts]), np.concatenate(half)
    if regions is None or regions.count == 1:
        return [(1.0, [points[side == k][:, smooth] for k in (0, 1)])]
    shares = regions.shares.mean(axis=0)
    shares = np.where(regions.shares.max(axis=0) < LEAST_SHARE, 0.0, shares)
    shares = 0.5 * shares / shares.sum() + 0.5 * (shares > 0.0) / np.count_nonzero(shares)
    # each region has at least the points by which it was found
    found = regions.representatives
    points = np.concatenate([points, found])
    side = np.concatenate([side, np.arange(len(found)) % 2])
    region = regions.of(points)
    return [
        (float(share), [points[(region == k) & (side == j)] for j in (0, 1)])
        for k, share in enumerate(shares)
        if share > 0.0
    ]


def _estimate(weights: Reals, points: Reals, search: Search) -> RareEstimate:
    """Return the estimate from the points and their weights, 0 outside the event."""
    total = math.fsum(weights)
    first = search.estimate
    if total == 0.0:
        return replace(first.refused("no point in the event"), effective=0.0)
    probability = total / weights.size
    effective = total**2 / math.fsum(weights**2)
    deviation = float(weights.std(ddof=1)) / math.sqrt(weights.size) / probability
    found = replace(
        first,
        probability=probability,
        deviation=deviation,
        logarithm=math.log(probability),
        freedom=max(1.0, effective / _SKEWED),
        effective=effective,
    )
    why = None
    least = max(LEAST_EFFECTIVE, 2.0 * points.shape[1])  # or the mixture fits by chance
    if effective < least:
        why = (
            f"the effective sample size is {effective:.3g} of {weights.size}, below "
            f"{least:g}: more samples, a larger pilot, or method = 'subset'"
        )
    else:
        fewest, sparse = _by_region(weights, points, search.regions)
        # an interval is as good as what is known of the region that is known least; halved since
        # its part of the mixture was fitted to fewer points (measured: ten dimensions, two planes)
        found = replace(found, freedom=max(1.0, min(effective, fewest / 2.0) / _SKEWED))
        why = missed_by(found, search) or sparse
    return found if why is None else found.refused(why)


def _by_region(weights: Reals, points: Reals, regions: Regions | None) -> tuple[float, str | None]:
    """Return the least effective sample size of a region, and what is wrong with a region.

    Wrong are too few effective points, or another share of the probability than was explored.
    """
    fewest = math.inf
    if regions is None or regions.count == 1:
        return fewest, None
    over = weights > 0.0
    region, w = regions.of(points[over]), weights[over]
    for k in range(regions.count):
        mine = np.where(region == k, w, 0.0)
        share = float(mine.sum() / w.sum())
        explored = float(regions.shares[-1, k])
        if max(share, explored) < LEAST_SHARE:
            continue
        effective = float(mine.sum() ** 2 / max((mine**2).sum(), 1e-300))
        off = float(np.sum((w * ((region == k) - share)) ** 2)) / float(w.sum()) ** 2
        z = abs(share - explored) / math.sqrt(off + regions.variances[-1, k] + 1e-30)
        fewest = min(fewest, effective)
        if effective < max(_LEAST_IN_REGION, 4.0 * points.shape[1]) or z > _APART:
            return fewest, (
                f"the event has {regions.count} regions that do not hang together, and of one of "
                f"them the sample has {effective:.3g} effective points and {100 * share:.2g} % of "
                f"the probability, the exploration {100 * explored:.2g} %: more samples, or a "
                "larger pilot"
            )
    return fewest, None
