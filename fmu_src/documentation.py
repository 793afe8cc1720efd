"""documentation/ of an FMU: a page from the component's readme and its variables."""

from __future__ import annotations

import html
from importlib.resources import files

from markdown_it import MarkdownIt

from .certified import certified_section
from .spec import ComponentSpec, Variable

_STYLE = """
body{font:16px/1.55 system-ui,sans-serif;color:#1d2733;max-width:60rem;
margin:2.5rem auto;padding:0 1rem}
h1,h2{line-height:1.2;color:#0b3c5d}pre{background:#f3f6f9;padding:.9rem 1.1rem;overflow-x:auto;
border-left:3px solid #328cc1}code{font-size:.93em}table{border-collapse:collapse;width:100%}
td,th{padding:.3rem .6rem;border-bottom:1px solid #dde4ea;text-align:left;vertical-align:top}
td.n{font-family:ui-monospace,monospace;white-space:nowrap}p.lead{font-size:1.15rem;color:#42515f}
"""


def documentation_files(spec: ComponentSpec) -> dict[str, bytes]:
    """Archive path -> content: documentation/index.html, the licence, and model.png."""
    licence = files("fmu_src").joinpath("LICENSE").read_bytes()
    return {
        "documentation/index.html": _page(spec).encode(),
        "documentation/licenses/license.txt": licence,
        "model.png": spec.readme.with_name("model.png").read_bytes(),
    }


def _page(spec: ComponentSpec) -> str:
    body = MarkdownIt("commonmark").enable("table").render(spec.readme.read_text("utf-8"))
    tables = "".join(
        _table(title, [v for v in spec.variables if v.causality == causality])
        for title, causality in (
            ("Inputs", "input"),
            ("Outputs", "output"),
            ("Parameters", "parameter"),
        )
    )
    certified = ""
    if spec.certificate is not None:
        certified = certified_section(spec.certificate, f"{spec.name}.fmu")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{html.escape(spec.name)}</title><style>{_STYLE}</style></head><body>\n"
        f'<h1>{html.escape(spec.name)}</h1>\n<p class="lead">{html.escape(spec.description)}.</p>\n'
        f"{body}\n{certified}<h2>Variables</h2>\n{tables}"
        '<p>MIT licence, see <a href="licenses/license.txt">license.txt</a>.</p></body></html>\n'
    )


def _table(title: str, variables: list[Variable]) -> str:
    if not variables:
        return ""
    rows = "".join(
        f'<tr><td class="n">{html.escape(v.name)}</td><td>{html.escape(v.unit or "–")}</td>'
        f"<td>{v.start:g}</td><td>{html.escape(v.description)}</td></tr>\n"
        for v in variables
    )
    return (
        f"<h3>{title}</h3>\n<table><tr><th>name</th><th>unit</th><th>start</th><th>meaning</th>"
        f"</tr>\n{rows}</table>\n"
    )
