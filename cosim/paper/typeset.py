"""Plain text with k1, A_K, Ω12, 2.4e-6 as HTML, the way a paper sets them."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

_NAMES = {"udot": "u̇", "rdot": "ṙ"}
_RULES = (
    # numbers first: 2.40e-6 is no symbol with an index
    (re.compile(r"(\d)e([+-])0*(\d+)\b"), lambda m: f"{m[1]}×10<sup>{_sign(m[2])}{m[3]}</sup>"),
    (re.compile(r"([XYZNAD])_(udot|rdot|[uvwr]{2}|r|K)"), lambda m: _index(m[1], m[2])),
    (re.compile(r"(?<![A-Za-z0-9])([ABDHMkx])(\d)(?=ᵀ|[²⁻]|\b)"), lambda m: _index(m[1], m[2])),
    (re.compile(r"(S|Ω|Π)(\d\d)"), lambda m: _index(m[1], m[2])),
    (re.compile(r"(?<![\w>)])-(?=[\d∫IAωXS/])|(?<=\s)-(?=\s)"), lambda _: "−"),
)


def typeset(text: str) -> Markup:
    """HTML of a row's text; whatever is not known stays as it is."""
    html = str(escape(text))
    for pattern, put in _RULES:
        html = pattern.sub(put, html)
    return Markup(html)  # noqa: S704 - escaped above, and only tags of ours since


def _index(symbol: str, index: str) -> str:
    return f"{symbol}<sub>{_NAMES.get(index, index)}</sub>"


def _sign(text: str) -> str:
    return "−" if text == "-" else ""
