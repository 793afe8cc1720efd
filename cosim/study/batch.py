"""What a worker does: a handful of runs, each into one row of the table, whatever happens."""

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
from cosim.study.measurement import Value, measure
from cosim.study.schema import Study
from cosim.study.study_runner import BaseScenario, StudyRunner

REFUSED, FAILED = "refused", "failed"
"""Statuses beside those of an outcome: the run could not begin; a component or worker failed."""

_RUNNERS_KEPT = 2


@dataclass(frozen=True)
class Job:
    """All that a worker has to know of a study; the same for every batch.

    Attributes
    ----------
    digest : hash of what the results depend on.
    hashes : SHA-256 by FMU reference.
    designs : that were made already (`StudyRunner.designs_made`).
    traces : folder for traces, None where the batch is to leave none.
    digits : of the numbers in the names of traces.
    """

    study: Study
    base: BaseScenario
    hashes: dict[str, str]
    digest: str
    digits: int
    traces: Path | None = None
    designs: dict[str, str] = field(default_factory=dict)

    def trace_of(self, folder: Path, run: int) -> Path:
        """Where the trace of a run goes."""
        return folder / f"run-{run:0{self.digits}d}.mcap"


class Row(NamedTuple):
    """What came of one run; `values` one per metric of the study, in its order.

    status : finished, limit_cycle, diverged, failed, or refused for what could not begin.
    seconds : that it took here; no part of the results.
    """

    run: int
    status: str
    reason: str | None
    seconds: float
    values: tuple[Value, ...]


_runners: OrderedDict[str, StudyRunner] = OrderedDict()
# FMUs and the rows they write are one process' affair: one run at a time, however many threads
_alone = threading.Lock()


@one_thread
def run_batch(job: Job, runs: Sequence[int]) -> list[Row]:
    """Fly these runs; no error of a run leaves this function."""
    with _alone:
        runner = _runner(job)
        return [_row(job, runner, run) for run in runs]


@one_thread
def record_batch(job: Job, runs: Sequence[int]) -> list[str | None]:
    """Fly these runs again, each into its trace; why there is none where there is none."""
    with _alone:
        runner = _runner(job)
        return [_recorded(job, runner, run) for run in runs]


def register_runner(digest: str, runner: StudyRunner) -> None:
    """Let this process fly a study with a flyer that it has."""
    _runners[digest] = runner


def _runner(job: Job) -> StudyRunner:
    """The flyer of this process for a study, made once."""
    if job.digest not in _runners:
        _runners[job.digest] = StudyRunner(job.study, job.base, job.hashes, job.designs)
        while len(_runners) > _RUNNERS_KEPT:
            _runners.popitem(last=False)
    _runners.move_to_end(job.digest)
    return _runners[job.digest]


def run_and_measure(runner: StudyRunner, run: int) -> tuple[Outcome, tuple[Value, ...]]:
    """The outcome of a run and its metrics.

    Raises
    ------
    CosimError : it cannot be flown, or has not what a metric asks for.
    """
    outcome, completed = runner.execute_run(run)
    figures = outcome.to_json()
    values = []
    for name, metric in runner.study.metrics.items():
        try:
            values.append(measure(metric, figures, completed))
        except InputError as error:
            raise InputError(
                error.what,
                where=f"metrics.{name}: {error.where}" if error.where else f"metrics.{name}",
                expected=error.expected,
                got=error.got,
                hint=error.hint,
            ) from error
    return outcome, tuple(values)


def _row(job: Job, runner: StudyRunner, run: int) -> Row:
    began = time.perf_counter()
    values: tuple[Value, ...] = (None,) * len(job.study.metrics)
    try:
        outcome, values = run_and_measure(runner, run)
        status, reason = outcome.status, outcome.reason
        if job.traces is not None:
            reason = _recorded(job, runner, run) or reason
    except ComponentError as error:
        status, reason = FAILED, error.text()
    except CosimError as error:
        status, reason = REFUSED, error.text()
    except Exception as error:  # noqa: BLE001 - one run must not stop the others
        status, reason = FAILED, f"unexpected {type(error).__name__}: {error}"
    return Row(run, status, reason, time.perf_counter() - began, values)


def _recorded(job: Job, runner: StudyRunner, run: int) -> str | None:
    if job.traces is None:
        return "no folder for traces"
    try:
        runner.record(run, job.trace_of(job.traces, run))
    except CosimError as error:
        return error.text()
    except Exception as error:  # noqa: BLE001 - a trace that cannot be had must not stop others
        return f"unexpected {type(error).__name__}: {error}"
    return None
