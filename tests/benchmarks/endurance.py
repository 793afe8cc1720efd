"""Thousands of runs in one process: what grows, and a run of two million points: what it takes.

The runs: two tiny FMUs, and the vehicle of `auv-acoustic` with its controller, sea and links,
native, shortened; each with both engines, with and without a trace. Watched: resident memory,
open files, threads, mapped libraries, and folders among the temporary files.

`python -m tests.benchmarks.endurance --json` prints {"runs": {KIND: {"runs", "ms_per_run",
"kib_per_run", "files", "threads", "maps", "folders"}}, "long": {ENGINE: {"points", "mib_of_rows",
"mib_grown", "us_per_step"}}}: growth over all runs but the first hundred, memory by a straight
line through the samples; of the long run the microseconds per step tenth by tenth.
`--runs N` in place of 1000 runs of each kind.
"""

from __future__ import annotations

import gc
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from rich.table import Table

from cosim.master import EngineName, Session, System, TraceRecorder, simulate
from cosim.trace import TraceWriter
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu
from tests.benchmarks.acoustic import the_system
from tests.benchmarks.loop import system_of

ENGINES: tuple[EngineName, ...] = ("kernel", "python")
SETTLING = 100
_MIB = 1 << 20


class State(NamedTuple):
    """What a process holds."""

    rss: int
    files: int
    threads: int
    maps: int
    folders: int


def state() -> State:
    """Of this process, now."""
    process = psutil.Process()
    return State(
        process.memory_info().rss,
        process.num_fds() if hasattr(process, "num_fds") else len(process.open_files()),
        process.num_threads(),
        len(process.memory_maps()),
        sum(1 for _ in Path(tempfile.gettempdir()).iterdir()),
    )


def one_run(system: System, engine: EngineName, trace: Path | None) -> None:
    """A run from beginning to end."""
    if trace is None:
        run = simulate(system, engine=engine)
    else:
        with TraceWriter(trace, run={}) as writer:
            run = simulate(system, [TraceRecorder(writer, system)], engine=engine)
            writer.finish({})
    if run.status != "finished":
        raise SystemExit(f"the run {run.status}: {run.reason}")


def kinds(folder: Path) -> dict[str, Callable[[], None]]:
    """Every kind of run."""
    tiny = system_of(tiny_fmu(6, folder), 6, steps=200, links=True)
    systems = {"tiny": tiny, "auv-acoustic": the_system(folder, end=2.0)}
    return {
        f"{name}, {engine}{', traced' if traced else ''}": partial(
            one_run, system, engine, folder / "run.mcap" if traced else None
        )
        for name, system in systems.items()
        for engine in ENGINES
        for traced in (False, True)
    }


def repeated(run: Callable[[], None], runs: int) -> dict[str, Any]:
    """Run so often; how much of everything there is more at the end."""
    for _ in range(SETTLING):
        run()
    gc.collect()
    before, began = state(), time.perf_counter()
    memory = []
    for number in range(runs - SETTLING):
        run()
        if number % max(1, runs // 100) == 0:
            gc.collect()  # types that are made at run time, as for a trace, wait for it
            memory.append((number, psutil.Process().memory_info().rss))
    spent = time.perf_counter() - began
    gc.collect()
    after = state()
    slope = np.polyfit(*np.array(memory, float).T, 1)[0]
    return {
        "runs": runs,
        "ms_per_run": 1e3 * spent / (runs - SETTLING),
        "kib_per_run": float(slope) / 1024,
        **{name: getattr(after, name) - getattr(before, name) for name in State._fields[1:]},
    }


def long_run(system: System, engine: EngineName) -> dict[str, Any]:
    """One long run, tenth by tenth."""
    points = system.comm_schedule.points_ns.size
    gc.collect()
    before = psutil.Process().memory_info().rss
    with Session(system, engine=engine) as session:
        session.step(1_000)
        tenths = []
        while not session.ended:
            began, first = time.process_time(), session.rows
            session.step(points // 10)
            tenths.append(1e6 * (time.process_time() - began) / (session.rows - first))
        grown = psutil.Process().memory_info().rss - before
        run = session.result()
    return {
        "points": points,
        "mib_of_rows": run.instances[0].rows.nbytes / _MIB,
        "mib_grown": grown / _MIB,
        "us_per_step": tenths,
    }


def main() -> None:
    """Measure, print."""
    runs = int(sys.argv[sys.argv.index("--runs") + 1]) if "--runs" in sys.argv else 1_000
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        tempfile.tempdir = str(stack.enter_context(tempfile.TemporaryDirectory()))
        found = {name: repeated(run, runs) for name, run in kinds(folder).items()}
        fmu = tiny_fmu(6, folder)
        long = {
            engine: long_run(system_of(fmu, 6, steps=2_000_000, links=True), engine)
            for engine in ENGINES
        }
    view = Table(title=f"{runs} runs in one process: what grows", title_justify="left")
    for column in ("", "ms per run", "KiB per run", "files", "threads", "maps", "folders"):
        view.add_column(column, justify="right" if column else "left")
    for name, row in found.items():
        view.add_row(
            name,
            f"{row['ms_per_run']:.1f}",
            f"{row['kib_per_run']:.2f}",
            *(str(row[column]) for column in State._fields[1:]),
        )
    remarks = [
        f"{row['points']} points, engine {engine}: {row['mib_of_rows']:.0f} MiB of rows, memory "
        f"grows by {row['mib_grown']:.0f} MiB, us per step in tenths "
        + " ".join(f"{x:.3f}" for x in row["us_per_step"])
        for engine, row in long.items()
    ]
    show(view, {"runs": found, "long": long}, *remarks)


if __name__ == "__main__":
    main()
