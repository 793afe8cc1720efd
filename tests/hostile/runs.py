"""Runs a small scenario with a hostile FMU in the command line, and looks at what is left.

Three components of x' = u - decay x: `h`, which misbehaves, and `s` in a loop with it, and `d`
alone, whose x is denormal.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import psutil
from hostile.expected import RUN_CALLS, Row, at
from hostile.hostile_fmu import counts_in, hostile_fmu

import cosim
from cosim.scenario import ScenarioPart
from cosim.trace import Trace, recover, verify

STEP_S, STEPS = 0.05, 40
DECAY = {"h": 0.7, "s": 0.3, "d": 0.4}
X0 = {"h": 1.0 / 3.0, "s": 0.1, "d": 3e-310}
CALL_LIMIT_S, MEMORY_LIMIT = 2.0, "600 MB"
PATIENCE_S = 30.0
"""After that a command that has not ended is ended, and its row has no exit code."""

_SCENARIO = """title = "A hostile FMU"
[run]
end = {end}
step = {step}
[components.h]
fmu = "h.fmu"
isolate = {isolate}
parameters = {{ decay = {decay[h]!r}, x0 = {x0[h]!r} }}
[components.s]
fmu = "s.fmu"
parameters = {{ decay = {decay[s]!r}, x0 = {x0[s]!r} }}
[components.d]
fmu = "s.fmu"
parameters = {{ decay = {decay[d]!r}, x0 = {x0[d]!r} }}
[[connections]]
from = "h.x"
to = "s.u"
[[connections]]
from = "s.x"
to = "h.u"
"""
_LIMITS = f"""[limits]
call = "{CALL_LIMIT_S:g} s"
start = "{CALL_LIMIT_S:g} s"
end = "{CALL_LIMIT_S:g} s"
memory = "{MEMORY_LIMIT}"
"""
_SAME_PROJECT = {
    "PYTHONPATH": os.pathsep.join(str(Path(f).parents[1]) for f in (cosim.__file__, __file__))
}
"""The commands are those of the project which is imported here, and of its tests."""
Door = Literal["run"] | int
"""The verb, or a session that goes by this number of points at a time; 0: to its end at once."""


class Interrupt(NamedTuple):
    """A signal to the command: to its process alone, or to the group, as a terminal sends it."""

    number: signal.Signals
    group: bool


@dataclass(frozen=True)
class Found:
    """What a command left.

    Attributes
    ----------
    code : exit code, negative for a signal; None if it had to be ended.
    seconds : until it ended, or until it was given up.
    printed : both streams.
    seen : the line of it that tells what happened.
    rows_kept : rows in the trace; None where there is no trace.
    rows_run : rows that were complete, as the FMU counted its steps.
    finished : whether the trace is finished.
    status : of the outcome in the trace.
    wrong_rows : what is wrong with the rows that were kept, and with the trace, as `verify` has it.
    files_left : in the temporary folder, and in the folder of the run beside the trace.
    processes_left : command lines.
    """

    fault: str
    call: str
    version: str
    code: int | None
    seconds: float
    printed: str
    seen: str
    rows_kept: int | None
    rows_run: int
    finished: bool
    status: str | None
    wrong_rows: tuple[str, ...]
    files_left: tuple[str, ...]
    processes_left: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values."""
        return asdict(self)


def run_row(
    row: Row,
    folder: Path,
    *options: str,
    interrupt: Interrupt | None = None,
    limits: bool = True,
    isolate: bool = False,
    door: Door = "run",
) -> Found:
    """Run the scenario with the fault of a row in its own process, and look at what is left.

    Parameters
    ----------
    folder : an empty one.
    options : of the command.
    interrupt : sent when the fault has begun.
    limits : whether the scenario limits the time of calls and the memory.
    isolate : whether the hostile component is in a process of its own.
    door : through which it is run.
    """
    home = folder / "run"
    home.mkdir()
    counts = folder / "counts"
    _write_scenario(row, home, counts, limits=limits, isolate=isolate)
    line = [*line_of(door), *options]
    if row.call not in RUN_CALLS:
        line = [sys.executable, "-m", "cosim", "fmu", "check", "h.fmu", "--run"]
        line += ["--time", f"{CALL_LIMIT_S:g}"]
    done = run_command(line, folder, counts=counts, interrupt=interrupt)
    kept, finished, status, wrong = _look_at(home / "t.mcap", row, folder)
    run = counts_in(counts)
    return Found(
        **asdict(row),
        **done,
        rows_kept=kept,
        rows_run=run.begun if run.done < STEPS else STEPS + 1,
        finished=finished,
        status=status,
        wrong_rows=wrong,
    )


def line_of(door: Door) -> list[str]:
    """Return the command that runs s.toml through a door into t.mcap."""
    if door == "run":
        return [sys.executable, "-m", "cosim", "run", "s.toml", "--out", "t.mcap"]
    return [sys.executable, "-m", "hostile.session", "s.toml", "t.mcap", str(door)]


