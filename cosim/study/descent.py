"""The descent of one population to a rare event, level by level (Au and Beck 2001).

The first level is plain Monte Carlo. The tenth of its points that are farthest towards the bound
start chains, whose points stay in the event "at least as far" and have the conditional
distribution; the tenth of these that are farthest start the next level, until a tenth is beyond the
bound. A chain moves by x' = sqrt(1 - s^2) x + s xi (preconditioned Crank-Nicolson), which leaves
the standard normal distribution as it is, in any number of dimensions; s adapts to an acceptance
of 0.44 (Papaioannou et al. 2015).

The deviation that is stated is the larger of two. Au and Beck's adds up, over the levels, the
binomial variance times 1 + the correlations along the chains. The other takes all points of all
levels that descend from one point of the first level as a family, and families as independent; it
includes what chains with a common ancestor, and levels, have in common.

Levels that adapt make a product too large in the mean, by half the square of its deviation, which
is taken off; the rest of the bias is of a smaller order in 1 / samples.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.study.rare_events import Level, RareEstimate, Reals

CHAIN = 10
"""Points of a chain, the first included; a tenth of the points of a level start chains."""
_ACCEPTANCE = 0.44
_FIRST_SCALE = 0.6


@dataclass(frozen=True)
class Population:
    """The points of a level.

    points : (samples, dimensions); in a level with chains, step by step.
    beyond : by how much the metric is beyond its bound, (samples,).
    family : number of the ancestor in the first level, (samples,).
    scale : of the moves.
    acceptance : of the moves; None in the first level.
    """

    points: Reals
    beyond: Reals
    family: NDArray[np.int64]
    scale: float = _FIRST_SCALE
    acceptance: float | None = None


def descend(
    rng: np.random.Generator,
    dimensions: int,
    samples: int,
    levels: int,
    rough: NDArray[np.bool_] | None = None,
) -> Generator[Reals, Reals, tuple[RareEstimate, Population]]:
    """Estimate a probability; return the points of the last level, too."""
    points = rng.standard_normal((samples, dimensions))
    beyond = yield points
    here = Population(points, beyond, np.arange(samples))
    seeds = samples // CHAIN
    passed: list[Level] = []
    influence = np.zeros(samples)  # of each family on the logarithm of the estimate
    logarithm = 0.0
    bound = -math.inf
    while True:
        over = here.beyond > 0.0
        last = int(over.sum()) >= seeds
        threshold = 0.0 if last else float(np.sort(here.beyond)[-seeds])
        if not last:
            over = here.beyond >= threshold
            stuck = threshold <= bound or threshold == -math.inf
            if stuck or len(passed) == levels - 1:
                passed.append(_level(here, over, threshold))
                why = _stuck(passed, levels) if stuck else _too_deep(passed, levels)
                return RareEstimate(None, None, logarithm, 1, tuple(passed), reason=why), here
        passed.append(_level(here, over, threshold))
        share = passed[-1].share
        logarithm += math.log(share)
        np.add.at(influence, here.family, (over - share) / (samples * share))
        if last:
            break
        bound = threshold
        start = np.argsort(-here.beyond, kind="stable")[:seeds]
        here = yield from grow(rng, here, start, bound, rough)
    own = math.fsum(level.deviation**2 for level in passed)
    variance = max(own, float(np.sum(influence**2)))
    return RareEstimate(
        probability=math.exp(logarithm - 0.5 * (variance - passed[-1].deviation ** 2)),
        deviation=math.sqrt(variance),
        logarithm=logarithm,
        freedom=max(1, len(np.unique(here.family)) - 1),
        levels=tuple(passed),
    ), here


def grow(
    rng: np.random.Generator,
    before: Population,
    start: NDArray[np.int64],
    bound: float,
    rough: NDArray[np.bool_] | None = None,
    *,
    strictly: bool = False,
) -> Generator[Reals, Reals, Population]:
    """Return chains from some points, in the event that the metric is at least `bound` beyond.

    strictly : in the event that it is more than that.
    """
    x, g = before.points[start], before.beyond[start]
    points, beyond, accepted = [x], [g], []
    scale = before.scale
    for step in range(1, CHAIN):
        s = min(1.0, scale)
        moved = math.sqrt(1.0 - s * s) * x + s * rng.standard_normal(x.shape)
        if rough is not None and rough.any() and not rough.all():
            keep = rng.random(len(x)) < 0.5
            moved = np.where(keep[:, None] & rough, x, moved)
        new = yield moved
        inside = new > bound if strictly else new >= bound
        x, g = np.where(inside[:, None], moved, x), np.where(inside, new, g)
        points.append(x)
        beyond.append(g)
        accepted.append(float(inside.mean()))
        scale *= math.exp((accepted[-1] - _ACCEPTANCE) / math.sqrt(step))
    return Population(
        np.concatenate(points),
        np.concatenate(beyond),
        np.tile(before.family[start], CHAIN),
        scale,
        float(np.mean(accepted)),
    )


def _level(here: Population, over: NDArray[np.bool_], threshold: float) -> Level:
    share = float(over.mean())
    chains = 0.0 if here.acceptance is None else _correlation(over, share)
    variance = (1.0 - share) / (share * over.size) * (1.0 + chains) if share > 0.0 else math.inf
    return Level(threshold, share, here.acceptance, chains, math.sqrt(variance))


def _correlation(over: NDArray[np.bool_], share: float) -> float:
    """Return gamma of Au and Beck's equation (29)."""
    variance = share * (1.0 - share)
    if variance == 0.0:
        return 0.0
    steps = over.reshape(CHAIN, -1)
    lags = range(1, CHAIN)
    rho = [(float(np.mean(steps[:-k] & steps[k:])) - share**2) / variance for k in lags]
    return max(0.0, 2.0 * math.fsum((1.0 - k / CHAIN) * r for k, r in zip(lags, rho, strict=True)))


def _stuck(passed: list[Level], levels: int) -> str:
    return (
        f"at level {len(passed)} of at most {levels} most runs have the same value, "
        f"{-passed[-1].beyond:.3g} from the bound: there is nothing to follow towards it"
    )


def _too_deep(passed: list[Level], levels: int) -> str:
    return (
        f"the bound is not reached after {levels} levels: {-passed[-1].beyond:.3g} from it, "
        f"where the probability is about {CHAIN**-levels:.0e}; more levels, or another bound"
    )
