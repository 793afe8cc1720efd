"""Every output of the command line, at every place where an output may be asked for.

    python -m tests.outputs.table [--json] [--output NAME ...] [--place NAME ...]

For each row the command runs in a process of its own: its exit code, what it says, and whether the
place is what it was or has the content, nothing is half written and nothing is left.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

if __package__ == "tests.outputs":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from outputs.every_output import OUTPUTS, make_stock
from outputs.places import PLACES
from outputs.rows import Found, rows, try_row


def main() -> int:
    """Print the table; 0 if every row is as it must be."""
    parser = argparse.ArgumentParser(prog="python -m tests.outputs.table")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--output", nargs="*", choices=[output.name for output in OUTPUTS])
    parser.add_argument("--place", nargs="*", choices=PLACES)
    asked = parser.parse_args()
    chosen = [
        row
        for row in rows()
        if row.output.name in (asked.output or [row.output.name])
        and row.place in (asked.place or [row.place])
    ]
    found = []
    with tempfile.TemporaryDirectory(prefix="outputs-") as folder:
        Path(folder).chmod(0o755)
        stock = Path(folder, "stock")
        stock.mkdir()
        make_stock(stock)
        for i, row in enumerate(chosen, 1):
            print(f"\r{i}/{len(chosen)} {row.name:60}", end="", file=sys.stderr, flush=True)
            home = Path(tempfile.mkdtemp(dir=folder))
            found.append(try_row(row, stock, home))
    print(file=sys.stderr)
    if asked.json:
        print(json.dumps([_json(each) for each in found], indent=1))
    else:
        _show(found)
    return int(any(each.departures for each in found))


def _json(found: Found) -> dict[str, object]:
    ended = found.ended
    return {
        "output": found.row.output.name,
        "place": found.row.place,
        "becomes": found.becomes,
        "code": None if ended is None else ended.code,
        "printed": None if ended is None else ended.printed,
        "skipped": found.skipped,
        "departures": found.departures,
    }


def _show(found: Iterable[Found]) -> None:
    table = Table(title="Every output at every place", title_justify="left")
    for name in ("output", "place", "what becomes of it", "exit", "s", "says", "departures"):
        table.add_column(name, overflow="fold")
    wrong = tried = 0
    for each in found:
        wrong, tried = wrong + bool(each.departures), tried + (each.ended is not None)
        ended = each.ended
        says = ended.printed.strip().splitlines() if ended is not None else []
        refused = each.becomes.startswith("refused")
        cells = (
            each.row.output.name,
            each.row.place,
            each.becomes or "not tried",
            "" if ended is None else str(ended.code),
            "" if ended is None else f"{ended.seconds:.1f}",
            each.skipped or (says[0] if refused and says else ""),
            "\n".join(each.departures),
        )
        table.add_row(*map(Text, cells))
    Console(width=None if sys.stdout.isatty() else 240).print(table)
    print(f"{tried} rows tried, {wrong} not as they must be")


if __name__ == "__main__":
    sys.exit(main())
