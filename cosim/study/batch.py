"""The work of a worker: execute a batch of runs and return one row of the table for each."""

from __future__ import annotations

import atexit
import os
import platform
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

from cosim.core import ComponentError, CosimError, InputError
from cosim.hinf.delay_lti import one_thread
from cosim.master import Run
from cosim.scenario import Outcome
from cosim.study.consistency import changed_error
from cosim.study.measurement import Value, measure
from cosim.study.rare_study import Drawn, RarePoints
from cosim.study.schema import Study
from cosim.study.study_runner import BaseScenario, StudyRunner

REFUSED, FAILED, CRASHED, TIMED_OUT, LOST = "refused", "failed", "crashed", "timed_out", "lost"
"""Statuses in addition to those of an outcome: the run could not start; a component refused a call;
it ended its process; it exceeded a limit of time; the worker died at each attempt."""
ASSERTION_FAILED = "assertion_failed"
"""Status of a run that reached its end, and whose assertions did not all come out as expected."""
INCOMPLETE = (REFUSED, FAILED, CRASHED, TIMED_OUT, LOST)
"""Statuses of runs that have no result."""
UNSUCCESSFUL = (FAILED, CRASHED, TIMED_OUT, ASSERTION_FAILED, "diverged", "limit_cycle")
"""Statuses of the runs whose traces are kept by `traces = "failed"`."""
_BY_CAUSE = {"crashed": CRASHED, "exited": CRASHED, "timed-out": TIMED_OUT}

PACKAGES = ("auv-cosim", "fmpy", "numpy", "scipy", "pydantic")
"""Packages on whose versions results may depend."""
_RUNNERS_KEPT = 2


@dataclass(frozen=True)
class Job:
    """What a worker needs to know about a study; the same for every batch.

    Attributes
    ----------
    digest : hash of everything that the results depend on.
    hashes : SHA-256 by FMU reference.
    designs : designs that exist already (`StudyRunner.designs_made`).
    traces : folder for traces; None to record none.
    digits : number of digits of the run number in the names of traces.
    limits : of each run, as for `cosim run --limit`; they come before those of the scenario.
    run_limit_s : wall-clock time of a run for which no limit is given [s]; None: none.
    software : the versions that the starting process has; workers must have the same.
    drawn : the points of runs that follow from results, in a study of a rare event.
    """

    study: Study
    base: BaseScenario
    hashes: dict[str, str]
    digest: str
    digits: int
    traces: Path | None = None
    designs: dict[str, str] = field(default_factory=dict)
    limits: tuple[str, ...] = ()
    run_limit_s: float | None = None
    software: dict[str, str] = field(default_factory=dict)
    drawn: Drawn | None = None

    def trace_of(self, folder: Path, run: int) -> Path:
        """Return the path of a run's trace."""
        return folder / f"run-{run:0{self.digits}d}.mcap"


class Row(NamedTuple):
    """The result of one run; `values` has one value per metric, in the order of the study.

    status : finished, assertion_failed, limit_cycle, stopped, diverged, failed, crashed, timed_out,
        lost, or refused if it could not start.
    seconds : wall time of the run; not part of the results.
    """

    run: int
    status: str
    reason: str | None
    seconds: float
    values: tuple[Value, ...]


_runners: OrderedDict[str, StudyRunner] = OrderedDict()
# one run at a time in a process, whatever the number of threads: FMUs have global state
_alone = threading.Lock()
_IDLE_S = 5.0
"""How long a child waits for the next batch."""


