"""Charts of any signals: by component, direction and unit."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from cosim.trace.report.chart import PALETTE, Chart, curve_of
from cosim.trace.report.series import Recording, Series

MAX_CHARTS = 48


def charts_of(recording: Recording, drawn: Collection[str]) -> Iterator[Chart]:
    """What is not `drawn` yet ("/topic name") and changes; outputs first.

    What a link delivers is left out where its sender's output is in the trace.
    """
    sent = {s.full_name for s in recording.series if s.direction == "output"}
    groups: dict[tuple[str, str, str], list[Series]] = {}
    order = {"output": 0, "": 1, "link": 2, "input": 3}
    for series in sorted(recording.series, key=lambda s: order.get(s.direction, 1)):
        if f"{series.topic} {series.name}" in drawn or is_constant(series):
            continue
        if series.direction == "link" and series.name in sent:
            continue
        key = (series.component, series.direction, series.unit or "")
        groups.setdefault(key, []).append(series)
    number = 0
    for (component, direction, unit), members in groups.items():
        for first in range(0, len(members), PALETTE):
            if number == MAX_CHARTS:
                return
            some = members[first : first + PALETTE]
            curves = [curve_of(s, i, s.name) for i, s in enumerate(some)]
            title = f"{component} {direction}".strip()
            yield Chart(f"signals-{number}", title, unit, curves)
            number += 1


def is_constant(series: Series) -> bool:
    """Whether a signal never changes."""
    values = series.values
    return bool(np.all((values == values[:1]) | (np.isnan(values) & np.isnan(values[:1]))))
