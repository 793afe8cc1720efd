"""The search for a rare event: two populations, an exploration from far out, the regions.

One search cannot tell what it missed. So two independent populations go to the event where the
metric leads, each with half of the runs, and an exploration comes to it from far out, by the
indicator alone (`exploration`). They must agree, but for chance, on the probability and on the
share of it in each region (`regions`); otherwise `objection` says what they disagree about, and
there is no interval.

What stays: a region that neither the metric leads to nor the exploration meets. The exploration
meets any half-space, and what is bounded in few dimensions; a ball in many dimensions it may miss.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.study.descent import CHAIN, Population, descend
from cosim.study.exploration import MOST_STEPS, MOVES, Exploration, explore
from cosim.study.rare_events import RareEstimate, Reals
from cosim.study.regions import REPRESENTATIVES, Found, Regions, most_arcs, regions_of

POPULATIONS = 2
_WIDE = 2  # points of the exploration at first, over those of a level
_CHANCE = 0.004
"""Probability with which each comparison objects to what differs by chance alone."""
_UNEVEN = 3.5  # standard deviations; the most of many places, one in a hundred by chance
LEAST_SHARE = 0.02
"""Share of the probability that a region must have to matter."""


@dataclass(frozen=True)
class Search:
    """What the search found.

    Attributes
    ----------
    estimate : of both populations together; `probability` None if one has not found the event.
    last : the last level of each population.
    exploration, regions : None if the event is not rare, or nothing can be widened.
    disagreement : what populations and exploration find different probabilities or places of; None.
    """

    estimate: RareEstimate
    last: tuple[Population, ...]
    exploration: Exploration | None = None
    regions: Regions | None = None
    disagreement: str | None = None


def search(
    rng: tuple[np.random.Generator, ...],
    dimensions: int,
    samples: int,
    levels: int,
    rough: NDArray[np.bool_] | None,
) -> Generator[Reals, Reals, Search]:
    """Search for an event.

    rng : of each population, then of the exploration.
    samples : points per level of both populations together, and of the exploration at first.
    """
    halves = halves_of(samples)
    found = yield from together(
        [
            descend(own, dimensions, half, levels, rough)
            for own, half in zip(rng, halves, strict=False)
        ]
    )
    estimates, last = zip(*found, strict=True)
    whole = _combined(estimates)
    if whole.probability is None:
        return Search(whole, last)
    why = _apart(*estimates)
    smooth = np.ones(dimensions, np.bool_) if rough is None else ~rough
    # where a tenth of the first points is in the event, they have seen what there is
    if all(len(one.levels) == 1 for one in estimates) or not smooth.any():
        return Search(whole, last, disagreement=why)
    from scipy import special  # noqa: PLC0415 - loading it takes a while

    beta = -float(special.ndtri(min(whole.probability, 0.5)))
    seen = yield from explore(rng[POPULATIONS], dimensions, _WIDE * samples, beta, smooth)
    why = why or _unlike(whole, seen)
    regions = None
    if smooth.all() and len(seen.points):
        places = [_inside(one) for one in last]
        regions = yield from regions_of(
            rng[POPULATIONS], [*places, Found(seen.points, seen.family)]
        )
        why = why or _several(regions) or _uneven(regions)
    whole = replace(
        whole, exploration=seen.probability, regions=None if regions is None else regions.count
    )
    return Search(whole, last, seen, regions, why)


def halves_of(samples: int) -> tuple[int, int]:
    """Return the points per level of each population, multiples of a chain's."""
    seeds = samples // CHAIN
    return (seeds - seeds // 2) * CHAIN, seeds // 2 * CHAIN


def most_checked(samples: int) -> int:
    """Return how many points exploration and arcs may have, after the populations."""
    wide = _WIDE * samples
    arcs = most_arcs((POPULATIONS + 1) * REPRESENTATIVES)
    return wide + MOST_STEPS * MOVES * (wide // CHAIN) + arcs


def together(parts: list[Generator[Reals, Reals, Any]]) -> Generator[Reals, Reals, list[Any]]:
    """Advance generators side by side, their points in one stage; return what each returns."""
    asked: dict[int, Reals] = {k: next(part) for k, part in enumerate(parts)}
    results: list[Any] = [None] * len(parts)
    while asked:
        beyond = yield np.concatenate(list(asked.values()))
        begins = np.cumsum([len(points) for points in asked.values()])[:-1]
        for k, own in zip(list(asked), np.split(beyond, begins), strict=True):
            try:
                asked[k] = parts[k].send(own)
            except StopIteration as end:
                results[k] = end.value
                del asked[k]
    return results


def missed_by(found: RareEstimate, search: Search) -> str | None:
    """Say which search found more, beyond chance, than an unbiased estimate; None if none did.

    It may be more than they found: what only one of them met is in it.
    """
    seen = search.exploration
    if seen is None:
        return None
    if not seen.met:
        return _unlike(search.estimate, seen)
    why = _unlike(found, seen)
    if why is not None and (seen.probability or 0.0) > (found.probability or 0.0):
        return why
    apart = _apart(found, search.estimate)
    if apart is not None and search.estimate.logarithm > found.logarithm:
        return (
            f"the pilot finds {search.estimate.probability:.2g}, the sample "
            f"{found.probability:.2g}: the sample missed a part of the event; a larger pilot"
        )
    return None


def _inside(one: Population) -> Found:
    over = one.beyond > 0.0
    return Found(one.points[over], one.family[over])


def _combined(estimates: tuple[RareEstimate, ...]) -> RareEstimate:
    """Return the mean of independent estimates."""
    for one in estimates:
        if one.probability is None or one.deviation is None:
            return one
    each = [math.exp(one.logarithm) for one in estimates]
    variances = [(p * (one.deviation or 0.0)) ** 2 for p, one in zip(each, estimates, strict=True)]
    mean = math.fsum(each) / len(each)
    variance = math.fsum(variances) / len(each) ** 2
    # the deviation is the larger of two: it varies less than that of the families alone
    freedom = 2.0 * sum(one.freedom for one in estimates)
    return RareEstimate(
        probability=math.fsum(one.probability or 0.0 for one in estimates) / len(each),
        deviation=math.sqrt(variance) / mean,
        logarithm=math.log(mean),
        freedom=freedom,
        levels=max((one.levels for one in estimates), key=len),
        populations=tuple(one.probability or 0.0 for one in estimates),
    )


def _apart(one: RareEstimate, other: RareEstimate) -> str | None:
    variances = (one.deviation or 0.0) ** 2, (other.deviation or 0.0) ** 2
    if _by_chance(one.logarithm - other.logarithm, variances, (one.freedom, other.freedom)):
        return None
    return (
        f"two independent populations find {one.probability:.2g} and {other.probability:.2g}, "
        "further apart than by chance: one of them missed a part of the event"
    )


def _unlike(whole: RareEstimate, seen: Exploration) -> str | None:
    if seen.probability is None or seen.deviation is None:
        return (
            f"the populations find {whole.probability:.2g}, and of {seen.tried} points "
            f"{seen.width:.2g} times as far out none is in the event: that there is no other part "
            "of it cannot be told"
        )
    freedom = max(1.0, min(seen.met, np.unique(seen.family).size) - 1.0)
    variances = (whole.deviation or 0.0) ** 2, seen.deviation**2
    away = math.log(seen.probability) - whole.logarithm
    if _by_chance(away, variances, (whole.freedom, freedom)):
        return None
    return (
        f"the populations find {whole.probability:.2g}, an exploration from far out "
        f"{seen.probability:.2g}, further apart than by chance: one of them missed a part of the "
        "event"
    )


def _several(regions: Regions) -> str | None:
    """Say how the searches share regions that do not hang together; None if there is one.

    Chains do not go from one region to another: the share of each is that of the few ancestors
    that came there, and an interval of subset simulation covers too seldom.
    """
    matter = np.flatnonzero(regions.shares.max(axis=0) >= LEAST_SHARE)
    if len(matter) < 2:
        return None
    one = matter[np.argmax(np.ptp(regions.shares[:, matter], axis=0))]
    shares = ", ".join(f"{100 * share:.2g}" for share in regions.shares[:, one])
    return (
        f"the event has {len(matter)} regions that do not hang together, and chains do not go from "
        f"one to the other (two populations and an exploration have {shares} % in one of them): "
        "method = 'importance' samples each"
    )


def _uneven(regions: Regions) -> str | None:
    if regions.uneven <= _UNEVEN:
        return None
    return (
        "the populations and the exploration lie in different parts of the event, further apart "
        "than by chance, which a narrow place may join: method = 'importance'"
    )


def _by_chance(apart: float, variances: tuple[float, float], freedoms: tuple[float, float]) -> bool:
    """Return whether two estimates differ by chance (Welch's test)."""
    from scipy import special  # noqa: PLC0415 - loading it takes a while

    one, other = variances
    variance = one + other
    if variance == 0.0:
        return apart == 0.0
    freedom = variance**2 / (one**2 / freedoms[0] + other**2 / freedoms[1])
    return abs(apart) <= float(special.stdtrit(freedom, 1.0 - 0.5 * _CHANCE)) * math.sqrt(variance)