class _KeptChild:
    """Keeps the child process of a runner from batch to batch, and for a while after the last."""

    def __init__(self) -> None:
        self._opened = ExitStack()
        self._key: object = None
        self._timer: threading.Timer | None = None
        atexit.register(self.close)

    def begin(self, runner: StudyRunner, key: object) -> None:
        """Begin a batch, in a new child for another key; a runner that has a child keeps it."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()  # no process is forked from one with threads
            self._timer = None
        if runner.is_supervised and self._key in (None, key):
            return
        self.close()
        self._opened.enter_context(runner.supervised())
        self._key = key

    def end(self) -> None:
        """End a batch: the child ends, too, if no other batch begins soon."""
        if self._key is None:
            return
        self._timer = threading.Timer(_IDLE_S, self._end_idle)
        self._timer.daemon = True
        self._timer.start()

    def _end_idle(self) -> None:
        if _alone.acquire(blocking=False):  # else another batch has begun, and ends it later
            try:
                self.close()
            finally:
                _alone.release()

    def close(self) -> None:
        """End the child."""
        self._opened.close()
        self._key = None


_kept = _KeptChild()


def begin_worker(job: Job) -> None:
    """Begin as a worker: of the process that this one was forked from, it has the job's runner."""
    global _alone, _kept
    runner = _runners.get(job.digest)
    _runners.clear()
    if runner is not None:
        runner.leave_children()
        register_runner(job.digest, runner)
    _alone, _kept = threading.Lock(), _KeptChild()


@one_thread
def run_batch(job: Job, runs: Sequence[int]) -> list[Row]:
    """Execute these runs; an error of a run becomes its row."""
    with _alone:
        runner = runner_of(job)
        _kept.begin(runner, (job.digest, job.drawn))
        try:
            rows: Iterable[Row | None] = repeat(None, len(runs))
            if job.traces is None:
                rows = runner.in_child(_row_here, runs, Row)
            return [_row(job, runner, *found) for found in zip(runs, rows, strict=True)]
        finally:
            _kept.end()


@one_thread
def record_batch(job: Job, runs: Sequence[int]) -> list[str | None]:
    """Repeat these runs with a trace each; return the reason for each trace that is missing."""
    with _alone:
        runner = runner_of(job)
        return [_recorded(job, runner, run) for run in runs]


def register_runner(digest: str, runner: StudyRunner) -> None:
    """Make this process use an existing runner for the study with this digest."""
    _runners[digest] = runner


def runner_of(job: Job) -> StudyRunner:
    """Return this process' runner for a study; it is created once."""
    if job.digest not in _runners:
        check_software(job.software)
        _runners[job.digest] = StudyRunner(job.study, job.base, job.hashes, job.designs)
        while len(_runners) > _RUNNERS_KEPT:
            _runners.popitem(last=False)
    _runners.move_to_end(job.digest)
    runner = _runners[job.digest]
    runner.limits, runner.run_limit_s = job.limits, job.run_limit_s
    if job.drawn is not None and isinstance(runner.points, RarePoints):
        runner.points.learn(job.drawn)
    return runner


