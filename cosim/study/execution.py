"""Execute a study, or the rest of it, and write its table."""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim.core import LossError, Progress, default_method, silent
from cosim.study.batch import (
    INCOMPLETE,
    LOST,
    REFUSED,
    UNSUCCESSFUL,
    Job,
    Row,
    record_batch,
    register_runner,
    run_batch,
    software,
    values_of,
)
from cosim.study.folder import Folder
from cosim.study.manifest import manifest_of
from cosim.study.plan import Plan, extended_by, trial_run
from cosim.study.rare_study import RarePoints
from cosim.study.run_log import RunLog
from cosim.study.schema import Study
from cosim.study.stability_boundary import nominal_loop_figures
from cosim.study.stages import stages_of
from cosim.study.table import pyarrow, write_table
from cosim.study.workers import Batch, WorkerDied, WorkerPool, in_process

BATCH_S = 2.0
"""Time that a batch should take [s]: much longer than submitting it, short for a user."""
BATCH_S_PER_WORKER = 0.005
"""That time for each worker, if it is longer [s]: twice what a scheduler spends on a batch."""
MAX_AT_ONCE = 4000
MOST_INCOMPLETE = 1000
"""Most runs without a result that `StudyResult` lists."""
_PIECES = 8  # that a batch is split into after a worker died

RUN_LIMIT_S, RUN_LIMIT_FACTOR = 60.0, 50.0
"""Limit of a run for which none is given: so many times the first runs, at least so long [s]."""


