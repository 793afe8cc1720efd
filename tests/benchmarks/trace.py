"""What traces cost: writing records, and reading them into NumPy.

`python -m tests.benchmarks.trace --json` prints {"write": {VARIANT: ...}, "read": {VARIANT:
...}}; `_trace_write` and `_trace_read` say what the variants are. Without it, tables.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.benchmarks import _trace_read, _trace_write

Measured = dict[str, dict[str, dict[str, float]]]


def table(title: str, found: Measured) -> Table:
    """One line per variant and count; how many times slower than ours."""
    view = Table(title=title, title_justify="left")
    view.add_column("variant")
    view.add_column("records", justify="right")
    figures = list(dict.fromkeys(key for by in found.values() for f in by.values() for key in f))
    for figure in figures:
        view.add_column(figure.replace("_", " "), justify="right")
    view.add_column("ours is faster by", justify="right")
    ours = found.get("ours", {})
    for variant, by_count in found.items():
        for count, row in by_count.items():
            cells = [_cell(row.get(figure)) for figure in figures]
            view.add_row(variant, count, *cells, _times(ours, count, row))
    return view


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:,.4g}" if value < 1e4 else f"{value:,.0f}"


def _times(ours: dict[str, dict[str, float]], count: str, row: dict[str, float]) -> str:
    speed = "records_per_s"
    if count not in ours or speed not in row:
        return ""
    return f"{ours[count][speed] / row[speed]:.2f}"


def main() -> None:
    """Measure, print."""
    console = Console(stderr=True)
    with console.status("") as status:
        found = {
            "write": _trace_write.measure(status.update),
            "read": _trace_read.measure(status.update),
        }
    if "--json" in sys.argv:
        print(json.dumps(found, indent=1))
        return
    for name, measured in found.items():
        Console().print(table(name, measured))


if __name__ == "__main__":
    main()