def software() -> dict[str, str]:
    """Return the versions on which results depend, of this process."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def check_software(wanted: Mapping[str, str]) -> None:
    """Check that a worker has the versions of the process that started the study.

    Raises
    ------
    InputError : it has not.
    """
    here = software()
    differ = [name for name, version_there in wanted.items() if here.get(name) != version_there]
    if differ:
        raise InputError(
            "a worker has other versions than the process that started the study",
            where=f"worker {platform.node()}, process {os.getpid()}",
            expected=", ".join(f"{name} {wanted[name]}" for name in differ),
            got=", ".join(f"{name} {here.get(name)}" for name in differ),
            hint="install the same versions everywhere; results would not be the same bit for bit",
        )


def run_and_measure(runner: StudyRunner, run: int) -> tuple[Outcome, tuple[Value, ...]]:
    """Execute a run; return its outcome and its metrics.

    Raises
    ------
    CosimError : the run cannot be executed, or lacks what a metric needs.
    """
    outcome, completed = runner.execute_run(run, runner.wanted)
    try:
        return outcome, _measured(runner.study, outcome, completed)
    except InputError:  # with all figures the message names those that are alike
        outcome, completed = runner.execute_run(run)
        return outcome, _measured(runner.study, outcome, completed)


def record_and_measure(
    runner: StudyRunner, run: int, trace: Path
) -> tuple[Outcome, tuple[Value, ...]]:
    """Execute a run that writes its trace; return what `run_and_measure` does.

    Raises
    ------
    CosimError : as there; or the trace cannot be written.
    """
    _, outcome, completed = runner.record(run, trace, keep=True)
    return outcome, _measured(runner.study, outcome, completed)


def _measured(study: Study, outcome: Outcome, completed: Run) -> tuple[Value, ...]:
    figures = outcome.to_json()
    values: dict[str, Value] = {}
    for name, metric in study.metrics.items():
        try:
            values[name] = measure(metric, figures, completed, values)
        except InputError as error:
            place = f"metrics.{name}"
            where = f"{place}: {error.where}" if error.where else place
            raise changed_error(error, where=where) from error
    return tuple(values.values())


def _row(job: Job, runner: StudyRunner, run: int, row: Row | None) -> Row:
    """Return the row of a run; None: it was not executed, or ended the child that did it."""
    if job.traces is not None:
        return _recorded_row(runner, run, job.trace_of(job.traces, run))
    # repeated in a way that tells which component and call ended the child
    return row or _row_here(runner, run)


def _recorded_row(runner: StudyRunner, run: int, trace: Path) -> Row:
    """Return the row of a run that writes its trace; the reason says why a trace is missing."""
    row = _row_here(runner, run, trace)
    if row.status != REFUSED:
        return row
    plain = _row_here(runner, run)  # the run or the trace was refused
    return plain if plain.status in INCOMPLETE else plain._replace(reason=row.reason)


def _row_here(runner: StudyRunner, run: int, trace: Path | None = None) -> Row:
    began = time.perf_counter()
    values: tuple[Value, ...] = (None,) * len(runner.study.metrics)
    try:
        if trace is None:
            outcome, values = run_and_measure(runner, run)
        else:
            outcome, values = record_and_measure(runner, run, trace)
        status, reason = status_of(outcome)
    except ComponentError as error:
        status, reason = _BY_CAUSE.get(error.kind or "", FAILED), error.text()
    except CosimError as error:
        status, reason = REFUSED, error.text()
    except Exception as error:  # noqa: BLE001 - one run must not stop the others
        status, reason = FAILED, f"unexpected {type(error).__name__}: {error}"
    values = values_of(runner.study, status, values)
    return Row(run, status, reason, time.perf_counter() - began, values)


def values_of(study: Study, status: str, values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return the values that count of a run with this status.

    What a run without a result has come to is no result: a vehicle is near its place when its
    first step crashes. Its numbers are missing, and missing ones are outside every bound.
    """
    if status not in INCOMPLETE:
        return values
    return tuple(False if metric.asks else None for metric in study.metrics.values())


def status_of(outcome: Outcome) -> tuple[str, str | None]:
    """Return status and reason of a run in the table; failed assertions are named."""
    if outcome.status == FAILED and outcome.cause is not None:
        return _BY_CAUSE.get(outcome.cause.kind, FAILED), outcome.reason
    if outcome.as_expected:
        return outcome.status, outcome.reason
    failed = [a.name or a.words for a in outcome.assertions if not a.as_expected]
    words = f"failed: {'; '.join(failed)}"
    if outcome.status == "finished":
        return ASSERTION_FAILED, words
    return outcome.status, f"{outcome.reason}; {words}" if outcome.reason else words


def _recorded(job: Job, runner: StudyRunner, run: int) -> str | None:
    if job.traces is None:
        return "there is no folder for traces"
    try:
        runner.record(run, job.trace_of(job.traces, run))
    except CosimError as error:
        return error.text()
    except Exception as error:  # noqa: BLE001 - one trace must not stop the others
        return f"unexpected {type(error).__name__}: {error}"
    return None
