"""Ten thousand short scenarios on two processes: throughput, memory over time, efficiency.

Each run is section 5's loop over a link of random delay, 1 s in 100 steps, native FMUs, no trace.

* throughput: runs per second of wall time, from the first to the last, two processes;
* memory: resident set of the two worker processes over the runs done, and its growth;
* efficiency: rounds of the same number of runs, in this process and on the two processes, one
  after the other; `wall`: speed-up by two, halved, which tells little while others compute on
  the machine; `cpu`: CPU seconds of a run here over those of a run there, everything counted
  (workers, scheduler, this process), which bounds it from above on an idle machine.

`python -m tests.benchmarks.study [--runs 10000] [--json]`
"""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console
from rich.table import Table

from cosim.study import Plan, Study, execute_study, load_study, plan_of, pool_for
from tests.benchmarks._cpu import cpu_s

WORKERS = 2
ROUNDS = 3
SAMPLES_OF_MEMORY = 20
MIB = 2**20


def plan_for(runs: int, seed: int, fmus: Path) -> Plan:
    """So many runs; another seed is another study."""
    base = load_study("delay-margin").base
    study = Study(
        title="short",
        scenario=base.name,
        set={"run.end": 1.0, "run.step": 0.01},
        vary=[{"kind": "random", "name": "d", "path": "links.uplink.delay", "uniform": [0.0, 0.3]}],
        samples=runs,
        seed=seed,
        metrics={
            "x": "final.plant.x[1]",
            "rms": {"signal": ["plant.x[1]", "plant.x[2]"], "reduce": "rms"},
        },
    )
    return plan_of(study, base, fmus=fmus)


def processes(pool: Any) -> list[psutil.Process]:
    """The worker processes."""
    return [psutil.Process(worker.number) for worker in pool.workers]


def memory_over_runs(plan: Plan, pool: Any, folder: Path) -> dict[str, Any]:
    """Fly a study and look at the workers' memory as it goes."""
    seen: list[tuple[int, float]] = []

    def look(_what: str, share: float) -> None:
        if share * SAMPLES_OF_MEMORY >= len(seen):
            size = max((p.memory_info().rss for p in processes(pool)), default=0) / MIB
            seen.append((round(share * plan.count), round(size, 1)))

    began = time.perf_counter()
    execute_study(plan, folder, lambda: contextlib.nullcontext(pool), progress=look)
    spent = time.perf_counter() - began
    half = [size for _, size in seen[len(seen) // 2 :]]
    done = seen[-1][0] - seen[len(seen) // 2][0]
    return {
        "runs": plan.count,
        "seconds": round(spent, 2),
        "runs_per_second": round(plan.count / spent, 2),
        "memory_mib": seen,
        "growth_mib_per_1000_runs": round(1000 * (half[-1] - half[0]) / max(done, 1), 3),
    }


def efficiency(runs: int, pool: Any, fmus: Path, folder: Path) -> dict[str, float]:
    """Two processes against one, in turns."""
    pools: dict[str, Any] = {
        "one": pool_for(1),
        "two": lambda: contextlib.nullcontext(pool),
    }
    wall: dict[str, list[float]] = {"one": [], "two": []}
    used: dict[str, list[float]] = {"one": [], "two": []}
    for turn in range(ROUNDS):
        plan = plan_for(runs, 100 + turn, fmus)
        # the same design for all, made before the clock starts
        plan.runner.problem_and_design(0)
        for name, who in pools.items():
            out = folder / f"{name}-{turn}"
            began, before = time.perf_counter(), cpu_s()
            execute_study(plan, out, who)
            wall[name].append(time.perf_counter() - began)
            used[name].append(cpu_s() - before)
    middle = {name: statistics.median(times) for name, times in wall.items()}
    run_batches = {name: statistics.median(times) for name, times in used.items()}
    return {
        "wall": round(middle["one"] / middle["two"] / WORKERS, 3),
        "cpu": round(run_batches["one"] / run_batches["two"], 3),
        "ms_per_run_here": round(1e3 * run_batches["one"] / runs, 2),
    }


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """A folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def main() -> None:
    """Measure, print."""
    runs = int(sys.argv[sys.argv.index("--runs") + 1]) if "--runs" in sys.argv else 10_000
    with scratch() as folder, pool_for(WORKERS)() as pool:
        fmus = folder / "fmus"
        found = {
            "workers": WORKERS,
            "cores": os.cpu_count(),
            "load_before": round(os.getloadavg()[0], 2),
            "efficiency": efficiency(max(runs // 5, 20), pool, fmus, folder),
            "study": memory_over_runs(plan_for(runs, 1, fmus), pool, folder / "long"),
        }
    if "--json" in sys.argv:
        print(json.dumps(found, indent=1))
        return
    view = Table(title="a study of short scenarios", title_justify="left", show_header=False)
    for part in ("efficiency", "study"):
        for key, value in found[part].items():
            if key != "memory_mib":
                view.add_row(f"{part}: {key}", str(value))
    for done, size in found["study"]["memory_mib"]:
        view.add_row(f"largest worker after {done} runs", f"{size} MiB")
    Console().print(view)


if __name__ == "__main__":
    main()
