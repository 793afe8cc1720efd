"""The runs of a study in stages: what follows a stage depends on the metrics of its runs.

A plain study has one stage. One that stops at a width has a stage up to each look; one of a rare
event has a stage for each step of its chains. Within a stage runs may be executed in any order, by
any worker: what is decided after it is a function of the study and of the rows by their number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from cosim.study.plan import Plan
from cosim.study.points import Points
from cosim.study.rare_events import RareEstimate
from cosim.study.rare_study import RarePoints
from cosim.study.run_log import RunLog
from cosim.study.schema import Study
from cosim.study.stopping import Stopping, looks, stopping


def stages_of(plan: Plan, done: RunLog) -> Iterator[range]:
    """Yield the runs of each stage; before the next one is asked for, they are in `done`.

    Raises
    ------
    ComponentError, InputError : runs have no value of the metric that decides, or one of another
        kind.
    """
    study = plan.job.study
    if study.rare is not None:
        points = plan.runner.points = RarePoints(study)
        while points.stage is not None:
            yield points.stage
            points.tell(_metric(study, study.rare.metric, done, points.stage))
    elif study.stop is not None:
        values: list[Any] = []
        for look in looks(study.stop.first, plan.count):
            stage = range(len(values), look)
            yield stage
            values += _metric(study, study.stop.metric, done, stage)
            reached = stopping(study, values, plan.count)
            if reached is not None and reached.reached:
                return
    else:
        yield range(plan.count)


def _metric(study: Study, name: str, done: RunLog, runs: range) -> list[Any]:
    place = list(study.metrics).index(name)
    return [done[run].values[place] for run in runs]


def points_of_rows(study: Study, rows: Any) -> Points | RarePoints:
    """Return the points of a study as far as its rows decide them; rows in order."""
    if study.rare is None:
        return Points(study)
    points = RarePoints(study)
    place = list(study.metrics).index(study.rare.metric)
    points.replay(_first((row.run, row.values[place]) for row in rows))
    return points


def stopping_of(table: Any, manifest: Mapping[str, Any]) -> Stopping | None:
    """Return what a study with `stop` has reached; None for others, and before the first look.

    table, manifest : of the study (`read_table`).
    """
    study = Study.model_validate(manifest["study"])
    if study.stop is None:
        return None
    return stopping(study, _column(table, study.stop.metric), Points(study).count)


def rare_estimate(table: Any, manifest: Mapping[str, Any]) -> RareEstimate | None:
    """Return the probability that a study of a rare event finds; None for others, and unfinished.

    table, manifest : of the study (`read_table`).
    """
    study = Study.model_validate(manifest["study"])
    if study.rare is None:
        return None
    points = RarePoints(study, former="estimator" not in manifest.get("parts", {}))
    points.replay(_column(table, study.rare.metric))
    return points.estimate


def plain_sample(table: Any, manifest: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Return the part of a table that has the distributions of the axes, and its manifest.

    Of a rare event that is the first level; of other studies the whole table.
    """
    if manifest["study"].get("rare") is None:
        return table, dict(manifest)
    levels = table.column("level").to_pylist()
    first = table.take([place for place, level in enumerate(levels) if level == 1])
    return first, {**manifest, "count": RarePoints(Study.model_validate(manifest["study"])).count}


def _column(table: Any, name: str) -> list[Any]:
    return _first(zip(table.column("run").to_pylist(), table.column(name).to_pylist(), strict=True))


def _first(values: Any) -> list[Any]:
    """Return the values of runs 0, 1, ... up to the first that is missing."""
    found: list[Any] = []
    for run, value in values:
        if run != len(found):
            break
        found.append(value)
    return found
