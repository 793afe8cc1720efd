"""Exploration from far out: the probability and the places of an event, by its indicator alone.

Subset simulation goes where the metric leads. This goes another way, which no metric misleads:
points of a normal distribution several times as wide as the standard one meet any region of the
event that is not small in all dimensions at once; those in the event are then followed inwards,
the distribution narrowed step by step to the standard one (sequential importance sampling:
Papaioannou, Papadimitriou and Straub 2016, after Del Moral, Doucet and Jasra 2006). In each step
points are weighted by the ratio of the two distributions, drawn anew by their weights, and moved
within the event. So a region keeps a share of the points that is its share of the probability.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from cosim.study.rare_events import Reals

MOVES = 4
"""Moves of each point in a step."""
MOST_STEPS = 40
_WIDTHS = 1.6, 1.5, 3.0
_WORTH = 0.6  # effective share of the points that a step leaves
_ACCEPTANCE = 0.44
_PARTING = 40.0  # in so many dimensions copies of a point part so slowly that it doubles (measured)


@dataclass(frozen=True)
class Exploration:
    """What was found from far out.

    Attributes
    ----------
    width : standard deviation of the points at first.
    tried, met : points at first, and how many of them are in the event.
    probability, deviation : of the event, and its coefficient of variation; None if none is met.
    points : in the event, standard normal there, (count, dimensions).
    family : number of the ancestor at first, (count,).
    """

    width: float
    tried: int
    met: int
    probability: float | None
    deviation: float | None
    points: Reals
    family: NDArray[np.int64]


def explore(
    rng: np.random.Generator,
    dimensions: int,
    samples: int,
    beta: float,
    smooth: NDArray[np.bool_],
) -> Generator[Reals, Reals, Exploration]:
    """Follow an event inwards.

    samples : points at first, at least 100; a tenth of them is moved in each step.
    beta : about the distance of the event, as that of a plane of its probability.
    smooth : dimensions that are widened; the others stay standard normal.
    """
    part, least, most = _WIDTHS
    width = start = min(max(beta / part, least), most)
    x = rng.standard_normal((samples, dimensions))
    x[:, smooth] *= width
    inside = (yield x) > 0.0
    met = int(inside.sum())
    family = np.flatnonzero(inside)
    x = x[inside]
    if not met:
        return Exploration(start, samples, 0, None, None, x, family)
    logarithm = math.log(met / samples)
    # of each family on the logarithm
    influence = np.where(inside, 1.0 / met, 0.0) - 1.0 / samples
    scale = 0.6
    for _ in range(MOST_STEPS):
        squares = 0.5 * np.sum(x[:, smooth] ** 2, axis=1)
        narrower, weights = _narrower(squares, width)
        mean = float(weights.mean())
        logarithm += (
            math.log(mean)
            - float(squares.min()) * (narrower**-2 - width**-2)
            + int(smooth.sum()) * math.log(width / narrower)
        )
        np.add.at(influence, family, (weights / mean - 1.0) / weights.size)
        width = narrower
        chosen = _drawn(rng, weights / weights.sum(), samples // 10)
        x, family = x[chosen], family[chosen]
        for step in range(1, MOVES + 1):
            s = min(1.0, scale)
            noise = rng.standard_normal(x.shape)
            noise[:, smooth] *= width
            moved = math.sqrt(1.0 - s * s) * x + s * noise
            if not smooth.all():
                keep = rng.random(len(x)) < 0.5
                moved = np.where(keep[:, None] & ~smooth, x, moved)
            inside = (yield moved) > 0.0
            x = np.where(inside[:, None], moved, x)
            scale *= math.exp((float(inside.mean()) - _ACCEPTANCE) / math.sqrt(step))
        if width == 1.0:
            break
    deviation = math.sqrt(float(np.sum(influence**2))) * (1.0 + dimensions / _PARTING)
    return Exploration(start, samples, met, math.exp(logarithm), deviation, x, family)


def _narrower(squares: Reals, width: float) -> tuple[float, Reals]:
    """Return the next standard deviation, and the weight of each point, the greatest 1.

    squares : half the squared norm of each point.
    """
    away = squares - squares.min()

    def weights(to: float) -> Reals:
        found: Reals = np.exp(-away * (to**-2 - width**-2))
        return found

    def short(to: float) -> float:
        w = weights(to)
        return float(w.sum() ** 2 / (w.size * (w * w).sum())) - _WORTH

    if short(1.0) >= 0.0:
        return 1.0, weights(1.0)
    to = float(optimize.brentq(short, 1.0, width, xtol=1e-6))
    return to, weights(to)


def _drawn(rng: np.random.Generator, shares: Reals, count: int) -> NDArray[np.int64]:
    """Return indices, each about its share times (systematic resampling)."""
    places = (rng.random() + np.arange(count)) / count
    found = np.searchsorted(np.cumsum(shares), places, "right")
    return np.minimum(found, shares.size - 1).astype(np.int64)
