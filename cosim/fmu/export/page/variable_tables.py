"""Write variables as HTML: tables of inputs, outputs and parameters, and matrices."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence

from cosim.fmu.export.spec import ComponentSpec, Variable

_ENTRY = re.compile(r"(.+)\[(\d+),(\d+)\]")
_WIDE = 8  # more columns: numbers have four digits
_GROUPS = (("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter"))


def variable_tables(spec: ComponentSpec) -> str:
    """Return tables of unit, start value and meaning; entries of a matrix are shown as a matrix."""
    parts = []
    for title, causality in _GROUPS:
        chosen = [v for v in spec.variables if v.causality == causality]
        matrices = _matrices(chosen)
        inside = {id(v) for entries in matrices.values() for v in entries.values()}
        single = [v for v in chosen if id(v) not in inside]
        if chosen:
            parts.append(f"<h3>{title}</h3>\n")
        if single:
            parts.append(_table(single))
        if matrices:
            grids = "".join(_grid(name, entries) for name, entries in matrices.items())
            parts.append(f'<div class="grids">{grids}</div>\n')
    return "".join(parts)


def _matrices(variables: Sequence[Variable]) -> dict[str, dict[tuple[int, int], Variable]]:
    found: dict[str, dict[tuple[int, int], Variable]] = {}
    for v in variables:
        entry = _ENTRY.fullmatch(v.name)
        if entry is not None:
            found.setdefault(entry[1], {})[int(entry[2]), int(entry[3])] = v
    return found


def _table(variables: Sequence[Variable]) -> str:
    rows = "".join(
        f"<tr><td><code>{html.escape(v.name)}</code></td><td>{_unit(v.unit)}</td>"
        f'<td class="n">{_number(v.start)}</td><td class="n">{_range(v)}</td>'
        f"<td>{html.escape(v.description)}</td></tr>\n"
        for v in variables
    )
    return (
        '<div class="wide"><table><tr><th class="name">name</th><th class="unit">unit</th>'
        '<th class="n">start</th><th class="n">range</th><th>meaning</th></tr>\n'
        f"{rows}</table></div>\n"
    )


def _grid(name: str, entries: Mapping[tuple[int, int], Variable]) -> str:
    rows = max(i for i, _ in entries)
    columns = max(j for _, j in entries)
    digits = 6 if columns <= _WIDE else 4
    first = next(iter(entries.values()))
    body = "".join(
        "<tr>"
        + "".join(_cell(entries.get((i, j)), digits) for j in range(1, columns + 1))
        + "</tr>\n"
        for i in range(1, rows + 1)
    )
    unit = "" if first.unit is None else f", {_unit(first.unit)}"
    wide = " many" if columns > _WIDE else ""
    meaning = html.escape(_of_any_entry(first.description))
    return (
        f'<figure><figcaption><code>{html.escape(name)}[i,j]</code> <span class="size">{rows} × '
        f'{columns}{unit}: {meaning}</span></figcaption><table class="matrix{wide}">{body}</table>'
        "</figure>\n"
    )


def _of_any_entry(description: str) -> str:
    """Make the description of entry (1,1) one of entry (i,j)."""
    for index in ("i", "j"):
        description = re.sub(r"\b1\b", index, description, count=1)
    return description


def _cell(v: Variable | None, digits: int) -> str:
    if v is None:
        return "<td></td>"
    faint = ' class="zero"' if v.start == 0 else ""
    exact = html.escape(f"{v.name} = {v.start!r}: {v.description}")
    return f'<td title="{exact}"{faint}>{_number(v.start, digits)}</td>'


def _number(value: float, digits: int = 6) -> str:
    """Format a double exactly if that is short, else to `digits`; with a typeset minus."""
    exact = repr(float(value)).removesuffix(".0")
    short = len(exact) <= digits + 2 or exact.isdigit()
    return (exact if short else f"{value:.{digits}g}").replace("-", "−")


def _range(v: Variable) -> str:
    if v.minimum is not None and v.maximum is not None:
        return f"{_number(v.minimum)} … {_number(v.maximum)}"
    if v.minimum is not None:
        return f"≥ {_number(v.minimum)}"
    return "" if v.maximum is None else f"≤ {_number(v.maximum)}"


def _unit(unit: str | None) -> str:
    """Format a unit such as `m/s2` with exponents raised."""
    if unit is None:
        return "–"
    text = html.escape(unit).replace(".", "·")
    return re.sub(r"(?<=[a-z])([23])", r"<sup>\1</sup>", text)
