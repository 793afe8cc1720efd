"""Tables for notebooks: what `_repr_html_` returns."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape


def html_table(line: str, rows: Mapping[str, str]) -> str:
    """Return a line, without the angle brackets of a `repr`, and a table of names and values."""
    text = escape(line[1:-1] if line.startswith("<") and line.endswith(">") else line)
    body = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<p>{text}</p><table>{body}</table>"


def matrix_text(matrix: object, *, most: int = 8) -> str:
    """Return a matrix in one line, six digits each; its size where it has more than `most`."""
    rows = getattr(matrix, "tolist", lambda: matrix)()
    if not isinstance(rows, list) or not rows or not isinstance(rows[0], list):
        return str(rows)
    if sum(len(row) for row in rows) > most:
        return f"{len(rows)} x {len(rows[0])}"
    return "[" + ", ".join("[" + ", ".join(f"{x:.6g}" for x in row) + "]" for row in rows) + "]"
