"""The runs of a study of a rare event: which points they have, and what follows from them.

The points of a stage, such as a step of all chains, depend on the study and on the metric of the
runs before. Runs have numbers in the order of the stages.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cosim.core import ComponentError, InputError
from cosim.study.descent import CHAIN, descend
from cosim.study.importance import importance_sampling
from cosim.study.rare_events import Evaluations, RareEstimate, Reals
from cosim.study.sampling import values_at
from cosim.study.schema import Axis, RarePart, SampledAxis, Study
from cosim.study.search import most_checked
from cosim.study.subset import subset_simulation

ESTIMATOR = 2
"""Which points the runs of a rare event have, in the manifest; without it there was one population.
"""
Drawn = tuple[int, list[tuple[Any, ...]]]
"""The number of the first run of a stage, and the values of the axes in each of its runs."""


class RarePoints:
    """The values of all axes in the runs of a study of a rare event, as far as they are decided.

    Attributes
    ----------
    axes : the axes in the order of the study.
    stage : the runs whose metric decides the points of the next stage; None at the end.
    estimate : what the study finds; None before the end.

    former : the runs are those of a study without `ESTIMATOR`; nothing is added to them.

    Raises
    ------
    InputError : correlations that cannot be together.
    """

    def __init__(self, study: Study, *, former: bool = False) -> None:
        assert study.rare is not None  # noqa: S101 - the caller asked
        self.axes: tuple[Axis, ...] = tuple(study.vary)
        self.estimate: RareEstimate | None = None
        self.stage: range | None = range(0)
        self._study, self._part = study, study.rare
        self._sampled = [axis for axis in study.vary if isinstance(axis, SampledAxis)]
        self._values: list[tuple[Any, ...]] = []
        self._begins: list[int] = []
        make = _former if former else _estimator
        self._estimator = make(study, study.rare, self._sampled)
        self._add(next(self._estimator))

    @property
    def count(self) -> int:
        """Number of runs that are decided."""
        return len(self._values)

    @property
    def most(self) -> int:
        """Number of runs that there may be at the end."""
        first = self._begins[1] if len(self._begins) > 1 else self.count
        later = first - first // CHAIN
        searched = first + (self._part.levels - 1) * later + most_checked(first)
        if self._part.method == "subset":
            return searched
        # each population, and half as many of the exploration, once more in the event
        return searched + later + later // 2 + self._study.samples

    def __getitem__(self, run: int) -> tuple[Any, ...]:
        """Return the value of every axis in run number `run`, counted from 0."""
        return self._values[run]

    def level(self, run: int) -> int:
        """Return the level of a run, counted from 1.

        What follows the chains has numbers above theirs: exploration, arcs, importance sample.
        """
        stage = bisect_right(self._begins, run) - 1
        return 1 if stage == 0 else 2 + (stage - 1) // (CHAIN - 1)

    def types(self) -> list[set[type]]:
        """Return the types of the values of each axis."""
        return [set(map(type, column)) for column in zip(*self._values, strict=True)]

    @property
    def drawn(self) -> Drawn:
        """The points of the stage; at the end those of all runs."""
        first = self.stage.start if self.stage is not None else 0
        return first, self._values[first:]

    def learn(self, drawn: Drawn) -> None:
        """Take over the points of a stage from the process that decided them."""
        first, values = drawn
        # nobody asks this process for the stages between
        self._values += [()] * (first - self.count)
        self._values[first:] = values

    def tell(self, metric: Sequence[Any]) -> None:
        """Go on to the next stage: the metric of each run of this one.

        Raises
        ------
        ComponentError : a run has no value, and the study does not say how it counts.
        InputError : the metric is not a number.
        """
        assert self.stage is not None  # noqa: S101 - the caller looked
        beyond = [
            beyond_by(self._part, run, value) for run, value in zip(self.stage, metric, strict=True)
        ]
        try:
            self._add(self._estimator.send(np.array(beyond)))
        except StopIteration as end:
            self.stage, self.estimate = None, end.value

    def replay(self, metric: Sequence[Any]) -> None:
        """Go on from the beginning, by the metric of the runs from the first one on.

        Runs that end the study, since they have no value, are the last ones that are decided.
        """
        with suppress(ComponentError):
            while self.stage is not None and self.stage.stop <= len(metric):
                self.tell(metric[self.stage.start : self.stage.stop])

    def _add(self, normal: Reals) -> None:
        first = self.count
        columns = [
            column.tolist() if isinstance(column, np.ndarray) else column
            for column in values_at(normal, self._sampled, self._study)
        ]
        self._values += list(zip(*columns, strict=True))
        self.stage = range(first, self.count)
        self._begins.append(first)


def beyond_by(part: RarePart, run: int, value: Any) -> float:
    """Return by how much the metric of a run is beyond the bound.

    Raises
    ------
    ComponentError : the run has no value, and the study does not say how it counts.
    InputError : the metric is not a number.
    """
    if isinstance(value, (bool, str)):
        raise InputError(
            "the metric of a rare event is a number",
            where=f"rare.metric = {part.metric}",
            expected="a number in every run",
            got=f"{value!r} in run {run}",
        )
    if value is not None and not math.isnan(value):
        return part.beyond(float(value))
    if part.missing == "refuse":
        raise ComponentError(
            f"run {run} has no value of {part.metric}, and what follows depends on it",
            where="rare.missing",
            hint='rare.missing = "beyond" or "within" says how such a run counts; look at it '
            f"alone: cosim study repeat STUDY {run}",
        )
    return math.inf if part.missing == "beyond" else -math.inf


def _estimator(study: Study, part: RarePart, axes: Sequence[SampledAxis]) -> Evaluations:
    rough = np.array([axis.integers is not None or axis.choice is not None for axis in axes])
    if part.method == "subset":
        return subset_simulation(len(axes), study.samples, part.levels, study.seed, rough)
    pilot = part.pilot or study.samples
    return importance_sampling(len(axes), study.samples, pilot, part.levels, study.seed, rough)


def _former(study: Study, part: RarePart, axes: Sequence[SampledAxis]) -> Evaluations:
    """Find what one population found, as studies had it before two were compared."""
    rough = np.array([axis.integers is not None or axis.choice is not None for axis in axes])
    subset = part.method == "subset"
    rng = np.random.default_rng([study.seed, 0 if subset else 1])
    samples = study.samples if subset else part.pilot or study.samples
    found, _ = yield from descend(rng, len(axes), samples, part.levels, rough)
    if found.probability is None:
        return found
    return found.refused(
        f"one population alone found about {found.probability:.2g}, by an earlier release: nothing "
        "tells what it missed; the study run afresh does"
    )
