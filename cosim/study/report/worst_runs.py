"""The runs with the largest and smallest values of each metric, for the table of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.study.columns import Column, StudyColumns

COUNTS = (5, 10, 20, 50)
"""Choices of how many runs are listed."""
_MANY_METRICS = 8
_MOST_AXES = 6


@dataclass(frozen=True)
class WorstRuns:
    """Which runs have the largest and smallest values.

    Attributes
    ----------
    metric, order : chosen when the page is opened: that of `traces = "worst:N by METRIC"`.
    places : metric -> "largest" or "smallest" -> places in the table.
    axes : metric -> the axes that explain it most.
    """

    metric: str
    order: str
    places: dict[str, dict[str, list[int]]]
    axes: dict[str, list[str]]


def worst_runs(
    columns: StudyColumns, ranked_axes: Mapping[str, Sequence[Column]]
) -> WorstRuns | None:
    """Rank the runs by each metric that is a number or a truth; None if there is none."""
    metrics = [m for m in columns.metrics.values() if m.kind != "text" and m.known.any()]
    if not metrics:
        return None
    most = COUNTS[-1] if len(metrics) <= _MANY_METRICS else COUNTS[-2]
    by = columns.study.worst[1] if columns.study.worst is not None else ""
    numbers = [m.name for m in metrics if m.kind == "number"] or [metrics[0].name]
    named = by.removeprefix("-")
    metric = named if named in {m.name for m in metrics} else numbers[0]
    return WorstRuns(
        metric=metric,
        order="smallest" if by.startswith("-") or metric not in numbers else "largest",
        places={m.name: _extremes(m, most) for m in metrics},
        axes={m.name: [axis.name for axis in ranked_axes[m.name][:_MOST_AXES]] for m in metrics},
    )


def _extremes(metric: Column, most: int) -> dict[str, list[int]]:
    known = np.flatnonzero(metric.known)
    values = metric.values[known]
    # of equal values, the run with the smaller number first
    rising = known[np.argsort(values, kind="stable")[:most]]
    falling = known[np.argsort(-values, kind="stable")[:most]]
    return {"largest": falling.tolist(), "smallest": rising.tolist()}


def worst_figures(
    columns: StudyColumns, found: WorstRuns, trace_of: Callable[[int], str | None]
) -> dict[str, Any]:
    """Return what `study.js` fills the table with."""
    listed = {p for orders in found.places.values() for places in orders.values() for p in places}
    everything = [*columns.axes.values(), *columns.metrics.values()]
    runs = columns.runs.tolist()
    return {
        "axes": found.axes,
        "order": {
            metric: {order: [runs[p] for p in places] for order, places in orders.items()}
            for metric, orders in found.places.items()
        },
        "runs": {
            runs[place]: {
                "status": columns.statuses[place].replace("_", " "),
                "trace": trace_of(runs[place]),
                "values": {c.name: c.text(float(c.values[place])) for c in everything},
            }
            for place in sorted(listed)
        },
    }
