"""Charts of a study as data for plotly.js, without colours, which `study.js` takes from the theme.

`meta.role` of a trace is the number of its colour in the palette, or a name ("reference", "limit").
Points are not repeated in every chart: `meta.points` names two columns, from which `study.js` takes
them, and which of the runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from cosim.page import LARGEST, packed, packed_values, plain
from cosim.study.association import Cells, Groups
from cosim.study.columns import Column, Reals
from cosim.study.convergence import Convergence
from cosim.study.distribution import Distribution
from cosim.study.sensitivity_indices import Index, Sensitivity

_MOST_NUMBERS = 12
_MANY_DRAWS = 1000
_FEW = 5
"""Fewer runs have no interval in a chart."""
_SYMBOLS: Mapping[int | str, str] = MappingProxyType({1: "x", 3: "triangle-up-open"})


@dataclass
class Chart:
    """One chart: `data` and `layout` as plotly.js takes them.

    Attributes
    ----------
    key : identifier on the page.
    words : what it shows, for screen readers.
    """

    key: str
    title: str
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    words: str
    note: str = ""
    unit: str = field(default="", init=False)

    def summary(self) -> str:
        """Describe the chart in words, for screen readers."""
        return f"{self.title}: {self.words}"


def distribution_chart(key: str, metric: Column, found: Distribution) -> Chart:
    """Draw how many runs have which values, with mean and median."""
    values = metric.values[metric.known]
    layout = {
        "xaxis": {"title": plain(metric.title)},
        "yaxis": {"title": "runs", "rangemode": "tozero", "exponentformat": "none"},
    }
    if not found.edges.size:
        bars = {"x": [plain(name) for name in found.names], "y": found.counts.tolist()}
        layout["xaxis"]["type"] = "category"
        words = ", ".join(f"{n} {name}" for name, n in zip(found.names, found.counts, strict=True))
        data = [{**_bar(0), **bars, "hovertemplate": "%{y} runs<extra>%{x}</extra>"}]
        return Chart(key, f"Values of {metric.name}", data, layout, words, found.outside)
    centres = 0.5 * (found.edges[1:] + found.edges[:-1])
    ends = [f"{a:.4g} to {b:.4g}" for a, b in zip(found.edges, found.edges[1:], strict=False)]
    bar = _bar(0) | {
        "x": packed_values(centres),
        "y": found.counts.tolist(),
        "width": float(found.edges[1] - found.edges[0]),
        "customdata": ends,
        "hovertemplate": "%{y} runs<extra>%{customdata}</extra>",
        "name": "runs",
    }
    data, top = [bar], float(found.counts.max())
    for label, value, role in (
        ("mean", float(values.mean()), "limit"),
        ("median", float(np.median(values)), "reference"),
    ):
        if found.edges[0] <= value <= found.edges[-1]:
            data.append(_upright(value, top, role, f"{label} {value:.4g}"))
    words = f"{values.size} runs from {values.min():.4g} to {values.max():.4g}"
    return Chart(key, f"Distribution of {metric.name}", data, layout, words, found.outside)


def convergence_chart(key: str, metric: Column, found: Convergence, confidence: float) -> Chart:
    """Draw the running mean, or share, with its interval over the number of draws."""
    n = found.draws.astype(np.float64)
    band = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
    share = metric.kind == "truth"
    sure = np.isfinite(found.low)
    interval = f"{100 * confidence:g} %, {found.method}"
    data = [
        _line(0, n[sure], found.low[sure], "") | band,
        _line(0, n[sure], found.high[sure], "")
        | band
        | {"fill": "tonexty", "name": interval, "showlegend": True},
        _line(0, n, found.mean, "share" if share else "mean")
        | {"hovertemplate": "%{y:.5~g} after %{x}<extra></extra>"},
    ]
    # the first intervals are so wide that nothing else would be seen
    settled = sure & (n >= min(8.0, 0.5 * n[-1]))
    drawn_values = [*found.low[settled], *found.high[settled], *found.mean[n >= min(8, n[-1])]]
    low, high = float(np.min(drawn_values)), float(np.max(drawn_values))
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 0.5
    layout: dict[str, Any] = {
        "xaxis": {
            "title": "draws",
            "type": "log" if n[-1] >= 50 else "linear",
            "exponentformat": "none",
        },
        "yaxis": {
            "title": plain(f"share of {metric.name}" if share else f"mean of {metric.title}"),
            "range": [low - margin, high + margin],
        },
    }
    if n[-1] >= _MANY_DRAWS:
        layout["xaxis"]["dtick"] = 1  # decades alone
    last = f"{found.mean[-1]:.5g} after {int(n[-1])} draws"
    if sure[-1]:
        last += f", interval {found.low[-1]:.5g} to {found.high[-1]:.5g}"
    title = f"Estimate of {metric.name} over the number of draws"
    return Chart(key, title, data, layout, last)


def scatter_chart(
    key: str, metric: Column, axis: Column, found: Groups, confidence: float
) -> Chart:
    """Draw a metric of the single runs over an axis, with means per value or part of the range."""
    interval = f"{'share' if metric.kind == 'truth' else 'mean'}, {100 * confidence:g} %"
    # a mean of a single run is the run itself, and the interval of two is as wide as nothing else
    known = np.isfinite(found.mean) & (found.number > 1)
    mean, few = found.mean[known], found.number[known] < _FEW
    data = [
        _points(0, axis, metric, "finished"),
        _points(1, axis, metric, "flagged"),
        _points(3, axis, metric, "no result"),
        _points("limit", axis, metric, "no value")
        | {"yaxis": "y2", "marker": {"symbol": "line-ns-open", "size": 9}},
        _line("reference", found.centres[known], mean, interval)
        | {
            "mode": "markers" if axis.kind == "text" else "lines+markers",
            "marker": {"size": 5, "symbol": "diamond"},
            "line": {"width": 1.4},
            "text": [plain(found.names[k]) for k in np.flatnonzero(known)],
            "hovertemplate": "%{y:.5~g}<extra>%{text}</extra>",
            "error_y": {
                "type": "data",
                "symmetric": False,
                "array": _gaps(np.where(few, np.nan, found.high[known] - mean)),
                "arrayminus": _gaps(np.where(few, np.nan, mean - found.low[known])),
                "width": 2,
            },
        },
    ]
    layout = {
        "xaxis": {"title": plain(axis.title), **_ticks(axis)},
        "yaxis": {"title": plain(metric.title), **_span(metric), **_ticks(metric)},
        "yaxis2": {"overlaying": "y", "range": [0, 1], "visible": False, "fixedrange": True},
    }
    words = "; ".join(
        f"{found.names[k]}: {found.mean[k]:.4g}" for k in np.flatnonzero(known)[:_MOST_NUMBERS]
    )
    note = ""
    if found.explained is not None:
        share = f"{100 * found.explained:.0f} %"
        note = f"Between the values of {axis.name} lies {share} of the variance (of ranks)."
    return Chart(key, f"{metric.name} over {axis.name}", data, layout, words, note)


def map_chart(key: str, metric: Column, found: Cells) -> Chart:
    """Draw the mean, or share, of a metric in every cell of two axes."""
    share = metric.kind == "truth"
    what = f"share of {metric.name}" if share else f"mean of {metric.name}"
    trace = _heat(found.names_x, found.names_y, found.values, "map") | {
        "colorbar": {"title": {"text": plain("share" if share else metric.title), "side": "right"}},
        "hovertemplate": f"{plain(found.x.name)} %{{x}}, {plain(found.y.name)} %{{y}}: "
        "%{z:.5~g}<extra></extra>",
    }
    if share:
        trace |= {"zmin": 0.0, "zmax": 1.0}
    layout = {
        "xaxis": {"title": plain(found.x.title), "type": "category"},
        "yaxis": {"title": plain(found.y.title), "type": "category"},
    }
    known = found.values[np.isfinite(found.values)]
    words = f"from {known.min():.4g} to {known.max():.4g}" if known.size else "no values"
    notes = []
    if found.coarse:
        notes.append("Neighbouring values of an axis are taken together.")
    if known.size < found.values.size:
        notes.append(f"{found.values.size - known.size} cells have no run with a value.")
    title = f"{what[0].upper()}{what[1:]} over {found.x.name} and {found.y.name}"
    return Chart(key, title, [trace], layout, words, " ".join(notes))


def correlation_chart(
    key: str, rows: Sequence[Column], columns: Sequence[Column], values: Reals
) -> Chart:
    """Draw rank correlations of metrics with axes and with each other."""
    names = tuple(c.name for c in columns), tuple(r.name for r in rows)
    trace = _heat(*names, values, "signed") | {
        "zmin": -1.0,
        "zmax": 1.0,
        "hovertemplate": "%{y} and %{x}: %{z:.3f}<extra></extra>",
    }
    if len(columns) <= _MOST_NUMBERS:
        trace |= {
            "text": [["" if np.isnan(v) else f"{v:.2f}" for v in row] for row in values],
            "texttemplate": "%{text}",
        }
    layout = {
        "xaxis": {"title": "", "type": "category"},
        "yaxis": {"title": "", "type": "category", "autorange": "reversed", "dtick": 1},
    }
    pairs = [
        (abs(values[i, j]), f"{row.name} and {column.name} {values[i, j]:.2f}")
        for i, row in enumerate(rows)
        for j, column in enumerate(columns)
        if np.isfinite(values[i, j]) and row.name != column.name
    ]
    strongest = [words for _, words in sorted(pairs, key=lambda p: -p[0])[:8]]
    return Chart(key, "Rank correlations", [trace], layout, "; ".join(strongest) or "none")


def sensitivity_chart(key: str, found: Sensitivity) -> Chart:
    """Draw the indices of every axis, alone and with others, with their intervals."""
    names = list(found.first)
    data = [
        _bar(role)
        | {
            "name": label,
            "x": [plain(name) for name in names],
            "y": [indices[name].value for name in names],
            "error_y": _errors([indices[name] for name in names]),
            "hovertemplate": "%{y:.3f}<extra>%{x}</extra>",
        }
        for role, label, indices in (
            (0, "alone (first order)", found.first),
            (1, "with others (total)", found.total),
        )
    ]
    layout = {
        "xaxis": {"title": "", "type": "category"},
        "yaxis": {"title": f"share of the variance of {found.metric}"},
        "barmode": "group",
    }
    words = "; ".join(
        f"{name} alone {found.first[name].value:.3f}, with others {found.total[name].value:.3f}"
        for name in names
    )
    interval = f"{found.samples} samples; intervals: {100 * found.confidence:g} %, bootstrap."
    return Chart(key, f"Sensitivity of {found.metric}", data, layout, words, interval)


def _errors(indices: Sequence[Index]) -> dict[str, Any]:
    return {
        "type": "data",
        "symmetric": False,
        "array": [max(i.high - i.value, 0.0) for i in indices],
        "arrayminus": [max(i.value - i.low, 0.0) for i in indices],
        "width": 3,
    }


def _bar(role: int) -> dict[str, Any]:
    return {"type": "bar", "meta": {"role": role}}


def _line(role: int | str, x: Reals, y: Reals, name: str) -> dict[str, Any]:
    line = {"type": "scatter", "mode": "lines", "name": plain(name), "meta": {"role": role}}
    return line | {"x": packed(x, 0.0), "y": packed_values(y), "line": {"width": 1.8}}


def _upright(at: float, top: float, role: str, name: str) -> dict[str, Any]:
    """Return a vertical line."""
    ends = np.array([0.0, 1.05 * top])
    line = _line(role, np.array([at, at]), ends, name)
    return line | {"line": {"width": 1.6, "dash": "dot"}, "hoverinfo": "skip"}


def _points(role: int | str, x: Column, y: Column, of: str) -> dict[str, Any]:
    """Return the runs of one kind as points, which the page fills in."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": of,
        "meta": {"role": role, "points": {"x": x.name, "y": y.name, "of": of}},
        "marker": {"size": 4.5 if role == 0 else 6, "symbol": _SYMBOLS.get(role, "circle")},
    }


