"""Collect the content of a page about a study from its table and manifest."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.page import packed
from cosim.study.answer import answers_of, point_of, pooling_words
from cosim.study.association import Groups, cells_of, groups_of, rank_correlations
from cosim.study.columns import Column, StudyColumns, columns_of
from cosim.study.convergence import convergence_of
from cosim.study.distribution import distribution_of
from cosim.study.folder import MANIFEST, TRACES
from cosim.study.rare_events import RareEstimate
from cosim.study.report.chart import (
    Chart,
    convergence_chart,
    correlation_chart,
    distribution_chart,
    map_chart,
    scatter_chart,
    sensitivity_chart,
)
from cosim.study.report.run_statuses import (
    RunCause,
    StatusCount,
    run_causes,
    status_counts,
    tone_of,
)
from cosim.study.report.stability_chart import stability_chart
from cosim.study.report.varied_words import (
    VariedAxis,
    correlations_asked,
    set_everywhere,
    varied_axes,
)
from cosim.study.report.worst_runs import WorstRuns, worst_figures, worst_runs
from cosim.study.schema import Metric, ReplicatesAxis, SampledAxis
from cosim.study.sensitivity_indices import sensitivity
from cosim.study.stability_boundary import Boundary, boundary
from cosim.study.stages import plain_sample, rare_estimate, stopping_of
from cosim.study.stopping import Stopping
from cosim.study.summary import Summary, summarise

QUANTILES = (0.05, 0.5, 0.95)
_MOST_POINTS_LISTED = 200
"""Most points of a grid that a table lists."""
_MOST_SCATTERS = (6, 4)
"""Most charts over an axis: in a study with few axes, and per metric in one with more."""
_MOST_CORRELATED = 60
_MOST_POINTS, _MOST_NUMBERS = 1500, 150_000
"""Most runs that are drawn as points, and most of their numbers on a page."""
_FEWEST_DRAWS = 5


@dataclass(frozen=True)
class MetricPart:
    """What the page shows of one metric.

    Attributes
    ----------
    source : what it is, in words.
    missing : number of runs without a value.
    left_out : axes without a chart of their own.
    """

    column: Column
    source: str
    missing: int
    charts: list[Chart]
    left_out: list[str]


@dataclass(frozen=True)
class StudyContent:
    """The content of a page about a study.

    Attributes
    ----------
    repeat : the command that repeats a run, without its number.
    unread : lines of the run log that could not be read.
    columns : of the runs that have the distributions of the axes: all, but for a rare event.
    runs, count : number of runs in the table, and in the study.
    stopped, rare : what a study that stops at a width, or of a rare event, has found.
    answers : what was asked, a sentence per metric; pooling : over which runs that is.
    summary, points : statistics of all runs; per point of the grid, None without a grid or of
        too many points.
    sensitivity : charts, and why there are none where axes were made for them.
    worst : None without a metric to rank by.
    """

    manifest: dict[str, Any]
    columns: StudyColumns
    confidence: float
    repeat: str
    unread: int
    runs: int
    count: int
    complete: bool
    stopped: Stopping | None
    rare: RareEstimate | None
    statuses: list[StatusCount]
    causes: list[RunCause]
    more_causes: int
    axes: list[VariedAxis]
    set_everywhere: list[tuple[str, str]]
    correlations_asked: list[tuple[str, str]]
    boundary: Boundary | None
    stability: Chart | None
    answers: list[str]
    pooling: str
    summary: Summary
    points: Summary | None
    metrics: list[MetricPart]
    sensitivity: list[Chart]
    not_sensitive: list[str]
    correlations: Chart | None
    worst: WorstRuns | None
    worst_figures: dict[str, Any]

    @property
    def lead(self) -> Chart | None:
        """The chart of the first answer over the grid; None without, or beside the stability's."""
        asked = self.answers[0].partition(": ")[0] if self.answers and self.columns.grid else ""
        part = next((each for each in self.metrics if each.column.name == asked), None)
        if part is None or self.stability is not None:
            return None
        over = [chart for chart in part.charts if "-map" in chart.key or "-over-" in chart.key]
        return next(iter(over), None)

    @property
    def charts(self) -> list[Chart]:
        """All charts with data of their own."""
        alone = [c for c in (self.stability, self.correlations) if c is not None]
        return [*alone, *self.sensitivity, *(c for part in self.metrics for c in part.charts)]

    @property
    def without_result(self) -> int:
        """Number of runs in the table that have no result."""
        return sum(one.found.count for one in self.statuses if one.tone == "bad")


