"""The regions of an event: which of the points found in it hang together.

Two points are in one region if an arc between them stays in the event: direction and distance from
the origin change evenly. An arc leaves neither a half-space nor the outside of a ball about the
origin, however many the dimensions. The arcs tried are those of a shortest tree; of parts that it
does not join, a few more.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.distance import cdist

from cosim.study.rare_events import Reals

REPRESENTATIVES = 16
"""Points of each population between which arcs are tried."""
_INSIDE = np.arange(1, 7) / 7.0  # places on an arc
_MORE = 3  # arcs between each two parts
_LEAST_PART = 0.1  # share of the probability in a part that a narrow place may join
_PARTS = 6  # the largest, between which more arcs are tried


@dataclass(frozen=True)
class Found:
    """Points that a population found in the event: points (n, d), and their family, (n,)."""

    points: Reals
    family: NDArray[np.int64]


@dataclass(frozen=True)
class Regions:
    """The regions of the event.

    Attributes
    ----------
    count : number of regions.
    shares : of the points of each population in each region, (populations, count).
    variances : of the shares, families of points taken as independent.
    representatives, region : points in the event, and the region of each.
    uneven : by how many standard deviations populations differ in their share of a part of the
        event, at most, over the parts that a narrow place may join: those into which one arc of
        the tree divides the representatives.
    """

    count: int
    shares: Reals
    variances: Reals
    representatives: Reals
    region: NDArray[np.int64]
    uneven: float = 0.0

    def of(self, points: Reals) -> NDArray[np.int64]:
        """Return the region of each point: that of the nearest representative."""
        return _nearest(points, self.representatives, self.region)


def regions_of(
    rng: np.random.Generator, populations: Sequence[Found]
) -> Generator[Reals, Reals, Regions]:
    """Find the regions, and the share of each population in each."""
    x = np.concatenate([one.points[_representatives(rng, one)] for one in populations])
    distance = cdist(x, x)
    tree = minimum_spanning_tree(distance + 1e-12 * (1.0 - np.eye(len(x)))).tocoo()
    pairs = np.column_stack([tree.row, tree.col]).astype(np.int64)
    joined = pairs[(yield from _joined(x, pairs))]
    region = _parts(joined, len(x))
    more = _between(region, distance, pairs)
    if more.size:
        joined = np.concatenate([joined, more[(yield from _joined(x, more))]])
        region = _parts(joined, len(x))
    count = int(region.max()) + 1
    shares, variances = np.empty((2, len(populations), count))
    for k, one in enumerate(populations):
        mine = _nearest(one.points, x, region)[:, None] == np.arange(count)
        shares[k] = mine.mean(axis=0)
        sums = np.zeros((int(one.family.max()) + 1, count))
        np.add.at(sums, one.family, mine - shares[k])
        variances[k] = np.sum(sums**2, axis=0) / len(mine) ** 2
    return Regions(count, shares, variances, x, region, _uneven(populations, x, pairs))


def _uneven(populations: Sequence[Found], x: Reals, tree: NDArray[np.int64]) -> float:
    greatest = 0.0
    counts = []  # by family and nearest representative
    for one in populations:
        _, family = np.unique(one.family, return_inverse=True)
        near = np.zeros((int(family.max()) + 1, len(x)))
        np.add.at(near, (family, np.argmin(cdist(one.points, x), axis=1)), 1.0 / len(family))
        counts.append(near)
    for k in range(len(tree)):
        side = _parts(np.delete(tree, k, axis=0), len(x)) == 0
        shares = [float(near[:, side].sum()) for near in counts]
        if not max(shares) >= _LEAST_PART or not 1.0 - min(shares) >= _LEAST_PART:
            continue
        spread = [
            float(np.sum((near[:, side].sum(axis=1) - share * near.sum(axis=1)) ** 2))
            for near, share in zip(counts, shares, strict=True)
        ]
        for a in range(len(shares)):
            for b in range(a):
                # one family more or less in this part is no evidence
                least = max(float(np.sum(counts[k].sum(axis=1) ** 2)) for k in (a, b)) / 4.0
                variance = max(spread[a] + spread[b], least)
                greatest = max(greatest, abs(shares[a] - shares[b]) / float(np.sqrt(variance)))
    return greatest


def _nearest(points: Reals, x: Reals, region: NDArray[np.int64]) -> NDArray[np.int64]:
    found: NDArray[np.int64] = region[np.argmin(cdist(points, x), axis=1)]
    return found


def most_arcs(representatives: int) -> int:
    """Return how many points the arcs between so many points may have."""
    return _INSIDE.size * (representatives - 1 + _MORE * _PARTS * (_PARTS - 1) // 2)


def _representatives(rng: np.random.Generator, one: Found) -> NDArray[np.int64]:
    """Return some of the points, of as many families as there are."""
    order = rng.permutation(len(one.points))
    _, first = np.unique(one.family[order], return_index=True)
    rest = np.setdiff1d(np.arange(order.size), first)
    places = np.concatenate([rng.permutation(first), rest])[:REPRESENTATIVES]
    found: NDArray[np.int64] = order[places]
    return found


def _joined(x: Reals, pairs: NDArray[np.int64]) -> Generator[Reals, Reals, NDArray[np.bool_]]:
    """Return which pairs of points an arc in the event joins."""
    if not len(pairs):
        return np.zeros(0, np.bool_)
    beyond = yield _arcs(x[pairs[:, 0]], x[pairs[:, 1]]).reshape(-1, x.shape[1])
    found: NDArray[np.bool_] = np.all(beyond.reshape(len(pairs), -1) > 0.0, axis=1)
    return found


def _arcs(a: Reals, b: Reals) -> Reals:
    """Return points on the arcs from a to b, (pairs, places, dimensions)."""
    length = np.stack([np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)], axis=1)
    length = np.maximum(length, 1e-12)
    to = _INSIDE[:, None]
    straight = (1.0 - to) * (a / length[:, :1])[:, None] + to * (b / length[:, 1:])[:, None]
    cosine = np.clip(np.sum(a * b, axis=1) / length.prod(axis=1), -1.0, 1.0)
    angle = np.arccos(cosine)[:, None, None]
    sine = np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        arc = (
            np.sin((1.0 - to) * angle) / sine * (a / length[:, :1])[:, None]
            + np.sin(to * angle) / sine * (b / length[:, 1:])[:, None]
        )
    # without an angle, or with half a turn, there is no one arc
    direction = np.where(sine > 1e-6, arc, straight)
    radius = (1.0 - to) * length[:, None, :1] + to * length[:, None, 1:]
    found: Reals = radius * direction
    return found


def _parts(pairs: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    found: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return found


def _between(
    region: NDArray[np.int64], distance: Reals, tried: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the shortest pairs between the largest parts that were not tried."""
    used = {(min(a, b), max(a, b)) for a, b in tried.tolist()}
    largest = np.argsort(-np.bincount(region), kind="stable")[:_PARTS].tolist()
    found = []
    for k, one in enumerate(largest):
        for other in largest[k + 1 :]:
            near = [
                (distance[a, b], min(a, b), max(a, b))
                for a in np.flatnonzero(region == one).tolist()
                for b in np.flatnonzero(region == other).tolist()
            ]
            left = [pair for _, *pair in sorted(near) if tuple(pair) not in used]
            found += left[:_MORE]
    return np.array(found, np.int64).reshape(-1, 2)
