"""The chart of a stability boundary: measured, exact and certified, as in `stability_picture`."""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.page import packed_values, plain
from cosim.study.columns import Column, Reals, StudyColumns
from cosim.study.consistency import certified_metric
from cosim.study.pictures import edges
from cosim.study.report.chart import Chart
from cosim.study.schema import StabilityPart
from cosim.study.stability_boundary import Boundary
from cosim.study.stability_picture import outline

_KEY = "stability"


def stability_chart(columns: StudyColumns, found: Boundary) -> Chart:
    """Draw stability over delay, or delay and loss, with the certified and the exact bounds."""
    part = columns.study.stability
    assert part is not None  # noqa: S101 - without it there is no boundary
    x_axis = {"title": plain(f"{part.delay}: delay of the whole loop [s]")}
    if part.loss is None:
        data, y_axis = _over_delay(columns, part, found)
    else:
        data, y_axis = _over_delay_and_loss(columns, part, found)
    layout = {"xaxis": x_axis, "yaxis": y_axis}
    if columns.runs.size < columns.count:
        note = "The study is not finished: the boundary is that of the runs that are done."
    else:
        note = ""
    words = "; ".join(
        f"{f'loss {edge.loss:g}: ' if edge.loss is not None else ''}stable up to {edge.stable_to},"
        f" not stable from {edge.unstable_from}"
        for edge in found.edges
    )
    return Chart(_KEY, "Stability", data, layout, words, note)


