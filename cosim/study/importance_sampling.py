"""Importance sampling: a small probability from points drawn where the event is.

A pilot, a subset simulation, leads to points in the event. A mixture of normal distributions with
one common deviation of at least 1 is fitted to them (expectation maximisation); of several mixtures
the one is taken whose weights vary least over points that it was not fitted to. Then independent
points are drawn from it, and the mean of their weights in the event is the estimate: unbiased
whatever the pilot found, with a standard deviation from the points themselves.

What neither pilot nor sample meets is in no estimate. So the estimate is refused if its effective
sample size is small, or if it and the pilot's contradict each other.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.study.rare_events import RareEstimate, Reals
from cosim.study.subset_simulation import CHAIN, Population, descend, grow

LEAST_EFFECTIVE = 30.0
"""Effective sample size below which there is no estimate."""
_CONTRADICTION = 3.3  # standard deviations of the logarithms
_COMPONENTS = (1, 2, 4)
_ITERATIONS = 20
_BETTER = 0.9  # a larger mixture is taken if its weights vary less by so much


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
    rng = np.random.default_rng([seed, 1])
    first, last = yield from descend(rng, dimensions, pilot, levels, rough)
    if first.probability is None:
        return replace(first, reason=f"the pilot did not find the event: {first.reason}")
    inside = rng.permutation(np.flatnonzero(last.beyond > 0.0))[: pilot // CHAIN]
    event: Population = yield from grow(rng, last, inside, 0.0, rough, strictly=True)
    smooth = np.ones(dimensions, np.bool_) if rough is None else ~rough
    mixture = _fitted(event.points[:, smooth], rng)
    # streams of their own, so that more samples begin with fewer
    points = np.random.default_rng([seed, 2]).standard_normal((samples, dimensions))
    points[:, smooth] = mixture.placed(
        points[:, smooth], np.random.default_rng([seed, 3]).random(samples)
    )
    beyond = yield points
    return _estimate(np.where(beyond > 0.0, mixture.weights(points[:, smooth]), 0.0), first)


def _estimate(weights: Reals, first: RareEstimate) -> RareEstimate:
    """Return the estimate from the weights, 0 outside the event; `first` is the pilot's."""
    total = math.fsum(weights)
    if total == 0.0:
        return replace(
            first, probability=None, deviation=None, effective=0.0, reason="no point in the event"
        )
    probability = total / weights.size
    effective = total**2 / math.fsum(weights**2)
    deviation = float(weights.std(ddof=1)) / math.sqrt(weights.size) / probability
    found = RareEstimate(
        probability=probability,
        deviation=deviation,
        logarithm=math.log(probability),
        freedom=max(1.0, effective - 1.0),
        levels=first.levels,
        effective=effective,
    )
    apart = abs(found.logarithm - first.logarithm) / math.hypot(deviation, first.deviation or 0.0)
    why = None
    if effective < LEAST_EFFECTIVE:
        why = (
            f"the effective sample size is {effective:.3g} of {weights.size}, below "
            f"{LEAST_EFFECTIVE:g}: more samples, a larger pilot, or method = 'subset'"
        )
    elif apart > _CONTRADICTION:
        why = (
            f"the pilot finds {first.probability:.2g}, the sample {probability:.2g}: one of them "
            "missed a part of the event; a larger pilot, or method = 'subset'"
        )
    if why is None:
        return found
    return replace(found, probability=None, deviation=None, reason=why)


@dataclass(frozen=True)
class _Mixture:
    """Normal distributions with centres (components, dimensions) and one deviation."""

    shares: Reals
    centres: Reals
    deviation: float

    def logarithms(self, x: Reals) -> Reals:
        """Return the logarithm of each component's density at x, less that of standard normal."""
        away = np.sum(((x[:, None] - self.centres) / self.deviation) ** 2, axis=2)
        whole = 0.5 * np.sum(x * x, axis=1)[:, None] - 0.5 * away
        found: Reals = np.log(self.shares) + whole - x.shape[1] * math.log(self.deviation)
        return found

    def weights(self, x: Reals) -> Reals:
        """Return the standard normal density over that of the mixture."""
        found: Reals = np.exp(-np.logaddexp.reduce(self.logarithms(x), axis=1))
        return found

    def placed(self, z: Reals, u: Reals) -> Reals:
        """Return points of the mixture from standard normal z and uniform u."""
        which = np.searchsorted(np.cumsum(self.shares)[:-1], u, "right")
        found: Reals = self.centres[which] + self.deviation * z
        return found


def _fitted(x: Reals, rng: np.random.Generator) -> _Mixture:
    """Return the mixture whose weights vary least over points in the event, (points, dims).

    The mean of the weights over points in the event is the variance of the estimate, but for a
    factor; half of the chains are held out to compute it.
    """
    if not x.shape[1]:
        return _Mixture(np.ones(1), np.zeros((1, 0)), 1.0)
    odd = np.arange(len(x)) % 2 == 1  # chains alternate where their number is even
    best, least = (1, False), math.inf
    for wider in (False, True):
        for count in _COMPONENTS:
            halves: Sequence[NDArray[np.bool_]] = (odd, ~odd)
            vary = math.fsum(
                float(np.mean(_maximised(x[half], count, rng, wider=wider).weights(x[~half])))
                for half in halves
            )
            if vary < _BETTER * least:
                best, least = (count, wider), vary
    return _maximised(x, best[0], rng, wider=best[1])


def _maximised(x: Reals, count: int, rng: np.random.Generator, *, wider: bool) -> _Mixture:
    first = x[rng.choice(len(x), count, replace=False)]
    mixture = _Mixture(np.full(count, 1.0 / count), first, 1.0)
    for _ in range(_ITERATIONS):
        logs = mixture.logarithms(x)
        mine = np.exp(logs - np.logaddexp.reduce(logs, axis=1)[:, None])
        sums = mine.sum(axis=0) + 1e-9
        centres = np.sum(mine[:, :, None] * x[:, None], axis=0) / sums[:, None]
        deviation = 1.0
        if wider:
            away = np.sum((x[:, None] - centres) ** 2, axis=2)
            deviation = max(1.0, math.sqrt(float(np.sum(mine * away)) / x.size))
        mixture = _Mixture(sums / sums.sum(), centres, deviation)
    return mixture
