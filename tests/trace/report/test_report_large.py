"""The report of a large trace: what it measures is exact, and what it draws has every extreme."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.trace import Trace
from cosim.trace.report import series
from cosim.trace.report.content import content_of

REFERENCE = Path(__file__).parents[3] / "traces" / "reference" / "auv-acoustic.mcap"


def test_a_report_read_in_parts_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures, timeline and table are equal; curves have fewer points, and the same extremes."""
    whole = content_of(REFERENCE)
    monkeypatch.setattr(series, "LARGE", 0)
    monkeypatch.setattr(series, "_SEGMENTS", 200)
    monkeypatch.setitem(Trace.parts.__kwdefaults__, "part_bytes", 50_000)
    parts: list[Any] = []
    real = series.Recording._add

    def counted(self: Any, tables: Any, segments: Any) -> None:
        parts.append(segments)
        real(self, tables, segments)

    monkeypatch.setattr(series.Recording, "_add", counted)
    thin = content_of(REFERENCE)
    assert len(parts) >= 2
    for name in ("rows", "links", "timeline", "bars", "span", "log", "left_out", "figures"):
        assert getattr(thin, name) == getattr(whole, name), name
    fewer = 0
    for one, two in zip(whole.charts, thin.charts, strict=True):
        for a, b in zip(one.curves, two.curves, strict=True):
            assert (a.label, b.t[0], b.t[-1]) == (b.label, a.t[0], a.t[-1])
            assert np.nanmax(a.values) == np.nanmax(b.values)
            assert np.nanmin(a.values) == np.nanmin(b.values)
            # each point kept is one of the trace
            assert np.isin(b.t, a.t).all()
            fewer += b.t.size < 0.9 * a.t.size
    assert fewer > 5
