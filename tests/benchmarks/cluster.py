"""A study on a thousand workers: what scheduler and starter spend on a batch, and their messages.

    python -m tests.benchmarks.cluster [--workers 1000] [--seconds 2] [--rows 20] [--rounds 3]

Simulated are the runs and the machines: the workers are Dask's own (`distributed.Worker`, no
nannies) in one process that sleeps in place of every batch and returns rows of the usual size; they
register as real ones do. Left out are their heartbeats (a thousand workers send 170 a second: their
cost to the scheduler is measured by itself) and the shipping of files, which happens once per host.
Real are the scheduler, in a process of its own, the starter's pool and its run log. CPU times do
hardly depend on who else computes; wall times do.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import dask
import distributed
import psutil
import pytest
from distributed.comm.tcp import TCP
from rich.console import Console
from rich.table import Table

from cosim.study import Plan, Study, execute_study, load_study, plan_of, pool_for

SETTINGS = {
    # what each worker does for itself, a thousand times in one process
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.interval": "1h",
    "distributed.admin.tick.interval": "1h",
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": "120s",
}
TOGETHER = 50
"""Workers that start at a time."""


class Row(NamedTuple):
    """The result of a simulated run."""

    run: int
    status: str
    reason: str | None
    seconds: float
    values: tuple[float, ...]


async def simulated(seconds: float, _ticket: object, runs: list[int]) -> Any:
    """In place of what a worker does with a batch: no run is flown."""
    await asyncio.sleep(seconds)
    return [Row(run, "finished", None, seconds / len(runs), (0.1 * run, 0.7)) for run in runs], {}


def counted_bytes() -> list[int]:
    """Count what this process writes to connections, from now on: bytes, messages."""
    total, write = [0, 0], TCP.write

    async def counting(self: Any, *arguments: Any, **options: Any) -> Any:
        size = await write(self, *arguments, **options)
        total[0] += size
        total[1] += 1
        return size

    TCP.write = counting  # type: ignore[method-assign]
    return total


async def schedule() -> None:
    """The process of the scheduler: prints its address, and at each line what it has written."""
    total = counted_bytes()
    async with distributed.Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
        print(scheduler.address, flush=True)
        await _answer(total)


async def _silent(_worker: distributed.Worker) -> None:
    """In place of a heartbeat."""


async def work(address: str, number: int, folder: str) -> None:
    """The process of the simulated workers."""
    total, heartbeat = counted_bytes(), distributed.Worker.heartbeat
    distributed.Worker.heartbeat = _silent  # type: ignore[method-assign]
    many = [
        distributed.Worker(
            address,
            nthreads=1,
            name=i,
            local_directory=folder,
            dashboard=False,
            memory_limit=0,
            silence_logs=logging.CRITICAL,
        )
        for i in range(number)
    ]
    for first in range(0, number, TOGETHER):
        await asyncio.gather(*many[first : first + TOGETHER])
    print("ready", flush=True)
    await _answer(total)
    for worker in many:
        await heartbeat(worker)
    print("heartbeats sent", flush=True)


async def _answer(total: list[int]) -> None:
    """Tell what was written whenever it is asked for, until a line says that this is over."""
    loop = asyncio.get_running_loop()
    while (await loop.run_in_executor(None, sys.stdin.readline)).strip() != "over":
        print(json.dumps(total), flush=True)


class Process:
    """Another process of this benchmark."""

    def __init__(self, *role: str) -> None:
        line = [sys.executable, "-m", "tests.benchmarks.cluster", "--role", *role]
        self._process = subprocess.Popen(  # noqa: S603 - ourselves
            line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.greeting = self._line()
        self._usage = psutil.Process(self._process.pid)

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def written(self) -> list[int]:
        """Bytes and messages that it has written."""
        found: list[int] = json.loads(self.ask(""))
        return found

    def ask(self, line: str) -> str:
        """Send it a line; return its answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        return self._line()

    def cpu(self) -> float:
        """Its CPU seconds."""
        times = self._usage.cpu_times()
        return float(times.user + times.system)

    def memory(self) -> float:
        """Its resident set [MiB]."""
        return float(self._usage.memory_info().rss / 2**20)

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


class Pool:
    """The pool of a cluster, which is given batches of one size, and measured while it has some.

    begin, end : called before the first batch and after the last; `ready` when files are offered.
    """

    size = 1

    def __init__(
        self,
        pool: Any,
        batches: Iterator[list[int]],
        seconds: float,
        moments: tuple[Callable[[], None], Callable[[], None], Callable[[], None]],
    ) -> None:
        self.notice: Callable[[str], None] = lambda _text: None
        self._pool, self._batches, self._seconds = pool, batches, seconds
        self._begin, self._ready, self._end = moments

    def run_batches(self, _function: Any, job: Any, _next_batch: Any) -> Iterator[Any]:
        """Execute the batches on the simulated workers, which sleep in place of the function."""
        self._begin()

        def next_batch() -> list[int] | None:
            self._ready()
            return next(self._batches, None)

        yield from self._pool.run_batches(self._seconds, job, next_batch)
        self._end()


