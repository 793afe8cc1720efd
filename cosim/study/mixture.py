"""A mixture of distributions about the points in an event, to draw an importance sample.

Two components are defensive, never without a share, and lead in no direction: the standard normal
distribution itself, but for what is nearer than the event, and a normal distribution about the
origin as wide as the points in the event are far. They meet what no point led to and bound the
weights there; the first is the best there is for an event on all sides. The others, normal with one
common deviation of at least 1, are fitted to the points (expectation maximisation). How many they
are, and whether they are wider than 1, is decided by points that a mixture was not fitted to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from cosim.study.rare_events import Reals

_COMPONENTS = (0, 1, 2, 4)
_DEFENSIVE = 0.05
_WITHIN = 0.99  # of the distance of the nearest point, beyond which a component is
_LEAST_POINTS = 20  # of a half that decides between mixtures
_ITERATIONS = 10
_AT_MOST = 400  # points of a half, to decide between mixtures
_BETTER = 0.95  # a larger mixture is taken if its weights vary less by so much


@dataclass(frozen=True)
class Mixture:
    """Distributions with a share each, (k,).

    centres, deviations : of normal distributions, (k, dimensions) and (k,).
    radii : (k,); where one is not 0 the component is not that, but the standard normal distribution
        farther than this from the origin.
    """

    shares: Reals
    centres: Reals
    deviations: Reals
    radii: Reals

    def logarithms(self, x: Reals) -> Reals:
        """Return the logarithm of each component's density at x, less that of standard normal."""
        squares, dimensions = np.sum(x * x, axis=1)[:, None], x.shape[1]
        away = squares - 2.0 * x @ self.centres.T + np.sum(self.centres**2, axis=1)
        found: Reals = 0.5 * squares - 0.5 * away / self.deviations**2
        found -= dimensions * np.log(self.deviations)
        outer = self.radii > 0.0
        radii = self.radii[outer] ** 2
        with np.errstate(divide="ignore"):
            tail = np.where(squares > radii, -np.log(special.chdtrc(dimensions, radii)), -np.inf)
        found[:, outer] = tail
        return found + np.log(self.shares)

    def weights(self, x: Reals) -> Reals:
        """Return the standard normal density over that of the mixture."""
        logs = self.logarithms(x)
        most = logs.max(axis=1)
        found: Reals = np.exp(-most) / np.exp(logs - most[:, None]).sum(axis=1)
        return found

    def placed(self, z: Reals, u: Reals) -> Reals:
        """Return points of the mixture from standard normal z and uniform u."""
        which = np.searchsorted(np.cumsum(self.shares)[:-1], u, "right")
        found: Reals = self.centres[which] + self.deviations[which, None] * z
        outer = self.radii[which] > 0.0
        squares, dimensions = np.sum(z[outer] ** 2, axis=1), z.shape[1]
        tails = special.chdtrc(dimensions, squares)
        tails *= special.chdtrc(dimensions, self.radii[which[outer]] ** 2)
        found[outer] = z[outer] * np.sqrt(special.chdtri(dimensions, tails) / squares)[:, None]
        return found


def fitted(regions: Sequence[tuple[float, Sequence[Reals]]], rng: np.random.Generator) -> Mixture:
    """Return the mixture whose weights vary least over points in the event.

    Each region of the event has components of its own. The mean of the weights over points in the
    event is the variance of the estimate, but for a factor; it is computed over the half of the
    points that was left out of the fit.

    regions : of each region the share of the mixture, and two independent halves of the points
        found there, (count, dimensions).
    """
    parts = [(share, _chosen(halves, rng)) for share, halves in regions]
    return Mixture(
        np.concatenate([share * one.shares for share, one in parts]),
        np.concatenate([one.centres for _, one in parts]),
        np.concatenate([one.deviations for _, one in parts]),
        np.concatenate([one.radii for _, one in parts]),
    )


def _chosen(halves: Sequence[Reals], rng: np.random.Generator) -> Mixture:
    """Return the mixture for one region, by what each half says of a fit to the other."""
    if not halves[0].shape[1]:
        return Mixture(np.ones(1), np.zeros((1, 0)), np.ones(1), np.zeros(1))
    if min(map(len, halves)) < _LEAST_POINTS:
        return _maximised(halves, 1, rng, wider=True)
    few = [half[:: -(-len(half) // _AT_MOST)] for half in halves]
    best, least = (0, False), math.inf
    for count in _COMPONENTS:
        for wider in (False, True) if count else (False,):
            vary = math.fsum(
                float(np.mean(_maximised([one], count, rng, wider=wider).weights(other)))
                for one, other in (few, few[::-1])
            )
            if vary < _BETTER * least:
                best, least = (count, wider), vary
    return _maximised(halves, best[0], rng, wider=best[1])


def _maximised(
    parts: Sequence[Reals], count: int, rng: np.random.Generator, *, wider: bool
) -> Mixture:
    """Return the likeliest mixture of so many components beside the defensive ones."""
    x = np.concatenate(parts)
    each, dimensions = np.full(len(x), 1.0 / len(x)), x.shape[1]
    squared = np.sum(x * x, axis=1)
    far = math.sqrt(max(1.0, float(squared.mean()) / dimensions))
    near = _WITHIN * math.sqrt(float(squared.min()))
    centres = np.vstack([np.zeros((2, dimensions)), _spread(x, each, count, rng)])
    deviations = np.concatenate([[1.0, far], np.ones(count)])
    radii = np.concatenate([[near], np.zeros(count + 1)])
    shares = np.full(count + 2, 1.0 / (count + 2))
    mixture = Mixture(shares, centres, deviations, radii)
    for _ in range(_ITERATIONS):
        logs = mixture.logarithms(x)
        mine = np.exp(logs - logs.max(axis=1)[:, None])
        mine *= (each / mine.sum(axis=1))[:, None]
        sums = mine.sum(axis=0) + 1e-9
        centres = (mine.T @ x) / sums[:, None]
        centres[:2] = 0.0
        if wider and count:
            # of all but the defensive ones: the mean square less that of the centres
            own, masses = mine[:, 2:].sum(axis=1), sums[2:]
            squares = float(own @ squared - masses @ np.sum(centres[2:] ** 2, axis=1))
            deviations = deviations.copy()
            deviations[2:] = math.sqrt(max(1.0, squares / (dimensions * float(masses.sum()))))
        shares = np.maximum(sums / sums.sum(), np.where(np.arange(count + 2) < 2, _DEFENSIVE, 0.0))
        mixture = Mixture(shares / shares.sum(), centres, deviations, radii)
    return mixture


def _spread(x: Reals, each: Reals, count: int, rng: np.random.Generator) -> Reals:
    """Return points far from each other to begin at (k-means++: Arthur and Vassilvitskii 2007)."""
    chosen: list[int] = []
    nearest = np.ones(len(x))
    for _ in range(count):
        shares = np.cumsum(each * nearest)
        place = np.searchsorted(shares, rng.random() * shares[-1], "right")
        chosen.append(min(int(place), len(x) - 1))
        away = np.sum((x - x[chosen[-1]]) ** 2, axis=1)
        nearest = away if len(chosen) == 1 else np.minimum(nearest, away)
    found: Reals = x[chosen]
    return found
