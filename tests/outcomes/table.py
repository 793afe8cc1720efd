"""What every view says of a run, for every way in which a run can end.

    python -m tests.outcomes.table [--json] [--only NAME ...]

One row each: the exit code of `cosim run`, its summary, the badge of the report, the state of
`trace info`, and the lines of `/log`. A last column names what is not as `ways.WAYS` has it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

if __package__ == "tests.outcomes":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import shared
from outcomes.ways import WAYS, Found, departures, seen

MOST_LINES = 8


def main() -> int:
    """Print the table; 0 if every row is the same story."""
    parser = argparse.ArgumentParser(prog="python -m tests.outcomes.table")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only", nargs="*", choices=WAYS, default=list(WAYS))
    asked = parser.parse_args()
    rows: dict[str, Found] = {}
    with tempfile.TemporaryDirectory() as folder:
        shared.share_below(Path(folder, "shared"))
        for name in asked.only:
            own = Path(folder, name)
            own.mkdir()
            rows[name] = seen(name, own)
    wrong = {name: departures(name, found) for name, found in rows.items()}
    if asked.json:
        found = {n: {**r.to_json(), "departures": wrong[n]} for n, r in rows.items()}
        sys.stdout.write(json.dumps(found, indent=2) + "\n")
    else:
        Console(width=200).print(table(rows, wrong))
    return int(any(wrong.values()))


def table(rows: dict[str, Found], wrong: dict[str, list[str]]) -> Table:
    """Make the table."""
    view = Table(show_lines=True)
    widths = {"run": 16, "exit": 4, "summary": 22, "report": 22, "info": 22, "/log": None}
    for column, width in widths.items():
        view.add_column(column, overflow="fold", width=width)
    if any(wrong.values()):
        view.add_column("departures", overflow="fold", width=40)
    for name, found in rows.items():
        row = found.to_json()
        lines = [line.partition("\n")[0] for line in row["log"]]
        more = f"... {len(lines) - MOST_LINES} more"
        shortened = [*lines[: MOST_LINES - 2], more, *lines[-2:]]
        printed = lines if len(lines) <= MOST_LINES else shortened
        cells = [name, str(found.code), row["summary"] or "–", row["report"], row["info"]]
        cells += ["\n".join(printed), *(["\n".join(wrong[name])] if any(wrong.values()) else [])]
        view.add_row(*map(Text, cells))
    return view


if __name__ == "__main__":
    sys.exit(main())