def content_of(
    table: Any,
    manifest: dict[str, Any],
    folder: Path,
    target: Path,
    *,
    unread: int = 0,
    confidence: float = 0.95,
) -> StudyContent:
    """Collect what a page about a study shows.

    Parameters
    ----------
    table, manifest : as from `read_table`.
    folder : of the study, with its traces.
    target : the page, from which links to traces start.

    Raises
    ------
    InputError : the confidence is not between 0 and 1.
    """
    stopped, rare = stopping_of(table, manifest), rare_estimate(table, manifest)
    every = columns_of(table, manifest)
    # of a rare event, all but the first level is drawn where the event is: no estimate of the axes
    table, manifest = plain_sample(table, manifest)
    columns = columns_of(table, manifest)
    summary = summarise(table, manifest, [], confidence=confidence, quantiles=QUANTILES)
    cells = point_of(columns)
    points = None
    if cells is not None and cells.size and int(cells.max()) < _MOST_POINTS_LISTED:
        grid = [axis.name for axis in columns.grid]
        points = summarise(table, manifest, grid, confidence=confidence)
    ranked = {m.name: _ranked(columns, m, confidence) for m in columns.metrics.values()}
    worst = worst_runs(every, {name: [a for a, _ in axes] for name, axes in ranked.items()})
    edge = boundary(table, manifest) if columns.runs.size else None
    causes, more = run_causes(every)
    indices, why_not = _sensitivity(table, manifest, columns, confidence)

    def trace_of(run: int) -> str | None:
        digits = len(str(every.count - 1))
        trace = folder / TRACES / f"run-{run:0{digits}d}.mcap"
        if not trace.is_file():
            return None
        return Path(os.path.relpath(trace, target.parent)).as_posix()

    return StudyContent(
        manifest=manifest,
        columns=columns,
        confidence=confidence,
        repeat=_repeat(manifest, folder),
        unread=unread,
        runs=int(every.runs.size),
        count=every.count,
        complete=rare is not None if columns.study.rare else every.runs.size == every.count,
        stopped=stopped,
        rare=rare,
        statuses=status_counts(every, confidence),
        causes=causes,
        more_causes=more,
        axes=varied_axes(columns),
        set_everywhere=set_everywhere(columns),
        correlations_asked=correlations_asked(columns),
        boundary=edge,
        stability=None if edge is None else stability_chart(columns, edge),
        answers=answers_of(columns, confidence) if columns.runs.size else [],
        pooling=pooling_words(columns) if columns.runs.size else "",
        summary=summary,
        points=points,
        metrics=[
            _part(columns, number, metric, ranked[metric.name], confidence)
            for number, metric in enumerate(columns.metrics.values())
        ],
        sensitivity=indices,
        not_sensitive=why_not,
        correlations=_correlations(columns),
        worst=worst,
        worst_figures={} if worst is None else worst_figures(every, worst, trace_of),
    )


def _repeat(manifest: dict[str, Any], folder: Path) -> str:
    """Return the command that repeats a run, without its number."""
    name = shlex.quote(str(folder)) if (folder / MANIFEST).is_file() else "STUDY"
    flavour = manifest.get("flavour", DEFAULT_FLAVOUR)
    option = "" if flavour == DEFAULT_FLAVOUR else f" --flavour {flavour}"
    return f"cosim study repeat{option} {name}"


def figures(content: StudyContent) -> dict[str, Any]:
    """Return what `study.js` draws: columns of some of the runs, charts, and worst runs."""
    columns = content.columns
    everything = [*columns.axes.values(), *columns.metrics.values()]
    kept = thinned(columns)
    return {
        "repeat": content.repeat,
        "runs": columns.runs[kept].tolist(),
        "statuses": [columns.statuses[k].replace("_", " ") for k in kept],
        "tones": [tone_of(columns.statuses[k]) for k in kept],
        "columns": {
            c.name: {
                "values": packed(c.values[kept], _precision(c)),
                "words": list(c.words) if c.kind == "text" else None,
                "title": c.title,
            }
            for c in everything
        },
        "charts": {
            chart.key: {"data": chart.data, "layout": chart.layout} for chart in content.charts
        },
        "worst": content.worst_figures,
    }