def _over_delay(
    columns: StudyColumns, part: StabilityPart, found: Boundary
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    delay, stable = columns.axes[part.delay], columns.metrics[part.stable]
    drawn = columns.metrics[part.gain] if part.gain else stable
    known = drawn.values[drawn.known]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    edge, first = found.edges[0], min(0.0, float(np.nanmin(delay.values, initial=0.0)))
    data = []
    if found.certified_age is not None:
        name = f"certified: every age up to {found.certified_age:.4g} s"
        data.append(_band(first, found.certified_age, low, high, 2, name))
    if edge.stable_to is not None and edge.unstable_from is not None:
        name = f"measured boundary: {edge.stable_to:.4g} to {edge.unstable_from:.4g} s"
        data.append(_band(edge.stable_to, edge.unstable_from, low, high, 1, name))
    for value, role, symbol, name in (
        (1.0, 0, "circle", "measured: stable"),
        (0.0, "limit", "x", "measured: not stable"),
    ):
        kept = (stable.values == value) & drawn.known
        points = {"mode": "markers", "marker": {"size": 7, "symbol": symbol}}
        data.append(_curve(delay.values[kept], drawn.values[kept], role, name) | points)
    data += _margin(found, low, high)
    return data, {"title": plain(drawn.title), "range": [low, high]}


def _over_delay_and_loss(
    columns: StudyColumns, part: StabilityPart, found: Boundary
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Draw the delay on the x axis and one row of equal height per loss."""
    delay, loss = columns.axes[part.delay], columns.axes[part.loss or ""]
    stable = columns.metrics[part.stable]
    x, y, share = _means(delay, loss, stable)
    bx: Reals = np.asarray(edges(x), np.float64)
    by: Reals = np.arange(y.size + 1, dtype=np.float64) - 0.5
    data = []
    if part.gain:
        gain = columns.metrics[part.gain]
        settled = Column("", "number", np.where(stable.values == 1.0, gain.values, np.nan))
        _, _, values = _means(delay, loss, settled)
        heat = _cells(bx, by, np.where(share == 1.0, values, np.nan), "map")
        title = {"text": plain(f"{gain.title}, mean"), "side": "right"}
        data.append(heat | {"colorbar": {"title": title}})
    unstable = np.where(share < 1.0, 1.0 - share, np.nan)
    data.append(
        _cells(bx, by, unstable, "unstable")
        | {"showscale": False, "zmin": 0.0, "zmax": 1.0}
        | {"hovertemplate": "%{z:.0%} of the runs not stable<extra></extra>"}
    )
    if (share < 1.0).any():
        square = {"mode": "markers", "marker": {"size": 12, "symbol": "square"}}
        name = "not stable (darker: more of the runs)"
        data.append(_curve(np.array([np.nan]), np.array([np.nan]), "limit", name) | square)
    data.append(_border(bx, by, share >= 1.0, "reference", "measured: all runs stable to here"))
    certified = certified_metric(columns.study)
    if certified is not None:
        _, _, kept = _means(delay, loss, columns.metrics[certified])
        name = "certified: every assumption of the guarantee met"
        data.append(_border(bx, by, kept >= 1.0, 2, name))
    if found.certified_age is not None:
        at, ends = np.full(2, found.certified_age), np.array([by[0], by[-1]])
        line = _curve(at, ends, 2, f"age that the design allows: {at[0]:.4g} s")
        data.append(line | {"mode": "lines", "line": {"width": 1.8, "dash": "dot"}})
    data += _margin(found, float(by[0]), float(by[-1]))
    ticks = {"tickvals": list(range(y.size)), "ticktext": [f"{value:g}" for value in y]}
    return data, {
        "title": plain(f"{part.loss}: share of messages lost"),
        "range": [float(by[0]), float(by[-1])],
        **ticks,
    }


def _means(x: Column, y: Column, values: Column) -> tuple[Reals, Reals, Reals]:
    """Return the values of two axes, (nx,) and (ny,), and the mean in each cell, (ny, nx)."""
    at_x, i = np.unique(x.values, return_inverse=True)
    at_y, j = np.unique(y.values, return_inverse=True)
    place, size = j * at_x.size + i, at_x.size * at_y.size
    known = values.known
    n = np.bincount(place[known], minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(place[known], values.values[known], size) / n
    return at_x, at_y, mean.reshape(at_y.size, at_x.size)


def _margin(found: Boundary, low: float, high: float) -> list[dict[str, Any]]:
    if found.exact_margin is None:
        return []
    at = np.full(2, found.exact_margin)
    name = f"exact delay margin{'' if len(found.edges) == 1 else ', no loss'}: {at[0]:.4g} s"
    line = _curve(at, np.array([low, high]), "reference", name)
    return [line | {"mode": "lines", "line": {"width": 1.8, "dash": "dash"}}]


def _curve(x: Reals, y: Reals, role: int | str, name: str) -> dict[str, Any]:
    drawn = {"type": "scatter", "x": packed_values(x), "y": packed_values(y)}
    hover = f"%{{x:.4~g}} s: %{{y:.5~g}}<extra>{plain(name)}</extra>"
    return drawn | {"name": plain(name), "meta": {"role": role}, "hovertemplate": hover}


def _band(x0: float, x1: float, low: float, high: float, role: int, name: str) -> dict[str, Any]:
    corners = _curve(np.array([x0, x1, x1, x0]), np.array([low, low, high, high]), role, name)
    return corners | {"mode": "lines", "fill": "toself", "line": {"width": 0}, "hoverinfo": "skip"}


def _border(bx: Reals, by: Reals, inside: Any, role: int | str, name: str) -> dict[str, Any]:
    """Draw the border of a set of cells as one line with gaps."""
    pieces = outline(bx, by, inside)
    gap = [np.nan]
    x = np.array([v for px, _ in pieces for v in (*px, *gap)])
    y = np.array([v for _, py in pieces for v in (*py, *gap)])
    line = {"mode": "lines", "line": {"width": 3}, "connectgaps": False, "hoverinfo": "skip"}
    return _curve(x, y, role, name) | line


def _cells(bx: Reals, by: Reals, values: Reals, scale: str) -> dict[str, Any]:
    return {
        "type": "heatmap",
        "x": [float(v) for v in bx],
        "y": [float(v) for v in by],
        "z": packed_values(values.ravel()) | {"shape": f"{values.shape[0]},{values.shape[1]}"},
        "meta": {"role": 0, "scale": scale},
        "hovertemplate": "%{x:.4~g} s: %{z:.5~g}<extra></extra>",
    }
