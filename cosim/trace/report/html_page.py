"""Render the report as one HTML page that uses no network, and whose policy forbids it.

The library and the figures are most of it: they are compressed, and the page unpacks them. The
policy names the hash of the library as unpacked, so that no other script runs in its place.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import importlib.resources
import json
from collections.abc import Callable, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cosim.core import optional
from cosim.trace.comparison.format import diff_verdict, further_differences
from cosim.trace.report.chart import Chart
from cosim.trace.report.comparison import Comparison
from cosim.trace.report.content import MAX_ROWS, Content

MAX_BYTES = 3_000_000
_POINTS = 90_000
_FEWEST_POINTS = 2_000


def page(content: Content) -> str:
    """Return the page as text, the same for the same content; `InputError` without plotly."""
    return _fitting(
        "page.html.j2", lambda points: figures(content, points), c=content, info=content.info
    )


def comparison_page(found: Comparison) -> str:
    """Return the page of two traces, as `page` does."""
    return _fitting(
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


def plotly_js() -> str:
    """Return the plotly.js of the installed package; `InputError` if there is none."""
    offline = optional("plotly.offline", extra="report", what="a report is drawn with plotly")
    return str(offline.get_plotlyjs())


def figures(content: Content, points: int) -> dict[str, Any]:
    """Return what `report.js` draws: `span`, `paths`, and `charts` by key."""
    return _figures(content.span, [content.path], content.charts, points, ("path",))


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


def _fitting(template: str, drawn: Callable[[int], dict[str, Any]], **values: Any) -> str:
    """Render a page with as many points of the curves as fit.

    drawn : returns the figures, with about so many points.
    """
    library, script = plotly_js(), _resource("report.js")
    environment = Environment(
        loader=PackageLoader("cosim.trace.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"short": _short, "clock": _clock}
    values |= {
        "policy": _policy(library, script),
        "style": Markup(_resource("style.css")),  # noqa: S704 - a file of this package
        "script": Markup(script),  # noqa: S704 - a file of this package
        "library": _packed(library),
    }
    points = _POINTS
    while True:
        data = json.dumps(drawn(points), allow_nan=False, separators=(",", ":"))
        html = environment.get_template(template).render(data=_packed(data), **values)
        # the size of tables and texts is not limited: reduce the points of the curves instead
        if len(html.encode()) < MAX_BYTES or points <= _FEWEST_POINTS:
            return html
        points //= 2


def _packed(text: str) -> str:
    """Compress a text for the page, which unpacks it."""
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")


def _policy(*scripts: str) -> str:
    """Return a content security policy: these scripts, styles in the page, no address outside."""
    hashes = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    return "; ".join(
        (
            "default-src 'none'",
            "script-src " + " ".join(f"'sha256-{value}'" for value in hashes),
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )


def _resource(name: str) -> str:
    text = importlib.resources.files("cosim.trace.report").joinpath(name).read_text("utf-8")
    return text.replace("\r\n", "\n")


def _short(value: float | None, digits: int = 5) -> str:
    return "–" if value is None else f"{value:.{digits}g}"


def _clock(t: float) -> str:
    return f"{t:.3f}".rstrip("0").rstrip(".") + " s"