def thinned(columns: StudyColumns) -> list[int]:
    """Return the places of the runs that are drawn as points, increasing.

    The extremes of every metric are among them; the others are chosen by a hash of their numbers,
    so that no pattern of the grid is kept or lost.
    """
    count = min(_MOST_POINTS, max(_MOST_NUMBERS // (len(columns.axes) + len(columns.metrics)), 200))
    if columns.runs.size <= count:
        return list(range(columns.runs.size))
    chosen = {
        int(place)
        for metric in columns.metrics.values()
        if metric.known.any()
        for place in (np.nanargmin(metric.values), np.nanargmax(metric.values))
    }
    order = np.argsort(_hashed(columns.runs.astype(np.uint64)), kind="stable")
    return sorted({*order[:count].tolist(), *chosen})


def _hashed(numbers: Any) -> Any:
    """Mix the bits of integers (splitmix64, Steele, Lea and Flood 2014)."""
    with np.errstate(over="ignore"):
        z = numbers + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


def _precision(column: Column) -> float:
    values = column.values[column.known]
    return float(np.ptp(values / 2)) * 2e-6 if values.size else 0.0


def _ranked(
    columns: StudyColumns, metric: Column, confidence: float
) -> list[tuple[Column, Groups]]:
    """Return the axes that vary, those that explain most of the metric first."""
    if metric.kind == "text" or not metric.known.any():
        return []
    found = []
    for axis in columns.axes.values():
        if np.unique(axis.values[axis.known]).size > 1:
            seeds = isinstance(columns.varied_axis(axis.name), ReplicatesAxis)
            found.append((seeds, axis, groups_of(metric, axis, confidence)))
    found.sort(key=lambda one: -(one[2].explained or 0.0))
    # a seed is no quantity: it has a chart only where nothing else varies
    kept = [one for one in found if not one[0]] or found
    return [(axis, groups) for _, axis, groups in kept]


def _part(
    columns: StudyColumns,
    number: int,
    metric: Column,
    ranked: Sequence[tuple[Column, Groups]],
    confidence: float,
) -> MetricPart:
    most = _MOST_SCATTERS[len(columns.axes) > _MOST_SCATTERS[0]]
    return MetricPart(
        metric,
        source_of(columns.study.metrics[metric.name]),
        int((~metric.known).sum()),
        list(_metric_charts(columns, f"metric-{number}", metric, ranked[:most], confidence)),
        [axis.name for axis, _ in ranked[most:]],
    )


def _metric_charts(
    columns: StudyColumns,
    key: str,
    metric: Column,
    ranked: Sequence[tuple[Column, Groups]],
    confidence: float,
) -> Iterator[Chart]:
    if not metric.known.any():
        return
    yield distribution_chart(f"{key}-distribution", metric, distribution_of(metric))
    # over a grid it would be the interval of a mean over values that were chosen
    settled = None if columns.grid else convergence_of(columns, metric, confidence)
    if settled is not None and settled.draws[-1] >= _FEWEST_DRAWS:
        yield convergence_chart(f"{key}-convergence", metric, settled, confidence)
    pair = heat_axes(columns, [axis for axis, _ in ranked] or list(columns.axes.values()))
    if pair is not None and metric.kind != "text":
        yield map_chart(f"{key}-map", metric, cells_of(metric, *pair))
    for place, (axis, groups) in enumerate(ranked):
        yield scatter_chart(f"{key}-over-{place}", metric, axis, groups, confidence)


def heat_axes(columns: StudyColumns, ranked: Sequence[Column]) -> tuple[Column, Column] | None:
    """Return the two grid axes that explain most, in the order of the study; None if not two."""
    grid = columns.grid
    first = [axis for axis in ranked if axis in grid]
    chosen = [*first, *(axis for axis in grid if axis not in first)][:2]
    if len(chosen) < 2:
        return None
    x, y = (axis for axis in grid if axis in chosen)
    return x, y


def source_of(metric: Metric) -> str:
    """Return in words what a metric is computed from."""
    if metric.signal is None:
        words = str(metric.path)
    else:
        words = f"{metric.reduce} of {', '.join(metric.signals)}"
        if metric.to:
            words += f" relative to {metric.to:g}"
        if metric.after:
            words += f" after {metric.after:g} s"
        if metric.within is not None:
            words += f" within {metric.within:g}"
    for key, relation in (("below", "<"), ("above", ">"), ("equals", "=")):
        bound = getattr(metric, key)
        if bound is not None:
            words += f" {relation} {bound if isinstance(bound, (str, bool)) else f'{bound:g}'}"
    return words


def _sensitivity(
    table: Any, manifest: dict[str, Any], columns: StudyColumns, confidence: float
) -> tuple[list[Chart], list[str]]:
    """Return charts of the indices, and why metrics have none, of a study that is made for them."""
    kinds = {axis.kind for axis in columns.study.vary if isinstance(axis, SampledAxis)}
    charts: list[Chart] = []
    why_not: list[str] = []
    for number, metric in enumerate(columns.metrics.values() if kinds == {"saltelli"} else ()):
        if metric.kind == "text":
            continue
        try:
            found = sensitivity(table, manifest, metric.name, confidence=confidence)
        except InputError as error:
            got = f": {error.got}" if error.got else ""
            why_not.append(f"{metric.name}: {error.what}{got}")
        else:
            charts.append(sensitivity_chart(f"sensitivity-{number}", found))
    return charts, why_not


def _correlations(columns: StudyColumns) -> Chart | None:
    rows = [m for m in columns.metrics.values() if m.kind != "text" and m.known.any()]
    axes = [
        axis
        for axis in columns.axes.values()
        if axis.kind != "text" and not isinstance(columns.varied_axis(axis.name), ReplicatesAxis)
    ]
    others = [*axes, *rows][:_MOST_CORRELATED]
    values = rank_correlations(rows, others)
    kept = np.isfinite(values)
    rows_kept = [i for i in range(len(rows)) if kept[i].any()]
    others_kept = [j for j in range(len(others)) if kept[:, j].any()]
    if not rows_kept or len(others_kept) < 2:
        return None
    return correlation_chart(
        "correlations",
        [rows[i] for i in rows_kept],
        [others[j] for j in others_kept],
        values[np.ix_(rows_kept, others_kept)],
    )
