"""What a user sees of every fault of a hostile FMU, in every call of FMI.

    python -m tests.hostile.table [--json] [--fault NAME ...] [--call NAME ...] [--version 2.0]

For each row a small scenario runs in the command line, in a process of its own: what it prints,
its exit code, the seconds until then, the rows in its trace of those that were complete, and the
files and processes that it leaves. The last column names what is not as `hostile.expected` has it.
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

if __package__ == "tests.hostile":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from hostile.expected import VERSIONS, rows
from hostile.hostile_fmu import CALLS, FAULTS
from hostile.judged import departures
from hostile.runs import Found, run_row


def main() -> int:
    """Print the table; 0 if every row is as expected."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile.table")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--fault", nargs="*", choices=FAULTS[1:], default=FAULTS[1:])
    parser.add_argument("--call", nargs="*", choices=CALLS, default=CALLS)
    parser.add_argument("--version", nargs="*", choices=VERSIONS, default=VERSIONS)
    asked = parser.parse_args()
    chosen = [
        row
        for row in rows()
        if row.fault in asked.fault and row.call in asked.call and row.version in asked.version
    ]
    found = []
    for i, row in enumerate(chosen, 1):
        print(f"\r{i}/{len(chosen)} {row.name:40}", end="", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
            found.append(run_row(row, Path(folder)))
    print(file=sys.stderr)
    if asked.json:
        report = [each.to_json() | {"departures": departures(each)} for each in found]
        print(json.dumps(report, indent=1))
    else:
        _show(found)
    return int(any(map(departures, found)))


def _show(found: list[Found]) -> None:
    table = Table(title="Every fault in every call", title_justify="left")
    for name in ("fault", "call", "FMI", "what the user sees", "exit", "s"):
        table.add_column(name, overflow="fold")
    for name in ("rows kept / complete", "left behind", "not as expected"):
        table.add_column(name, overflow="fold")
    for each in found:
        kept = "no trace" if each.rows_kept is None else str(each.rows_kept)
        cells = (
            each.fault,
            each.call,
            each.version,
            each.seen,
            "none" if each.code is None else str(each.code),
            f"{each.seconds:.1f}",
            f"{kept} / {each.rows_run}",
            "\n".join((*each.files_left, *each.processes_left)) or "nothing",
            "\n".join(departures(each)),
        )
        table.add_row(*map(Text, cells))
    Console(width=None if sys.stdout.isatty() else 240).print(table)
    wrong = sum(bool(departures(each)) for each in found)
    Console().print(f"{len(found)} rows, {wrong} not as expected")


if __name__ == "__main__":
    sys.exit(main())
