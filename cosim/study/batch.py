"""The work of a worker: execute a batch of runs and return one row of the table for each."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from cosim.core import ComponentError, CosimError, InputError
from cosim.hinf import one_thread
from cosim.scenario import Outcome
from cosim.study.consistency import changed_error
from cosim.study.measurement import Value, measure
from cosim.study.schema import Study
from cosim.study.study_runner import BaseScenario, StudyRunner

REFUSED, FAILED = "refused", "failed"
"""Statuses in addition to those of an outcome: could not start; a component or worker failed."""
ASSERTION_FAILED = "assertion_failed"
"""Status of a run that reached its end, and whose assertions did not all come out as expected."""

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
    """

    study: Study
    base: BaseScenario
    hashes: dict[str, str]
    digest: str
    digits: int
    traces: Path | None = None
    designs: dict[str, str] = field(default_factory=dict)

    def trace_of(self, folder: Path, run: int) -> Path:
        """Return the path of a run's trace."""
        return folder / f"run-{run:0{self.digits}d}.mcap"


class Row(NamedTuple):
    """The result of one run; `values` has one value per metric, in the order of the study.

    status : finished, assertion_failed, limit_cycle, stopped, diverged, failed, or refused if it
        could not start.
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


@one_thread
def run_batch(job: Job, runs: Sequence[int]) -> list[Row]:
    """Execute these runs; an error of a run becomes its row."""
    with _alone:
        runner = _runner(job)
        return [_row(job, runner, run) for run in runs]


@one_thread
def record_batch(job: Job, runs: Sequence[int]) -> list[str | None]:
    """Repeat these runs with a trace each; return the reason for each trace that is missing."""
    with _alone:
        runner = _runner(job)
        return [_recorded(job, runner, run) for run in runs]


def register_runner(digest: str, runner: StudyRunner) -> None:
    """Make this process use an existing runner for the study with this digest."""
    _runners[digest] = runner


def _runner(job: Job) -> StudyRunner:
    """Return this process' runner for a study; it is created once."""
    if job.digest not in _runners:
        _runners[job.digest] = StudyRunner(job.study, job.base, job.hashes, job.designs)
        while len(_runners) > _RUNNERS_KEPT:
            _runners.popitem(last=False)
    _runners.move_to_end(job.digest)
    return _runners[job.digest]


def run_and_measure(runner: StudyRunner, run: int) -> tuple[Outcome, tuple[Value, ...]]:
    """Execute a run; return its outcome and its metrics.

    Raises
    ------
    CosimError : the run cannot be executed, or lacks what a metric needs.
    """
    outcome, completed = runner.execute_run(run)
    figures = outcome.to_json()
    values = []
    for name, metric in runner.study.metrics.items():
        try:
            values.append(measure(metric, figures, completed))
        except InputError as error:
            place = f"metrics.{name}"
            where = f"{place}: {error.where}" if error.where else place
            raise changed_error(error, where=where) from error
    return outcome, tuple(values)


def _row(job: Job, runner: StudyRunner, run: int) -> Row:
    began = time.perf_counter()
    values: tuple[Value, ...] = (None,) * len(job.study.metrics)
    try:
        outcome, values = run_and_measure(runner, run)
        status, reason = status_of(outcome)
        if job.traces is not None:
            reason = _recorded(job, runner, run) or reason
    except ComponentError as error:
        status, reason = FAILED, error.text()
    except CosimError as error:
        status, reason = REFUSED, error.text()
    except Exception as error:  # noqa: BLE001 - one run must not stop the others
        status, reason = FAILED, f"unexpected {type(error).__name__}: {error}"
    return Row(run, status, reason, time.perf_counter() - began, values)


def status_of(outcome: Outcome) -> tuple[str, str | None]:
    """Return status and reason of a run in the table; failed assertions are named."""
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