@dataclass(frozen=True)
class StudyResult:
    """The result of executing a study.

        >>> from cosim import DelaySystem, Scenario, run_study
        >>> from cosim.study import Study
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1]).loaded()
        >>> rates = {"kind": "grid", "path": "components.lag.parameters.A[1,1]", "values": [-1, -2]}
        >>> end = {"x": "final.lag.x[1]"}
        >>> study = Study(title="Lags", scenario="lag", vary=[rates], metrics=end)
        >>> done = run_study(study, "lags", scenario=lag)
        >>> done.runs, done.statuses, done.results.as_posix()
        (2, {'finished': 2}, 'lags/results.parquet')

    Attributes
    ----------
    folder, results : the folder of the study, and its table; the folder while runs are missing.
    runs : number of runs that are done; `executed` of them in this call, the others before.
    count : number of runs of the study.
    statuses : status -> number of runs.
    traces : number of the run -> None for a kept trace, or why there is none.
    seconds : wall time of this call.
    run_limit_s : wall-clock limit of a run for which none was given [s]; None where runs cannot be
        limited.
    retried : number of runs that were executed again, since their worker died.
    incomplete : the rows of the first 1,000 runs that have no result: refused, failed, crashed,
        timed out or lost; `statuses` counts all.
    """

    folder: Path
    results: Path
    runs: int
    count: int
    executed: int
    statuses: dict[str, int]
    traces: dict[int, str | None]
    seconds: float
    run_limit_s: float | None
    retried: int
    incomplete: tuple[Row, ...]

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values."""
        return {
            "folder": str(self.folder),
            "results": str(self.results),
            "runs": self.runs,
            "count": self.count,
            "executed": self.executed,
            "resumed": self.runs - self.executed,
            "statuses": self.statuses,
            "traces": {str(run): why for run, why in sorted(self.traces.items())},
            "seconds": self.seconds,
            "run_limit_s": self.run_limit_s,
            "retried": self.retried,
            "incomplete": [
                {"run": row.run, "status": row.status, "reason": row.reason}
                for row in self.incomplete
            ],
        }


def execute_study(
    plan: Plan,
    out: Path,
    pool: Callable[[], AbstractContextManager[WorkerPool]] = in_process,
    *,
    fresh: bool = False,
    limits: Sequence[str] = (),
    time_limit_s: float | None = None,
    runs: range | None = None,
    progress: Progress | None = None,
) -> StudyResult:
    """Execute the runs that are not done yet; write the table once all are.

    Parameters
    ----------
    out : folder of the study.
    pool : opens the worker pool (`cosim.study.workers`); called only if there is work.
    fresh : delete earlier results and start again.
    limits : of each run, as for `cosim run --limit`.
    time_limit_s : wall-clock time after which no further run begins [s].
    runs : execute these only (`Plan.part`), as where others are executed in other places.

    Raises
    ------
    LossError : the time is over, or the disk is full. Runs that are done are kept.
    CosimError : see `Folder.begin`, `trial_run` and `workers`. Runs that are done are kept.
    """
    pyarrow()  # if it is missing, fail now and not at the end
    began = time.perf_counter()
    report_progress = progress or silent
    plan = replace(plan, job=replace(plan.job, limits=tuple(limits), software=software()))
    register_runner(plan.job.digest, plan.runner)
    plan.runner.limits, retried = plan.job.limits, 0
    with Folder(out) as folder, ExitStack() as pools:
        # where the scenario is, for `cosim study repeat FOLDER`; the table must not depend on it
        origin = {"scenario_folder": str(plan.job.base.folder)}
        folder.begin(
            manifest_of(plan) | origin,
            fresh=fresh,
            extended=lambda before: extended_by(plan, before),
        )
        done = folder.rows
        before = len(done)
        until = math.inf if time_limit_s is None else began + time_limit_s
        opened: WorkerPool | None = None
        stage = range(0)
        for stage in stages_of(plan, done) if runs is None else [runs]:
            if any(run not in done for run in stage):
                # a stage has its own child, which knows its points
                with plan.runner.supervised():
                    if opened is None:
                        if not done:
                            report_progress("trial run", 0.0)
                            first, seconds = trial_run(plan, stage, _ready(plan, folder).traces)
                            if first is not None:
                                folder.append([first])
                        else:
                            seconds = done.longest
                        plan = _with_limit(plan, seconds, report_progress)
                        opened = pools.enter_context(pool())
                    retried += _run_rest(plan, stage, folder, opened, report_progress, until)
            _check_complete(stage, done)
        pools.close()
        count = plan.count if runs is not None else stage.stop
        manifest = {
            **manifest_of(plan),
            "count": count,
            "stability": nominal_loop_figures(plan),
        }
        complete = all(run in done for run in range(count))
        if complete:
            # a study that stopped later before may have more
            whole = done if len(done) == count else [done[run] for run in range(count)]
            write_table(manifest, whole, folder.results)
        else:
            folder.describe(manifest)  # `merge_studies` takes it from here
        chosen = chosen_runs(plan.job.study, done)
        kept: dict[int, str | None] = dict.fromkeys(chosen)
        missing = [r for r in chosen if not plan.job.trace_of(folder.traces, r).is_file()]
        if missing:
            with pool() as opened:
                kept |= _record(plan, folder, opened, missing, report_progress)
        incomplete, executed = _incomplete(done), len(done) - before
    return StudyResult(
        folder=out,
        results=folder.results if complete else out,
        runs=min(len(done), count),
        count=count,
        executed=executed,
        statuses=dict(sorted(done.statuses.items())),
        traces=kept,
        seconds=time.perf_counter() - began,
        run_limit_s=plan.job.run_limit_s,
        retried=retried,
        incomplete=incomplete,
    )


def _with_limit(plan: Plan, seconds: float, report_progress: Progress) -> Plan:
    """Return the plan with a limit of time for each run: its first runs took `seconds`."""
    if default_method() is None:
        return plan
    limit = float(f"{max(RUN_LIMIT_S, RUN_LIMIT_FACTOR * seconds):.2g}")
    report_progress(f"a run may take {limit:g} s, if no limit is given", 0.0)
    return replace(plan, job=replace(plan.job, run_limit_s=limit))


class _Queue:
    """The runs that are left, in batches that take about `BATCH_S`."""

    def __init__(self, runs: Iterator[int], count: int, workers: int, seconds: float) -> None:
        self._runs, self._left, self.workers = runs, count, workers
        self._each = seconds
        self._again: list[Batch] = []

    def next_batch(self) -> Batch | None:
        """Return the next batch; None if there is none."""
        if self._again:
            return self._again.pop()
        seconds = max(BATCH_S, BATCH_S_PER_WORKER * self.workers)
        size = int(seconds / max(self._each, 1e-6))
        # smaller batches towards the end, so that all workers end at about the same time
        size = max(1, min(size, MAX_AT_ONCE, math.ceil(self._left / (4 * self.workers))))
        batch = list(itertools.islice(self._runs, size))
        self._left -= len(batch)
        return batch or None

    def give_back(self, batch: Batch) -> Batch:
        """Queue a batch again in pieces after a worker died; return its run if it has only one."""
        if len(batch) == 1:
            return batch
        size = math.ceil(len(batch) / _PIECES)
        self._again += [batch[i : i + size] for i in range(0, len(batch), size)]
        return []

    def record_durations(self, rows: list[Row]) -> None:
        """Update the mean duration of a run."""
        mean = sum(row.seconds for row in rows) / len(rows)
        self._each = 0.7 * self._each + 0.3 * mean


def _run_rest(
    plan: Plan,
    runs: range,
    folder: Folder,
    pool: WorkerPool,
    report_progress: Progress,
    until: float,
) -> int:
    """Execute those of the runs that are not done; append the rows to the run log.

    Return how many were executed again. `until` : when the time of the study is over.
    """
    job = _ready(plan, folder)
    done = folder.rows
    seconds = done.seconds / len(done) if done else BATCH_S
    rest = (run for run in runs if run not in done)
    # other runs than these may be done too
    others = len(done) - sum(run in done for run in runs)
    queue = _Queue(rest, others + len(runs) - len(done), pool.size, seconds)
    suspects: list[int] = []
    retried = 0

    def next_batch() -> Batch | None:
        queue.workers = pool.size  # workers may come and go
        return queue.next_batch() if time.perf_counter() < until else None

    def report(more: str = "") -> None:
        here = len(done) - others
        report_progress(f"{here} of {len(runs)} runs{more}", here / len(runs))

    def keep(rows: list[Row]) -> None:
        folder.append(rows)
        report()

    pool.notice = lambda text: report_progress(text, (len(done) - others) / len(runs))
    for batch, result in pool.run_batches(run_batch, job, next_batch):
        if isinstance(result, WorkerDied):
            retried += len(batch)
            suspects += queue.give_back(batch)
            report(f", {retried} executed again")
            continue
        queue.record_durations(result)
        keep(result)
    # a worker died on each of these: one at a time, so that the cause is certain
    for run in suspects if time.perf_counter() < until else ():
        for _, result in pool.run_batches(run_batch, job, _once(run)):
            if isinstance(result, WorkerDied):
                nothing = values_of(plan.job.study, LOST, ())
                keep([Row(run, LOST, _lost(2 * result.attempts), 0.0, nothing)])
            else:
                keep(result)
    if len(done) - others < len(runs) and time.perf_counter() >= until:
        raise LossError(
            "the time of the study is over",
            where=str(folder.path),
            expected=f"{len(runs)} runs",
            got=f"{len(done) - others}, which are kept",
            hint="the same command continues",
        )
    return retried


def _lost(attempts: int) -> str:
    return f"the worker process that executed this run died at each of {attempts} attempts"


def _check_complete(runs: range, done: RunLog) -> None:
    """Check that every run is there."""
    missing = next((run for run in runs if run not in done), None)
    if missing is not None:
        raise LossError(
            "runs are missing from the table",
            where="study",
            expected=f"{len(runs)} runs",
            got=f"{sum(run in done for run in runs)}, without number {missing}",
            hint="the same command continues",
        )


def _ready(plan: Plan, folder: Folder) -> Job:
    """Return the job for workers, with the designs made here and the folder for traces."""
    all_kept, points = plan.job.study.traces == "all", plan.runner.points
    return replace(
        plan.job,
        designs=plan.runner.designs_made(),
        drawn=points.drawn if isinstance(points, RarePoints) else None,
        traces=folder.traces.absolute() if all_kept else None,
    )


def _incomplete(done: RunLog) -> tuple[Row, ...]:
    """Return the first rows of runs that have no result."""
    if done.statuses.keys().isdisjoint(INCOMPLETE):
        return ()
    found = (row for row in done if row.status in INCOMPLETE)
    return tuple(itertools.islice(found, MOST_INCOMPLETE))


def chosen_runs(study: Study, done: RunLog) -> list[int]:
    """Return the runs whose traces the study keeps."""
    if study.traces == "none":
        return []
    ran = (row for row in done if row.status not in (REFUSED, LOST))
    if study.worst is None:
        every = study.traces == "all"
        return [row.run for row in ran if every or row.status in UNSUCCESSFUL]
    count, by = study.worst
    place = list(study.metrics).index(by.removeprefix("-"))
    sign = -1.0 if by.startswith("-") else 1.0
    ranked = (
        (sign * float(value), -row.run)
        for row in ran
        if isinstance(value := row.values[place], (int, float)) and math.isfinite(value)
    )
    return sorted(-run for _, run in heapq.nlargest(count, ranked))


def _record(
    plan: Plan, folder: Folder, pool: WorkerPool, chosen: list[int], report_progress: Progress
) -> dict[int, str | None]:
    """Repeat the chosen runs, each with a trace; a repeated run gives the same result."""
    job = replace(_ready(plan, folder), traces=folder.traces.absolute())
    kept: dict[int, str | None] = {}
    for batch, result in pool.run_batches(record_batch, job, _once(*chosen)):
        reasons: list[Any]
        if isinstance(result, WorkerDied):
            reasons = [_lost(result.attempts)] * len(batch)
        else:
            reasons = result
        kept.update(zip(batch, reasons, strict=True))
        report_progress(f"{len(kept)} of {len(chosen)} traces", len(kept) / len(chosen))
    return kept


def _once(*runs: int) -> Callable[[], Batch | None]:
    """Return a function that gives each of the runs in a batch of its own."""
    waiting = iter(runs)
    return lambda: None if (run := next(waiting, None)) is None else [run]
