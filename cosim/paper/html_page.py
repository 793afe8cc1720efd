"""The report as one HTML page that contains its pictures and needs no network."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from cosim.paper import pictures
from cosim.paper.greatest_delays import ORDER
from cosim.paper.report import AUTHOR, TITLE, Report
from cosim.paper.row import (
    EXAMPLE,
    FIGURES,
    HOW_MEANING,
    MEANING,
    SECTIONS,
    TABLE,
    Verdict,
)

_TONES = {
    Verdict.HOLDS: "good",
    Verdict.CORRECTED: "mended",
    Verdict.DOES_NOT: "bad",
    Verdict.IMPOSSIBLE: "worst",
    Verdict.NOT_COMPARABLE: "open",
}

_NAMES = {"udot": "u̇", "rdot": "ṙ"}
_RULES = (
    # numbers first: 2.40e-6 is no symbol with an index
    (re.compile(r"(\d)e([+-])0*(\d+)\b"), lambda m: f"{m[1]}×10<sup>{_sign(m[2])}{m[3]}</sup>"),
    (re.compile(r"([XYZNAD])_(udot|rdot|[uvwr]{2}|r|K)"), lambda m: _index(m[1], m[2])),
    (re.compile(r"(?<![A-Za-z0-9])([ABDHMkx])(\d)(?=ᵀ|[²⁻]|\b)"), lambda m: _index(m[1], m[2])),
    (re.compile(r"(S|Ω|Π)(\d\d)"), lambda m: _index(m[1], m[2])),
    (re.compile(r"(?<![\w>)])-(?=[\d∫IAωXS/])|(?<=\s)-(?=\s)"), lambda _: "−"),
)


@dataclass(frozen=True)
class _Picture:
    title: str
    text: str
    source: str
    wide: bool = False


def page(report: Report) -> str:
    """Return the report as HTML; the same report gives the same text.

    Raises
    ------
    InputError : matplotlib is not installed.
    """
    environment = Environment(
        loader=PackageLoader("cosim.paper", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["typeset"] = typeset
    return environment.get_template("page.html.j2").render(
        title=TITLE,
        author=AUTHOR,
        summary=report.summary,
        counts=report.counts,
        errors=report.errors,
        tones=_TONES,
        meaning=MEANING,
        how=HOW_MEANING,
        sections=[(name, [row for row in report.rows if row.section == name]) for name in SECTIONS],
        table_section=TABLE,
        table=report.table2,
        order=ORDER,
        pictures=_pictures(report),
    )


def _pictures(report: Report) -> dict[str, list[_Picture]]:
    """Return the pictures of each section."""
    return {
        EXAMPLE: [
            _Picture(
                "The gain that is claimed, and the actual one",
                "The nominal loop with the printed K at d = 0.3 s. At high frequency every loop of "
                "this plant has the gain ‖D1‖ = 5.",
                _uri(pictures.gain_curve()),
            )
        ],
        TABLE: [
            _Picture(
                "Table 2, printed and computed",
                "Logarithmic in the delay. An arrow: certified for every constant delay.",
                _uri(pictures.delays(report.table2)),
            )
        ],
        FIGURES: [
            _Picture(
                "In place of Figure 1: the frames",
                "Four degrees of freedom, from above and from the side.",
                _uri(pictures.frames()),
                wide=True,
            ),
            _Picture(
                "In place of Figure 2: the curve of state variables",
                "Printed K, d = 0.3 s, φ = (10, 10), F = 0.5 sin t, w = sin t.",
                _uri(pictures.states(report.curves)),
            ),
            _Picture(
                "In place of Figure 3: the curve of control u(t)",
                "u = K x of the same run.",
                _uri(pictures.control(report.curves)),
            ),
        ],
    }


def _uri(svg: str) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8")).decode("ascii")


def typeset(text: str) -> Markup:
    """Return a row's text as HTML: k1, A_K, Ω12, 2.4e-6 are set as in a paper."""
    html = str(escape(text))
    for pattern, put in _RULES:
        html = pattern.sub(put, html)
    return Markup(html)  # noqa: S704 - escaped above, and only tags of ours since


def _index(symbol: str, index: str) -> str:
    return f"{symbol}<sub>{_NAMES.get(index, index)}</sub>"


def _sign(text: str) -> str:
    return "−" if text == "-" else ""
