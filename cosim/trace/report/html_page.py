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
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cosim.core import optional
from cosim.trace.report.content import Content

MAX_BYTES = 3_000_000
_POINTS = 90_000
_FEWEST_POINTS = 2_000


def page(content: Content) -> str:
    """Return the page as text, the same for the same content; `InputError` without plotly."""
    library = plotly_js()
    points = _POINTS
    while True:
        html = _rendered(content, library, points)
        # the size of tables and texts is not limited: reduce the points of the curves instead
        if len(html.encode()) < MAX_BYTES or points <= _FEWEST_POINTS:
            return html
        points //= 2


def plotly_js() -> str:
    """Return the plotly.js of the installed package; `InputError` if there is none."""
    offline = optional("plotly.offline", extra="report", what="a report is drawn with plotly")
    return str(offline.get_plotlyjs())


def figures(content: Content, points: int) -> dict[str, Any]:
    """Return what `report.js` draws: `span`, `path`, and `charts` by key."""
    curves = sum(len(chart.curves) for chart in content.charts)
    segments = min(max(points // (4 * max(curves, 1)), 8), 1500)
    return {
        "span": list(content.span),
        "path": content.path,
        "charts": {chart.key: chart.figure(segments) for chart in content.charts},
    }


def _rendered(content: Content, library: str, points: int) -> str:
    environment = Environment(
        loader=PackageLoader("cosim.trace.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"short": _short, "clock": _clock}
    script = _resource("report.js")
    data = json.dumps(figures(content, points), allow_nan=False, separators=(",", ":"))
    return environment.get_template("page.html.j2").render(
        c=content,
        info=content.info,
        policy=_policy(library, script),
        style=Markup(_resource("style.css")),  # noqa: S704 - a file of this package
        script=Markup(script),  # noqa: S704 - a file of this package
        library=_packed(library),
        data=_packed(data),
    )


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
