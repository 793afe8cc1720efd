"""Pictures of a study as files: the kind that fits it, or the kind that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cosim.core import InputError, pyplot, save_picture
from cosim.study.association import groups_of, rank_correlations
from cosim.study.columns import Column, StudyColumns, columns_of
from cosim.study.convergence import convergence_of
from cosim.study.distribution import distribution_of
from cosim.study.pictures import BLUE, DPI, GREY, RED, STYLE, draw
from cosim.study.schema import SampledAxis
from cosim.study.sensitivity_indices import sensitivity
from cosim.study.stability_picture import draw_stability

_MOST_NUMBERS = 14


class _Asked(NamedTuple):
    """What a picture is made of: the table, its columns, the metric and the axes."""

    table: Any
    manifest: dict[str, Any]
    columns: StudyColumns
    metric: Column
    over: Sequence[str]
    target: Path


def draw_study(
    table: Any,
    manifest: dict[str, Any],
    target: Path,
    kind: str | None = None,
    metric: str | None = None,
    over: Sequence[str] = (),
) -> str:
    """Draw a study to a PNG, SVG or PDF file, and return the kind of the picture.

    Parameters
    ----------
    kind : one of `PICTURE_KINDS`; None for the one that fits: the stability boundary of a study
        with [stability], a map or a curve over its grid, sensitivity indices, a distribution.
    metric : the metric to draw; None for the first one that is no text.
    over : axes; for a curve or map as `draw`, for a scatter one.

    Raises
    ------
    InputError : no such kind, metric or axis, nothing of this kind to draw, or matplotlib is
        missing.
    """
    columns = columns_of(table, manifest)
    if kind is not None and kind not in PICTURE_KINDS:
        raise InputError.unknown("picture", kind, PICTURE_KINDS, where="`kind`")
    chosen = kind or _fitting(columns, metric, over)
    PICTURE_KINDS[chosen](_Asked(table, manifest, columns, _metric(columns, metric), over, target))
    return chosen


def _fitting(columns: StudyColumns, metric: str | None, over: Sequence[str]) -> str:
    if over:
        return "map" if len(over) == 2 else "curve"
    if metric is None and columns.study.stability is not None:
        return "boundary"
    axes = columns.study.vary
    if any(isinstance(axis, SampledAxis) and axis.kind == "saltelli" for axis in axes):
        return "sensitivity"
    return {0: "distribution", 1: "curve"}.get(len(_grid(columns)), "map")


def _grid(columns: StudyColumns) -> list[str]:
    return [axis.name for axis in columns.grid if axis.kind == "number"]


def _metric(columns: StudyColumns, name: str | None) -> Column:
    if name is not None:
        if name not in columns.metrics:
            raise InputError.unknown("metric", name, columns.metrics, where="picture")
        found = columns.metrics[name]
    else:
        usable = [m for m in columns.metrics.values() if m.kind != "text"]
        found = (usable or list(columns.metrics.values()))[0]
    if not found.known.any():
        raise InputError("there is nothing to draw", where=found.name, got="no run has a value")
    return found


def _over(asked: _Asked, count: int) -> list[str]:
    """Return the axes given, or the first ones of the grid, or of all that are numbers."""
    if asked.over:
        return list(asked.over)
    axes = [a.name for a in asked.columns.axes.values() if a.kind == "number"]
    first = _grid(asked.columns)
    found = [*first, *(name for name in axes if name not in first)][:count]
    if len(found) < count:
        raise InputError(
            "there is nothing to draw this picture over",
            where=asked.columns.study.title,
            expected=f"{count} axes of numbers",
            got=", ".join(found) or "none",
        )
    return found


@contextmanager
def _framed(asked: _Asked) -> Iterator[Any]:
    """Give axes to draw on, and write the picture afterwards."""
    plt = pyplot()
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(7.2, 4.6), layout="constrained")
        yield axis
        title = f"{asked.columns.study.title}\n{asked.columns.runs.size} runs"
        axis.set_title(title, fontsize=9, loc="left")
        save_picture(figure, asked.target, DPI)
        plt.close(figure)


def _draw_curve(asked: _Asked) -> None:
    draw(asked.table, asked.manifest, asked.target, asked.metric.name, _over(asked, 1))


def _draw_map(asked: _Asked) -> None:
    draw(asked.table, asked.manifest, asked.target, asked.metric.name, _over(asked, 2))


def _draw_distribution(asked: _Asked) -> None:
    found, metric = distribution_of(asked.metric), asked.metric
    with _framed(asked) as axis:
        axis.set(xlabel=metric.name, ylabel="runs")
        if not found.edges.size:
            axis.bar(found.names, found.counts, color=BLUE)
            return
        axis.stairs(found.counts, found.edges, fill=True, color=BLUE, alpha=0.85)
        values = metric.values[metric.known]
        for label, value, style in (
            ("mean", values.mean(), "-"),
            ("median", np.median(values), "--"),
        ):
            axis.axvline(value, color=RED, lw=1.4, ls=style, label=f"{label} {value:.4g}")
        if found.outside:
            axis.plot([], [], " ", label=found.outside)
        axis.legend(frameon=False)


def _draw_scatter(asked: _Asked) -> None:
    metric, columns = asked.metric, asked.columns
    name = _over(asked, 1)[0]
    if name not in columns.axes:
        raise InputError.unknown("axis", name, columns.axes, where="picture")
    over = columns.axes[name]
    groups = groups_of(metric, over)
    finished = np.array([status == "finished" for status in columns.statuses])
    with _framed(asked) as axis:
        for kept, colour, marker, label in (
            (finished, BLUE, "o", "finished"),
            (~finished, RED, "x", "ended otherwise"),
        ):
            if (kept & metric.known).any():
                points = {"s": 12, "alpha": 0.6, "marker": marker, "color": colour}
                axis.scatter(over.values[kept], metric.values[kept], label=label, **points)
        several = groups.number > 1
        if several.any():
            below, above = groups.mean - groups.low, groups.high - groups.mean
            gaps = np.nan_to_num(np.array([below, above]))[:, several]
            at, mean = groups.centres[several], groups.mean[several]
            style = {"color": "black", "lw": 1.1, "ms": 3, "capsize": 2, "label": "mean, 95 %"}
            axis.errorbar(at, mean, gaps, fmt="o" if over.kind == "text" else "o-", **style)
        if over.kind == "text":
            axis.set_xticks(range(len(over.words)), [word[:18] for word in over.words])
        axis.set(xlabel=over.name, ylabel=metric.name)
        axis.legend(frameon=False)


def _draw_convergence(asked: _Asked) -> None:
    found = convergence_of(asked.columns, asked.metric)
    if found is None or found.draws[-1] < 2:
        raise InputError(
            "this study draws nothing at random whose estimate could settle",
            where=asked.columns.study.title,
            expected="several samples or replicates, and a metric of numbers",
            got=f"{', '.join(axis.kind for axis in asked.columns.study.vary)}, {asked.metric.name}",
        )
    what = "share" if asked.metric.kind == "truth" else "mean"
    with _framed(asked) as axis:
        label = f"95 %, {found.method}"
        axis.fill_between(
            found.draws, found.low, found.high, color=BLUE, alpha=0.2, lw=0, label=label
        )
        axis.plot(found.draws, found.mean, color=BLUE, lw=1.3, label=what)
        # the first intervals are so wide that nothing else would be seen
        settled = found.draws >= min(8, found.draws[-1])
        low, high = np.nanmin(found.low[settled]), np.nanmax(found.high[settled])
        if high > low:
            axis.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
        axis.set(xlabel="draws", ylabel=f"{what} of {asked.metric.name}")
        axis.legend(frameon=False)


def _draw_sensitivity(asked: _Asked) -> None:
    found = sensitivity(asked.table, asked.manifest, asked.metric.name)
    names = list(found.first)
    with _framed(asked) as axis:
        for shift, colour, label, indices in (
            (-0.2, BLUE, "alone (first order)", found.first),
            (0.2, RED, "with others (total)", found.total),
        ):
            each = [indices[name] for name in names]
            gaps = [[i.value - i.low for i in each], [i.high - i.value for i in each]]
            at, values = np.arange(len(names)) + shift, [i.value for i in each]
            errors = {"yerr": np.maximum(gaps, 0.0), "capsize": 3, "ecolor": GREY}
            axis.bar(at, values, 0.38, color=colour, label=label, **errors)
        axis.set_xticks(range(len(names)), names)
        axis.set(ylabel=f"share of the variance of {found.metric}")
        axis.legend(frameon=False)


def _draw_correlations(asked: _Asked) -> None:
    rows = [m for m in asked.columns.metrics.values() if m.kind != "text"]
    across = [a for a in asked.columns.axes.values() if a.kind != "text"] + rows
    values = rank_correlations(rows, across)
    with _framed(asked) as axis:
        mesh = axis.imshow(values, vmin=-1.0, vmax=1.0, cmap="RdBu", aspect="auto")
        axis.figure.colorbar(mesh, ax=axis, label="rank correlation")
        axis.set_xticks(range(len(across)), [c.name for c in across], rotation=90)
        axis.set_yticks(range(len(rows)), [r.name for r in rows])
        axis.grid(visible=False)
        for (i, j), value in np.ndenumerate(values) if len(across) <= _MOST_NUMBERS else ():
            if np.isfinite(value):
                dark = abs(value) > 0.6
                text = {"ha": "center", "va": "center", "fontsize": 8}
                axis.text(j, i, f"{value:.2f}", color="white" if dark else "black", **text)


def _draw_boundary(asked: _Asked) -> None:
    draw_stability(asked.table, asked.manifest, asked.target)


PICTURE_KINDS: Mapping[str, Callable[[_Asked], None]] = MappingProxyType(
    {
        "boundary": _draw_boundary,
        "curve": _draw_curve,
        "map": _draw_map,
        "distribution": _draw_distribution,
        "scatter": _draw_scatter,
        "convergence": _draw_convergence,
        "sensitivity": _draw_sensitivity,
        "correlations": _draw_correlations,
    }
)
"""The kinds of pictures of a study: name -> what draws it."""
