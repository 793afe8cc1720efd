"""What becomes of a study in which some runs misbehave, by fault and number of workers.

    python -m tests.hostile.studies [--json] [--fault NAME ...] [--workers 1 2 4]

Forty runs of a small FMU, five of which misbehave, in the command line and a process of its own:
its exit code, the seconds until then, how many runs ended how, whether every other run has the
value of the closed form, and what is left in the temporary folder and among the processes. The
last column names what is not as expected, also of the tables by numbers of workers, which are one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import psutil
from rich.console import Console
from rich.table import Table

if __package__ == "tests.hostile":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from hostile.hostile_fmu import misbehaviour
from shared import share_below
from study.deadly import DEADLY, SCENARIO, U, folder, truth

from cosim.study import read_table

RUNS, MISBEHAVING = 40, range(3, 40, 8)
EXPECTED = {
    "segfault": "crashed",
    "abort": "crashed",
    "kill": "crashed",
    "exit-0": "crashed",
    "stack-overflow": "crashed",
    "double-free": "crashed",
    "hang": "timed_out",
    "hang-deaf": "timed_out",
    "leak": "failed",
    "error": "failed",
    "fatal": "failed",
    "not-a-number": "failed",
    "flood-stderr": "finished",
    "change-folder": "finished",
    "delete-folder": "finished",
    "surroundings": "finished",
    "signals": "finished",
    "close-output": "finished",
}
"""How a run ends that has the fault; the others fail where it leaves something to them."""
WORKERS = (1, 2, 4)
LIMITS = ("run=3", "memory=400 MB")
PATIENCE_S = 300.0


class Found(NamedTuple):
    """What was found of one study."""

    fault: str
    workers: int
    exit_code: int | None
    seconds: float
    statuses: dict[str, int]
    wrong: list[str]
    table: dict[str, list[Any]]


def run_study_with(fault: str, workers: int) -> Found:
    """Run the study, and look at everything that it leaves."""
    values = [DEADLY + i if i in MISBEHAVING else 0.1 * i for i in range(RUNS)]
    given = {"u": 0.0, "decay": 1.0, "x0": 1.0, **misbehaviour(fault, beyond=600.0, megabytes=2e3)}
    scenario = SCENARIO + "".join(f"{name} = {value}\n" for name, value in given.items())
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "tiny.fmu").symlink_to(folder() / "tiny.fmu")
        (place / "tiny.toml").write_text(scenario)
        (place / "s.toml").write_text(
            f'title = "x follows u"\nscenario = "tiny.toml"\n[[vary]]\nkind = "grid"\nname = "u"\n'
            f'path = {U!r}\nvalues = {values}\n[metrics]\nx = "final.tiny.x"\n'
        )
        (place / "tmp").mkdir()
        line = [sys.executable, "-m", "cosim", "study", "run", "s.toml", "--out", "out"]
        line += [f"--workers={workers}", *(f"--limit={limit}" for limit in LIMITS), "--json"]
        began = time.monotonic()
        process = subprocess.Popen(  # noqa: S603 - ourselves
            line,
            cwd=place,
            env={**os.environ, "TMPDIR": str(place / "tmp"), "MARK": name},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            out, err = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
        seconds = time.monotonic() - began
        exit_code = None if seconds > PATIENCE_S else process.returncode
        wrong = [] if exit_code == 0 else [f"exit code {exit_code}: {err[-300:]}"]
        statuses, table = {}, {}
        if exit_code == 0:
            statuses = json.loads(out)["statuses"]
            table = read_table(place / "out")[0].to_pydict()
            wrong += judged(fault, table, values)
        left = [path.name for path in (place / "tmp").iterdir()]
        wrong += [f"left in the temporary folder: {left}"] if left else []
        wrong += [f"left running: {process.pid}" for process in _marked(name)]
    return Found(fault, workers, exit_code, seconds, statuses, wrong, table)


def differences(found: list[Found]) -> list[str]:
    """Which columns of the tables of one study depend on the number of workers."""
    first, *others = found
    return [
        f"{column} with {one.workers} workers is not as with {first.workers}"
        for one in others
        for column in ("run", "status", "reason", "x")
        if one.table.get(column) != first.table.get(column)
    ]


def judged(fault: str, table: dict[str, list[Any]], values: list[float]) -> list[str]:
    """What is not as expected in the table of a study."""
    wrong = []
    if table["run"] != list(range(RUNS)):
        wrong.append("not every run is accounted for")
    for i, (status, reason, x) in enumerate(
        zip(table["status"], table["reason"], table["x"], strict=True)
    ):
        expected = EXPECTED[fault] if i in MISBEHAVING else "finished"
        if status != expected:
            wrong.append(f"run {i} is {status}, not {expected}: {reason}")
        elif expected == "finished" and abs(x - truth(values[i])) > 1e-9:
            wrong.append(f"run {i}: x = {x}, not {truth(values[i])}")
        elif expected != "finished" and "tiny" not in str(reason):
            wrong.append(f"run {i}: the component is not named: {reason}")
    return wrong


def _marked(mark: str) -> list[psutil.Process]:
    """The processes of this study that are still there."""
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get("MARK") == mark and process.status() != "zombie":
                found.append(process)
        except psutil.Error:
            continue
    return found


def main() -> int:
    """Print the table; 0 if every row is as expected."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile.studies")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--fault", nargs="*", choices=EXPECTED, default=list(EXPECTED))
    parser.add_argument("--workers", nargs="*", type=int, default=WORKERS)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as shared:
        share_below(Path(shared))
        found = []
        for fault in asked.fault:
            found += (of_one := [run_study_with(fault, n) for n in asked.workers])
            of_one[-1].wrong.extend(differences(of_one))
    if asked.json:
        print(json.dumps([one._asdict() for one in found]))
    else:
        table = Table("fault", "workers", "exit", "seconds", "runs", "not as expected")
        for one in found:
            ended = ", ".join(f"{count} {status}" for status, count in sorted(one.statuses.items()))
            cells = one.fault, str(one.workers), str(one.exit_code), f"{one.seconds:.1f}", ended
            table.add_row(*cells, "\n".join(one.wrong))
        Console().print(table)
    return 1 if any(one.wrong for one in found) else 0


if __name__ == "__main__":
    raise SystemExit(main())