def _heat(names_x: Sequence[str], names_y: Sequence[str], values: Reals, scale: str) -> Any:
    packed_cells = packed_values(values.ravel()) | {"shape": f"{values.shape[0]},{values.shape[1]}"}
    return {
        "type": "heatmap",
        "x": [plain(name) for name in names_x],
        "y": [plain(name) for name in names_y],
        "z": packed_cells,
        "meta": {"role": 0, "scale": scale},
    }


def _span(column: Column) -> dict[str, Any]:
    """Return the range of an axis that has every run on it."""
    values = column.values[column.known]
    low, high = np.clip([values.min(), values.max()], -LARGEST, LARGEST)
    margin = 0.06 * (high / 2 - low / 2) * 2 or 0.5 * abs(high) or 0.5
    return {"range": [float(low - margin), float(high + margin)]}


def _ticks(column: Column) -> dict[str, Any]:
    """Return the marks of an axis of truths or texts, whose values are their numbers."""
    if column.kind == "number":
        return {}
    words = ("no", "yes") if column.kind == "truth" else column.words
    cut = [word if len(word) <= 18 else f"{word[:17]}…" for word in words]
    return {
        "tickvals": list(range(len(words))),
        "ticktext": [plain(word) for word in cut],
        "range": [-0.5, len(words) - 0.5] if column.kind == "text" else [-0.06, 1.06],
    }


def _gaps(values: Reals) -> list[float | None]:
    """Return numbers for JSON, which has no NaN."""
    return [float(v) if np.isfinite(v) else None for v in values]
