"""Runs and sessions at the same time in one process: what `test_runs_in_threads` starts.

    python tests/scenario/in_threads.py HOW FOLDER FMUS RUNS SUPERVISE

HOW: one of `WAYS`. Four workers make RUNS runs each, of four scenarios in turn; every other one
is a session. Print the digests of each scenario as JSON; fail where the process is not as before.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import signal
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import flint

import cosim

WORKERS, SCENARIOS = 4, 4
SCENARIO = """\
title = "A vehicle and a controller, number {number}"
connect = [
    "plant.eta -> controller.eta : up",
    "plant.nu -> controller.nu",
    "controller.force -> plant.force",
]

[run]
end = 2.0
step = 0.1
seed = {number}

[components.plant]
fmu = "AuvPlant"
parameters = {{ "initial.eta.x" = 1.{number}, "initial.nu.u" = 0.5 }}

[components.controller]
fmu = "HinfController"

[links.up]
kind = "packet"
sample_time = 0.1
delay = 0.05
jitter = {{ kind = "uniform", width = "40 ms" }}
loss = 0.1

[[events]]
when = "plant.eta.x < 1.2{number} m and t > 0.3 s"
set = {{ "plant.disturbance.u" = 0.{number} }}
"""


@dataclass(frozen=True)
class Work:
    """Makes a run or a session; returns what it was and its digest, or its error."""

    fmus: Path
    supervise: bool

    def __call__(self, job: int) -> tuple[str, str]:
        """Make one run, or one session."""
        number = job % SCENARIOS
        try:
            return (self._session if job // SCENARIOS % 2 else self._run)(number, job)
        except Exception as error:  # noqa: BLE001 - it is what the test looks for
            return "error", f"{type(error).__name__}: {error}"

    def _run(self, number: int, job: int) -> tuple[str, str]:
        trace = f"traces/{job}.mcap"  # relative: FMUs are loaded meanwhile
        outcome = cosim.run(f"{number}.toml", trace, fmus=self.fmus, supervise=self.supervise)
        if not Path(trace).is_file():
            return "error", "no trace"
        return f"run {number}", f"{outcome.status} {outcome.content_hash}"

    def _session(self, number: int, _job: int) -> tuple[str, str]:
        file, supervise = f"{number}.toml", self.supervise
        with cosim.open_session(file, fmus=self.fmus, supervise=supervise) as session:
            session.step(3)
            session.run()
            run = session.result()
        digest = hashlib.sha256(run.points_ns.tobytes())
        for instance in run.instances:
            digest.update(instance.rows[: run.count].tobytes())
        return f"session {number}", f"{run.status} {digest.hexdigest()}"


Found = list[tuple[str, str]]


def _alone(work: Work, jobs: list[int]) -> Found:
    return [work(job) for job in jobs]


def _threads(work: Work, jobs: list[int]) -> Found:
    found: Found = []
    parts = (jobs[i::WORKERS] for i in range(WORKERS))
    threads = [
        Thread(target=lambda part: found.extend(_alone(work, part)), args=[p]) for p in parts
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def _futures(work: Work, jobs: list[int]) -> Found:
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(work, jobs))


def _asyncio(work: Work, jobs: list[int]) -> Found:
    async def all_of_them() -> Found:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(WORKERS))
        return await asyncio.gather(*(asyncio.to_thread(work, job) for job in jobs))

    return asyncio.run(all_of_them())


def _dask(work: Work, jobs: list[int]) -> Found:
    import dask  # noqa: PLC0415 - of this way alone

    tasks = [dask.delayed(work, pure=False)(job) for job in jobs]
    return list(dask.compute(*tasks, scheduler="threads", num_workers=WORKERS))


def _distributed(work: Work, jobs: list[int]) -> Found:
    from distributed import Client  # noqa: PLC0415 - of this way alone

    with Client(
        processes=False, n_workers=1, threads_per_worker=WORKERS, dashboard_address=":0"
    ) as client:
        found: Found = client.gather([client.submit(work, job, pure=False) for job in jobs])
        return found


WAYS: dict[str, Callable[[Work, list[int]], Found]] = {
    "alone": _alone,
    "threads": _threads,
    "futures": _futures,
    "asyncio": _asyncio,
    "dask": _dask,
    "distributed": _distributed,
}


def _surroundings() -> list[Any]:
    """What all threads share, and no run may change."""
    all_ignored = [f for f in warnings.filters if f[:3] == ("ignore", None, Warning)]
    return [str(Path.cwd()), flint.ctx.prec, all_ignored, signal.getsignal(signal.SIGTERM)]


def main(how: str, folder: str, fmus: str, runs: str, supervise: str) -> None:
    """Print what becomes of the runs."""
    os.chdir(folder)
    Path("traces").mkdir(exist_ok=True)
    for number in range(SCENARIOS):
        Path(f"{number}.toml").write_text(SCENARIO.format(number=number))
    before = _surroundings()
    found: dict[str, set[str]] = {}
    work = Work(Path(fmus), supervise == "True")
    for kind, digest in WAYS[how](work, list(range(WORKERS * int(runs)))):
        found.setdefault(kind, set()).add(digest)
    assert before == _surroundings()
    sys.stdout.write(json.dumps({kind: sorted(digests) for kind, digests in sorted(found.items())}))


if __name__ == "__main__":
    main(*sys.argv[1:])
