"""Render an HTML page that uses no network, and whose policy forbids it.

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

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cosim.core import optional

MAX_BYTES = 3_000_000
_POINTS = 90_000
_FEWEST_POINTS = 2_000
_HERE = "cosim.page"


def render_page(
    package: str,
    template: str,
    scripts: Sequence[str],
    drawn: Callable[[int], dict[str, Any]],
    **values: Any,
) -> str:
    """Render a page with as many points of its charts as fit; the same content, the same text.

    Parameters
    ----------
    package : the package that has the template and the scripts.
    template : extends `base.html.j2`.
    scripts : the last one draws the charts; it calls `drawPage` of `page.js`.
    drawn : returns what the script draws, as JSON values, with about so many points.
    values : of the template.

    Raises
    ------
    InputError : plotly is not installed.
    """
    library = plotly_js()
    script = "".join([_resource(_HERE, "page.js"), *(_resource(package, s) for s in scripts)])
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader(_HERE, ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"short": _short, "clock": _clock}
    values |= {
        "policy": _policy(library, script),
        "style": Markup(_resource(_HERE, "style.css")),  # noqa: S704 - a file of this package
        "script": Markup(script),  # noqa: S704 - files of these packages
        "library": _packed(library),
    }
    points = _POINTS
    while True:
        data = json.dumps(drawn(points), allow_nan=False, separators=(",", ":"))
        html = environment.get_template(template).render(data=_packed(data), **values)
        # the size of tables and texts is not limited: reduce the points of the charts instead
        if len(html.encode()) < MAX_BYTES or points <= _FEWEST_POINTS:
            return html
        points //= 2


def plotly_js() -> str:
    """Return the plotly.js of the installed package; `InputError` if there is none."""
    offline = optional("plotly.offline", extra="report", what="a report is drawn with plotly")
    return str(offline.get_plotlyjs())


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


def _resource(package: str, name: str) -> str:
    text = importlib.resources.files(package).joinpath(name).read_text("utf-8")
    return text.replace("\r\n", "\n")


def _short(value: float | None, digits: int = 5) -> str:
    return "–" if value is None else f"{value:.{digits}g}"


def _clock(t: float) -> str:
    return f"{t:.3f}".rstrip("0").rstrip(".") + " s"
