"""Charts as data for plotly.js, without colours, which `report.js` takes from the page's theme.

`meta.role` of a curve is the number of its colour in the palette, or a name ("reference", "limit").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.page import packed_times, packed_values, plain
from cosim.trace.report.decimation import decimated
from cosim.trace.report.series import DrawnSeries, Reals

_DASHES = ("solid", "dash", "dot", "dashdot")
PALETTE = 7
"""Number of colours of the theme; the next seven curves have another dash."""


@dataclass
class Curve:
    """A line over time.

    Attributes
    ----------
    role : number of a colour, or a name that the page knows.
    hidden : shown in the legend only, until it is clicked.
    text : of each point, which is then drawn as a mark.
    source : `/component/direction/name` of the signal, "" for derived values.
    """

    label: str
    t: Reals
    values: Reals
    stepwise: bool = False
    role: int | str = 0
    unit: str = ""
    hidden: bool = False
    text: Sequence[str] | None = None
    source: str = ""

    def trace(self, segments: int) -> dict[str, Any]:
        """Return the curve as plotly.js takes it, thinned to so many segments of time."""
        kept = decimated(self.t, self.values, segments, stepwise=self.stepwise)
        t, values = self.t[kept], self.values[kept]
        drawn: dict[str, Any] = {
            "type": "scatter",
            "name": self.label,
            "x": packed_times(t),
            "y": packed_values(values),
            "meta": {"role": self.role},
            "hovertemplate": f"%{{y:.5~g}} {plain(self.unit)}<extra>{plain(self.label)}</extra>",
        }
        if self.text is not None:  # marks, not a line
            drawn |= {"mode": "markers", "text": [self.text[i] for i in kept]}
            drawn["hovertemplate"] = f"%{{text}}<extra>{plain(self.label)}</extra>"
        else:
            number = self.role if isinstance(self.role, int) else 0
            dash = _DASHES[number // PALETTE % len(_DASHES)]
            drawn |= {
                "mode": "lines",
                "line": {"shape": "hv" if self.stepwise else "linear", "dash": dash, "width": 1.6},
                "connectgaps": False,
            }
        if self.hidden:
            drawn["visible"] = "legendonly"
        return drawn


@dataclass
class Chart:
    """Curves on one time axis.

    Attributes
    ----------
    key : identifier on the page.
    quantity : of the vertical axis, where it is not the title.
    bounds : label and value of level lines, such as limits.
    """

    key: str
    title: str
    unit: str
    curves: list[Curve] = field(default_factory=list)
    bounds: list[tuple[str, float]] = field(default_factory=list)
    note: str = ""
    quantity: str = ""

    @property
    def axis_title(self) -> str:
        """What the vertical axis shows, with its unit."""
        name = self.quantity or self.title
        return f"{name} [{self.unit}]" if self.unit else name

    def figure(self, segments: int) -> dict[str, Any]:
        """Return `data` and `layout` for plotly.js."""
        data = [curve.trace(segments) for curve in self.curves if curve.t.size]
        data += self._levels()
        return {
            "data": data,
            "layout": {
                "xaxis": {"title": {"text": "time t [s]"}},
                "yaxis": {"title": {"text": plain(self.axis_title)}},
            },
        }

    def summary(self) -> str:
        """Describe the chart in words, for screen readers."""
        parts = []
        for curve in self.curves:
            finite = curve.values[np.isfinite(curve.values)]
            if finite.size and curve.text is None:
                parts.append(f"{curve.label} from {finite.min():.4g} to {finite.max():.4g}")
        return f"{self.title} [{self.unit}] over time: {'; '.join(parts) or 'no values'}"

    def _levels(self) -> list[dict[str, Any]]:
        ends = [c.t[i] for c in self.curves if c.t.size for i in (0, -1)]
        if not ends:
            return []
        span = np.array([min(ends), max(ends)])
        return [
            {
                "type": "scatter",
                "mode": "lines",
                "name": label,
                "x": packed_times(span),
                "y": packed_values(np.array([value, value])),
                "meta": {"role": "limit"},
                "line": {"dash": "dot", "width": 1.4},
                "hovertemplate": f"{value:.6g} {plain(self.unit)}<extra>{plain(label)}</extra>",
            }
            for label, value in self.bounds
        ]


def curve_of(
    series: DrawnSeries, role: int | str, label: str = "", *, hidden: bool = False
) -> Curve:
    """Return the curve of a signal."""
    return Curve(
        label or series.full_name,
        series.t,
        series.values,
        stepwise=series.stepwise,
        role=role,
        unit=series.unit or "",
        hidden=hidden,
        source=f"{series.topic}/{series.name}",
    )