def run_command(
    line: list[str],
    folder: Path,
    *,
    counts: Path | None = None,
    interrupt: Interrupt | None = None,
) -> dict[str, Any]:
    """Run a command in `folder`/run; return the fields of `Found` that are not of its trace.

    `counts` : of the FMU that misbehaves, for the interrupt.
    """
    home, scratch, out = folder / "run", folder / "tmp", folder / "printed"
    scratch.mkdir()
    before = set(home.iterdir())
    began = time.monotonic()
    with out.open("w") as stream:
        process = subprocess.Popen(  # noqa: S603 - ourselves
            line,
            cwd=home,
            env={**os.environ, **_SAME_PROJECT, "TMPDIR": str(scratch), "COLUMNS": "200"},
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            if interrupt is not None and counts is not None:
                _interrupt(process, counts, interrupt)
            code: int | None = process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            code = None
        finally:  # also where the table itself is interrupted
            seconds = time.monotonic() - began
            left = tuple(_end_all(scratch, process.pid))
            process.wait()
    printed = out.read_text("utf-8", "replace")
    files = [path.relative_to(folder) for path in scratch.iterdir()]
    files += [p.relative_to(folder) for p in set(home.iterdir()) - before - {home / "t.mcap"}]
    return {
        "code": code,
        "seconds": round(seconds, 2),
        "printed": printed,
        "seen": _seen(printed),
        "files_left": tuple(sorted(map(str, files))),
        "processes_left": left,
    }


def _write_scenario(row: Row, home: Path, counts: Path, *, limits: bool, isolate: bool) -> None:
    other = "3.0" if row.version == "2.0" else "2.0"
    hostile_fmu(home, row.version, "h", fault=row.fault, call=row.call, at=at(row), counts=counts)
    hostile_fmu(home, other, "s")
    given = {"end": STEP_S * STEPS, "step": STEP_S, "decay": DECAY, "x0": X0}
    text = _SCENARIO.format(isolate=str(isolate).lower(), **given)
    may_limit = limits and "limits" in ScenarioPart.model_fields
    (home / "s.toml").write_text(text + (_LIMITS if may_limit else ""))


def _interrupt(process: subprocess.Popen[Any], counts: Path, interrupt: Interrupt) -> None:
    """Send the signal once the fault has begun."""
    end = time.monotonic() + PATIENCE_S
    while counts_in(counts).faults == 0 and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(0.2)
    if process.poll() is None:
        send = os.killpg if interrupt.group else os.kill
        send(process.pid, interrupt.number)


def _end_all(scratch: Path, leader: int) -> Iterator[str]:
    """End every process that the command has left, and give their command lines."""
    mark = str(scratch)
    for process in psutil.process_iter():
        try:
            if process.environ().get("TMPDIR") != mark:
                continue
            if process.status() == psutil.STATUS_ZOMBIE:
                continue
            line = " ".join(process.cmdline())
            process.kill()
            if process.pid != leader:
                yield line
        except psutil.Error:
            continue


def _look_at(
    path: Path, row: Row, folder: Path
) -> tuple[int | None, bool, str | None, tuple[str, ...]]:
    """Rows kept, whether the trace is finished, its status, and what is wrong with the rows."""
    partial = path.with_name(f"{path.name}.partial")
    if partial.exists():
        shutil.copyfile(partial, folder / partial.name)
    elif not path.exists():
        return None, False, None, ()
    try:
        trace = Trace(path if path.exists() else recover(folder / partial.name).output)
        unsound = tuple(
            f"verify: {check.name}: {check.detail}"
            for check in verify(trace.path).checks
            if check.verdict == "failed"
        )
        if "/h/output" not in trace.topics:  # it failed before its first row
            return 0, trace.finished, (trace.result or {}).get("status"), unsound
        columns = {
            (name, variable): trace.read(f"/{name}/{direction}")[variable].tolist()
            for name in DECAY
            for direction, variable in (("output", "x"), ("input", "u"))
            if (name, variable) != ("d", "u")
        }
    except Exception as error:  # noqa: BLE001 - whatever is wrong with the file is the answer
        return 0, False, None, (f"{type(error).__name__}: {error}",)
    kept = len(columns["h", "x"])
    result = trace.result or {}
    wrong = (*_wrong(columns, row), *unsound)
    return kept, path.exists() and trace.finished, result.get("status"), wrong


def _wrong(columns: dict[tuple[str, str], list[float]], row: Row) -> Iterator[str]:
    """Compare every row with its equations, bit for bit."""
    kept = len(columns["h", "x"])
    for (name, variable), values in columns.items():
        if len(values) != kept:
            yield f"{name}.{variable} has {len(values)} rows, h.x {kept}"
    first = round(at(row) / STEP_S)
    for name, other in (("h", "s"), ("s", "h"), ("d", None)):
        x = columns[name, "x"]
        u = columns[name, "u"] if other else [0.0] * len(x)
        if other and not _equal(u, columns[other, "x"][: len(u)]):
            yield f"{name}.u is not {other}.x"
        # the fault may change numbers of its own component from its time on
        last = first - (row.call == "get") if name == "h" else len(x)
        until = min(last, len(x) - 1, len(u))
        expected = X0[name]
        for k in range(until + 1 if x else 0):
            if not _equal([x[k]], [expected]):
                yield f"{name}.x is {x[k]!r} in row {k}, expected {expected!r}"
                break
            if k < len(u):
                expected = x[k] + STEP_S * (u[k] - DECAY[name] * x[k])


def _equal(a: list[float], b: list[float]) -> bool:
    """Whether numbers are the same, NaN the same as NaN."""
    return np.array_equal(a, b, equal_nan=True)


def _seen(printed: str) -> str:
    """The line that tells what happened: the error, or how the run ended."""
    lines = [line.strip() for line in printed.splitlines() if line.strip(" ~")]
    if "Traceback (most recent call last):" in printed:
        return "Traceback"
    for words in (r"'h'|h\.x", "interrupted", "(finished|stopped|diverged|failed) after"):
        for line in lines:
            if re.search(words, line):
                return line
    return lines[-1] if lines else ""
