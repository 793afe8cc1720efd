"""Render the report of a trace, or of two, as one HTML page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from cosim.page import render_page
from cosim.trace.comparison.format import diff_verdict, further_differences
from cosim.trace.report.chart import Chart
from cosim.trace.report.comparison import Comparison
from cosim.trace.report.link_spans import shaded
from cosim.trace.report.page_content import MAX_ROWS, Content

MAX_SPANS = 300
"""Most stretches that are shaded: each chart has them all."""


def page(content: Content) -> str:
    """Return the page as text, the same for the same content; `InputError` without plotly."""
    return _rendered(
        "page.html.j2", lambda points: figures(content, points), c=content, info=content.info
    )


def comparison_page(found: Comparison) -> str:
    """Return the page of two traces, as `page` does."""
    return _rendered(
        "comparison.html.j2",
        lambda points: _figures(
            found.span, [found.a.path, found.b.path], found.charts, points, ("first", "second")
        ),
        c=found,
        verdict=diff_verdict(found.found),
        further=list(further_differences(found.found)),
        texts=sorted(found.found.context.texts.items(), key=lambda item: _scenario_first(item[0])),
        most_rows=MAX_ROWS,
    )


def _scenario_first(name: str) -> tuple[bool, str]:
    return not name.endswith(".toml"), name


def figures(content: Content, points: int) -> dict[str, Any]:
    """Return what `report.js` draws: `span`, `spans`, `links`, `paths`, and `charts` by key."""
    return {
        **_figures(content.span, [content.path], content.charts, points, ("path",)),
        "spans": shaded(content.spans)[:MAX_SPANS],
        "links": content.messages,
    }


def _figures(
    span: tuple[float, float],
    paths: Sequence[dict[str, Any] | None],
    charts: Sequence[Chart],
    points: int,
    names: Sequence[str],
) -> dict[str, Any]:
    curves = sum(len(chart.curves) for chart in charts)
    segments = min(max(points // (4 * max(curves, 1)), 8), 1500)
    return {
        "span": list(span),
        "paths": [
            {"name": name, "role": role, **path}
            for role, (name, path) in enumerate(zip(names, paths, strict=True))
            if path
        ],
        "charts": {chart.key: chart.figure(segments) for chart in charts},
    }


def _rendered(template: str, drawn: Callable[[int], dict[str, Any]], **values: Any) -> str:
    scripts = ("animation.js", "report.js")
    return render_page("cosim.trace.report", template, scripts, drawn, **values)
