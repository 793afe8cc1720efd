"""Chart any signals, by component, direction and unit."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from cosim.trace.report.chart import PALETTE, Chart, curve_of
from cosim.trace.report.series import DrawnSeries, Recording

MAX_CHARTS = 48


def charts_of(recording: Recording, drawn: Collection[str]) -> Iterator[Chart]:
    """Yield charts of the signals that change and are not `drawn` ("/topic name"); outputs first.

    A link's signals are left out where the sender's outputs are in the trace.
    """
    sent = {s.full_name for s in recording.series if s.direction == "output"}
    groups: dict[tuple[str, str, str], list[DrawnSeries]] = {}
    order = {"output": 0, "": 1, "link": 2, "input": 3}
    for series in sorted(recording.series, key=lambda s: order.get(s.direction, 1)):
        if f"{series.topic} {series.name}" in drawn or is_constant(series):
            continue
        if series.direction == "link" and series.name in sent:
            continue
        key = (series.component, series.direction, series.unit or "")
        groups.setdefault(key, []).append(series)
    parts = [
        (key, members[first : first + PALETTE])
        for key, members in groups.items()
        for first in range(0, len(members), PALETTE)
    ]
    for number, ((component, direction, unit), part) in enumerate(parts[:MAX_CHARTS]):
        curves = [curve_of(s, i, s.name) for i, s in enumerate(part)]
        yield Chart(f"signals-{number}", f"{component} {direction}".strip(), unit, curves)


def is_constant(series: DrawnSeries) -> bool:
    """Whether a signal never changes."""
    values = series.values
    return bool(np.all((values == values[:1]) | (np.isnan(values) & np.isnan(values[:1]))))
