"""What a user sees of every fault of a hostile FMU, in every call of FMI.

    python -m tests.hostile.table [--json] [--fault NAME ...] [--call NAME ...] [--version 2.0]
                                  [--door run session isolated]

For each row a small scenario runs through each door (the command line; a session; the command
line, the component isolated), in a process of its own: what it prints, its exit code, the seconds
until then, the rows in its trace of those that were complete, and the files and processes that it
leaves. The last column names what is not as `hostile.expected` and `hostile.eventful` have it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

if __package__ == "tests.hostile":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from hostile import eventful
from hostile.expected import RUN_CALLS, VERSIONS, Row, rows
from hostile.hostile_fmu import CALLS, FAULTS
from hostile.judged import departures
from hostile.runs import Found, run_row

_EVERY = (*rows(), *eventful.rows())
_FAULTS = (*FAULTS[1:], *dict.fromkeys(r.fault for r in eventful.rows() if r.fault not in FAULTS))
_CALLS = (*CALLS, *(call for call in eventful.CALLS if call not in CALLS))
_VERSIONS = (*VERSIONS, "3.0 events", "3.0 C++")
_DOORS: dict[str, dict[str, Any]] = {
    "run": {"door": "run"},
    "session": {"door": 0},
    "isolated": {"door": "run", "isolate": True},
}


def main() -> int:
    """Print the table; 0 if every row is as expected."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile.table")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--fault", nargs="*", choices=_FAULTS, default=_FAULTS)
    parser.add_argument("--call", nargs="*", choices=_CALLS, default=_CALLS)
    parser.add_argument("--version", nargs="*", choices=_VERSIONS, default=_VERSIONS)
    parser.add_argument("--door", nargs="*", choices=_DOORS, default=("run", "session"))
    asked = parser.parse_args()
    chosen = [
        (row, door)
        for row in _EVERY
        for door in asked.door
        if row.fault in asked.fault and row.call in asked.call and row.version in asked.version
        if row.call in RUN_CALLS or not isinstance(row, Row) or door == "run"
        if door != "isolated" or row.fault != "intrude"  # which does no harm there
    ]
    found = []
    for i, (row, door) in enumerate(chosen, 1):
        print(f"\r{i}/{len(chosen)} {row.name:40}", end="", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
            run = run_row if isinstance(row, Row) else eventful.run_row
            found.append((door, run(row, Path(folder), **_DOORS[door])))
    print(file=sys.stderr)
    if asked.json:
        report = [
            {"door": door, **each.to_json(), "departures": _departures(each)}
            for door, each in found
        ]
        print(json.dumps(report, indent=1))
    else:
        _show(found)
    return int(any(_departures(each) for _, each in found))


def _departures(found: Found) -> list[str]:
    judge = departures if found.version in VERSIONS else eventful.departures
    return judge(found)


def _show(found: list[tuple[str, Found]]) -> None:
    table = Table(title="Every fault in every call", title_justify="left")
    for name in ("fault", "call", "FMI", "door", "what the user sees", "exit", "s"):
        table.add_column(name, overflow="fold")
    for name in ("rows kept / complete", "left behind", "not as expected"):
        table.add_column(name, overflow="fold")
    for door, each in found:
        kept = "no trace" if each.rows_kept is None else str(each.rows_kept)
        cells = (
            each.fault,
            each.call,
            each.version,
            door,
            each.seen,
            "none" if each.code is None else str(each.code),
            f"{each.seconds:.1f}",
            f"{kept} / {each.rows_run}",
            "\n".join((*each.files_left, *each.processes_left)) or "nothing",
            "\n".join(_departures(each)),
        )
        table.add_row(*map(Text, cells))
    Console(width=None if sys.stdout.isatty() else 240).print(table)
    wrong = sum(bool(_departures(each)) for _, each in found)
    Console().print(f"{len(found)} rows, {wrong} not as expected")


if __name__ == "__main__":
    sys.exit(main())
