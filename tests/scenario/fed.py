"""Feed measures from a kept run, block by block, and let them read only what is readable then."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from cosim.master import Run
from cosim.scenario.measure import Block, Measure, MeasuredRun

NEVER = np.iinfo(np.int64).max


def blocks_of_one(count: int) -> list[int]:
    """Every point is a block."""
    return list(range(count + 1))


def random_blocks(count: int, seed: int, longest: int = 50) -> list[int]:
    """Short and long blocks, by their ends."""
    r = random.Random(seed)  # noqa: S311 - reproducible choices
    cuts = [0]
    while cuts[-1] < count:
        cuts.append(min(count, cuts[-1] + r.choice([1, 1, 2, 3, r.randint(1, longest)])))
    return cuts


def fed(
    run: Run, measures: Sequence[Measure[Any]], cuts: Sequence[int], *, alone: bool = False
) -> list[Any]:
    """The results of measures that received the rows of a run in these blocks.

    `alone` : nothing is readable but the block and the own points before it, not even what routes
    read.
    """
    measured_run = MeasuredRun(run.instances)
    for measure in measures:
        measure.begin(measured_run)
    with Release(run, alone=alone).readable() as release:
        for first, last in itertools.pairwise(cuts):
            release.advance(first, last)
            for measure in measures:
                measure.add(Block(max(first - 1, 0), first, last))
        return [measure.result(run) for measure in measures]


class Release:
    """The arrays of a run: what is yet to come is not there, what no route reads is gone."""

    def __init__(self, run: Run, *, alone: bool = False) -> None:
        self._comm_points = run.instances[0].comm_points
        every = [route for instance in run.instances for route in instance.routes]
        routes = [route.in_step for route in every]
        own = [instance.own_points for instance in run.instances]
        arrays: list[tuple[Any, Any]] = [(run.instances[0].rows, np.nan)]
        arrays.append((self._comm_points.points_ns, NEVER))
        # the next point of one that is at every point stands in `last`, one place on
        arrays += [(points.last, NEVER) for points in own]
        arrays += [(points.following, NEVER) for points in own if not points.always]
        for used in routes:
            arrays += [(used.row, NEVER), (used.after, NEVER), (used.weight, np.nan)]
        unique = {id(array): (array, later) for array, later in arrays if array is not None}
        self._arrays = [(array, array.copy(), later) for array, later in unique.values()]
        self._following = {id(points.last) for points in own if points.always}
        size = run.count  # beyond, nothing is filled in
        # the first intervals of a block begin at the own points before it
        begins = np.min([points.last[:size] for points in own], axis=0)
        self._begin = np.concatenate(([0], begins[:-1]))
        # a route with the policy "previous" reads the point before (`RowsInUse.oldest`)
        later = any(route.route_key.policy == "previous" for route in every)
        needed = np.arange(size) - (later and not alone)
        for used in () if alone else routes:
            rows = used.row[:size]
            needed = np.minimum(needed, np.where(rows >= 0, rows, size))
        self._oldest = np.maximum(np.minimum.accumulate(needed[::-1])[::-1], 0)

    @contextmanager
    def readable(self) -> Iterator[Release]:
        """Hide everything; bring it back in the end."""
        flags = [array.flags.writeable for array, _, _ in self._arrays]
        oldest = self._comm_points.oldest
        try:
            for array, _, later in self._arrays:
                array.flags.writeable = True
                array[:] = later
            yield self
        finally:
            for (array, saved, _), flag in zip(self._arrays, flags, strict=True):
                array[:] = saved
                array.flags.writeable = flag
            self._comm_points.oldest = oldest

    def advance(self, first: int, last: int) -> None:
        """Show the next block, and take away what is older than any row still read."""
        oldest = int(self._oldest[self._begin[first]])
        for array, saved, _ in self._arrays:
            array[:oldest] = 0
            end = last + (id(array) in self._following)
            array[first:end] = saved[first:end]
        self._comm_points.oldest = oldest
