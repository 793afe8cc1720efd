"""Events of standard normal numbers whose probability is known: what estimators are tried on.

`kind` says what is asked of an interval: "plain" problems have one region that everything finds,
"modes" two regions, "island" a region far from the one that the metric leads to.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import stats


class Problem(NamedTuple):
    """A limit (points to how far beyond the bound), its dimensions, and the truth."""

    name: str
    kind: str
    limit: Callable[[Any], Any]
    dimensions: int
    truth: float


def linear(d: int, beta: float) -> Problem:
    """Beyond a plane, oblique to all axes."""
    return Problem(
        f"linear d={d} beta={beta:g}",
        "plain",
        lambda u: u.sum(axis=1) / math.sqrt(d) - beta,
        d,
        float(stats.norm.sf(beta)),
    )


def chi_square(d: int, beta: float) -> Problem:
    """Outside a sphere, with the probability of a plane at beta."""
    truth = float(stats.norm.sf(beta))
    bound = stats.chi2.isf(truth, d)
    return Problem(
        f"chi-square d={d} beta={beta:g}",
        "plain",
        lambda u: np.sum(u * u, axis=1) - bound,
        d,
        truth,
    )


def two_planes(d: int, near: float, far: float, slope: float = 1.0) -> Problem:
    """Beyond either of two opposite planes; the metric rises `slope` as fast towards the other."""
    return Problem(
        f"two planes d={d} beta={near:g}, {far:g} slope={slope:g}",
        "modes",
        lambda u: np.maximum(u[:, 0] - near, slope * (-u[:, 0] - far)),
        d,
        float(stats.norm.sf(near) + stats.norm.sf(far)),
    )


def corner(d: int, near: float, far: float, slope: float = 1.0) -> Problem:
    """Beyond either of two planes at a right angle."""
    return Problem(
        f"corner d={d} beta={near:g}, {far:g} slope={slope:g}",
        "modes",
        lambda u: np.maximum(u[:, 0] - near, slope * (u[:, 1] - far)),
        d,
        float(1.0 - stats.norm.cdf(near) * stats.norm.cdf(far)),
    )


def ball(d: int, beta: float, away: float, radius: float, *, flat: bool = False) -> Problem:
    """Beyond a plane, or in a ball opposite to it; `flat`: the metric does not lead to the ball."""
    centre = np.zeros(d)
    centre[0] = -away

    def limit(u: Any) -> Any:
        inside = radius - np.sqrt(np.sum((u - centre) ** 2, axis=1))
        if flat:
            inside = np.where(inside > 0.0, 1.0, -np.inf)
        return np.maximum(u[:, 0] - beta, inside)

    truth = float(stats.norm.sf(beta) + stats.ncx2.cdf(radius**2, d, away**2))
    return Problem(
        f"{'flat ' if flat else ''}ball d={d} beta={beta:g} at {away:g} radius={radius:g}",
        "island",
        limit,
        d,
        truth,
    )


def box(d: int, beta: float, away: float, half: float, *, flat: bool = False) -> Problem:
    """Beyond a plane, or where two numbers are near those of a place at the distance `away`."""
    middle = np.array([-away, away]) / math.sqrt(2.0)

    def limit(u: Any) -> Any:
        inside = half - np.max(np.abs(u[:, :2] - middle), axis=1)
        if flat:
            inside = np.where(inside > 0.0, 1.0, -np.inf)
        return np.maximum(u[:, 0] - beta, inside)

    sides = stats.norm.cdf(middle + half) - stats.norm.cdf(middle - half)
    return Problem(
        f"{'flat ' if flat else ''}box d={d} beta={beta:g} at {away:g} half={half:g}",
        "island",
        limit,
        d,
        float(stats.norm.sf(beta) + sides[0] * sides[1]),
    )


def only_ball(d: int, away: float, radius: float) -> Problem:
    """In a ball and nowhere else."""
    centre = np.zeros(d)
    centre[0] = away
    return Problem(
        f"only a ball d={d} at {away:g} radius={radius:g}",
        "island",
        lambda u: radius - np.sqrt(np.sum((u - centre) ** 2, axis=1)),
        d,
        float(stats.ncx2.cdf(radius**2, d, away**2)),
    )


PLAIN = (
    *(linear(d, b) for d, b in ((2, 2.0), (2, 3.5), (5, 4.5), (10, 3.0), (20, 2.5), (20, 4.5))),
    *(chi_square(d, b) for d, b in ((2, 3.0), (3, 4.5), (5, 2.0), (10, 3.5), (20, 2.5), (20, 4.0))),
)
MODES = (
    *(two_planes(d, 3.0, 3.0) for d in (2, 10)),
    *(two_planes(d, 3.5, 3.5, 4.0) for d in (2, 10, 20)),
    *(two_planes(d, 3.0, 3.3) for d in (3, 20)),
    *(two_planes(d, 4.0, 4.2, 3.0) for d in (2, 8)),
    *(corner(d, 3.0, 3.0) for d in (2, 10)),
    *(corner(d, 3.5, 3.3, 5.0) for d in (2, 10)),
)
ISLANDS = (
    ball(2, 4.0, 4.0, 0.7),
    ball(2, 3.5, 4.5, 1.5),
    ball(3, 4.0, 4.0, 1.0),
    ball(5, 4.0, 4.5, 2.0),
    ball(2, 4.0, 4.0, 0.7, flat=True),
    ball(3, 4.0, 4.0, 1.0, flat=True),
    box(2, 4.0, 4.0, 0.5),
    box(10, 4.0, 4.0, 0.5),
    box(5, 3.5, 4.0, 0.8, flat=True),
    box(20, 4.0, 4.0, 0.8, flat=True),
    only_ball(2, 4.0, 0.5),
    only_ball(5, 4.0, 1.5),
)
