"""What traces cost: writing records of 10, 20 and 200 doubles, and reading them into NumPy.

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
from tests.benchmarks._trace_rows import RECORDS, Figures


def table(title: str, found: Figures) -> Table:
    """One line per number of doubles and variant; how many times slower than ours."""
    view = Table(title=title, title_justify="left")
    view.add_column("variant")
    view.add_column("doubles", justify="right")
    figures = list(dict.fromkeys(key for by in found.values() for f in by.values() for key in f))
    for figure in figures:
        view.add_column(figure.replace("_", " "), justify="right")
    view.add_column("ours is faster by", justify="right")
    ours = found.get("ours", {})
    for doubles in map(str, RECORDS):
        for variant, by_doubles in found.items():
            row = by_doubles[doubles]
            cells = [_cell(row.get(figure)) for figure in figures]
            view.add_row(variant, doubles, *cells, _times(ours, doubles, row))
    return view


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:,.4g}" if value < 1e4 else f"{value:,.0f}"


def _times(ours: dict[str, dict[str, float]], doubles: str, row: dict[str, float]) -> str:
    cost = "cpu_us_per_record"
    return f"{row[cost] / ours[doubles][cost]:.2f}" if doubles in ours else ""


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