def plan_for(runs: int, fmus: Path) -> Plan:
    """So many runs of the vehicle over its links, of which the first alone is flown."""
    base = load_study("delay-loss").base
    study = Study(
        title="simulated",
        scenario=base.name,
        set={"run.end": 1.0},
        vary=[{"kind": "replicates", "count": runs}],
        metrics={"x": "final.plant.eta.x", "age": "metrics.message_age_s"},
    )
    return plan_of(study, base, fmus=fmus)


def measure(asked: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Execute the batches on the simulated workers."""
    scheduler = Process("scheduler")
    began = time.perf_counter()
    workers = Process("workers", scheduler.greeting, str(asked.workers), str(folder))
    joined = time.perf_counter() - began
    mine, me = counted_bytes(), psutil.Process()
    batches = asked.rounds * asked.workers
    seen: dict[str, Any] = {}

    def look() -> dict[str, Any]:
        return {
            "written": (scheduler.written(), workers.written(), [*mine]),
            "cpu": (scheduler.cpu(), sum(me.cpu_times()[:2])),
            "time": time.perf_counter(),
        }

    moments = (
        lambda: seen.update(begin=look()),
        lambda: seen.setdefault("ready", mine[0]),
        lambda: seen.update(end=look()),
    )
    of_size = (list(range(k * asked.rows, (k + 1) * asked.rows)) for k in range(batches))
    plan = plan_for(batches * asked.rows, folder / "fmus")
    with pool_for(1, scheduler.greeting, None)() as pool:
        own = Pool(pool, of_size, asked.seconds, moments)
        done = execute_study(plan, folder / "out", lambda: contextlib.nullcontext(own)).runs
        memory = scheduler.memory()
        quiet = scheduler.cpu()
        workers.ask("over")
        heartbeats = scheduler.cpu() - quiet
    workers.end()
    scheduler.end()
    before, after = seen["begin"]["written"], seen["end"]["written"]
    spent = [b - a for a, b in zip(seen["begin"]["cpu"], seen["end"]["cpu"], strict=True)]
    wall = seen["end"]["time"] - seen["begin"]["time"]
    size = [(b[0] - a[0]) / batches for a, b in zip(before, after, strict=True)]
    return {
        "workers": asked.workers,
        "batches": batches,
        "rows_per_batch": asked.rows,
        "rows": done,
        "seconds_until_all_joined": round(joined, 1),
        "seconds": round(wall, 1),
        "seconds_of_batches_alone": asked.seconds * asked.rounds,
        "scheduler_cpu_ms_per_batch": round(1e3 * spent[0] / batches, 3),
        "scheduler_cpu_ms_per_heartbeat": round(1e3 * heartbeats / asked.workers, 3),
        "starter_cpu_ms_per_batch": round(1e3 * spent[1] / batches, 3),
        "scheduler_writes_bytes_per_batch": round(size[0]),
        "workers_write_bytes_per_batch": round(size[1]),
        "starter_writes_bytes_per_batch": round(size[2]),
        "scheduler_memory_mib": round(memory),
        "shipped_bytes": seen["ready"] - before[2][0],
        "workers_that_keep_one_scheduler_busy": round(asked.seconds / (spent[0] / batches)),
    }


def main() -> None:
    """Measure, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.cluster")
    parser.add_argument("--workers", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=2.0, help="of a batch")
    parser.add_argument("--rows", type=int, default=20, help="runs in a batch")
    parser.add_argument("--rounds", type=int, default=3, help="batches of each worker")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--role", nargs="+", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    with dask.config.set(SETTINGS):
        if asked.role:
            kind, *given = asked.role
            of = schedule() if kind == "scheduler" else work(given[0], int(given[1]), given[2])
            asyncio.run(of)
            return
        with tempfile.TemporaryDirectory() as folder:
            from tests.benchmarks.cluster import simulated as by_name  # noqa: PLC0415

            with pytest.MonkeyPatch.context() as patched:
                patched.setattr("cosim.study.workers.run_ticket", by_name)
                found = measure(asked, Path(folder))
    if asked.json:
        print(json.dumps(found, indent=1))
        return
    view = Table(title="a study on simulated workers", title_justify="left", show_header=False)
    for key, value in found.items():
        view.add_row(key.replace("_", " "), str(value))
    Console().print(view)


if __name__ == "__main__":
    main()
