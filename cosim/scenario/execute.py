"""Run a prepared scenario: the run itself, its zero-state run, metrics and trace."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from cosim.core import ComponentError, InputError, Progress, silent
from cosim.master import (
    Cause,
    EngineName,
    Pace,
    Run,
    Supervisor,
    System,
    TraceRecorder,
)
from cosim.network import PacketSchedule
from cosim.scenario.assembly import assemble, same_start
from cosim.scenario.assertions import verdicts_of
from cosim.scenario.metrics import RunContext, final_values, metrics_of, status_of
from cosim.scenario.origin import Findings
from cosim.scenario.outcome import Outcome, refused_entries, result_entries
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_metadata import run_metadata_of
from cosim.scenario.script import Event, script_of
from cosim.scenario.supervision import Supervision, raise_if_interrupted, supervision_of
from cosim.scenario.system_run import CompletedRun, run_system
from cosim.trace import TraceWriter, content_hash, result_of_link


def execute_run(
    prepared: PreparedScenario,
    trace: Path | None = None,
    *,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    fsync: bool = False,
    supervision: Supervision | None = None,
) -> Outcome:
    """Run the scenario and its zero-state run, write the trace, and end the slaves.

    In a child process the slaves are ended before the trace is finished, which then says if that
    failed; in this process afterwards, since some FMUs end the process with themselves. An FMU
    that allows one instance per process is ended before the zero-state run begins.

    `engine` affects speed only: "kernel", "python", or "auto". `pace` slows the run (not the
    zero-state run) down to wall-clock time; `fsync` as for `TraceWriter`; `supervision` overrides
    what the scenario says.

    Raises
    ------
    InputError, ComponentError, LossError : what was recorded before is on disk.
    InterruptedRun, TerminatedRun : after Ctrl-C or SIGTERM in a supervised run; the trace is
        finished. In this process: `KeyboardInterrupt`, `SystemExit`; the trace is not finished.
    """
    supervision = supervision or supervision_of(prepared.loaded.scenario)
    if trace is None:
        return execute_unrecorded(
            prepared, progress=progress, engine=engine, pace=pace, supervision=supervision
        )[0]
    report_progress = progress or silent
    began = time.perf_counter()
    system, events = assembled_system(prepared)
    check_writable(trace)
    try:
        trace.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            "the folder of the trace cannot be made", where=str(trace.parent), got=str(error)
        ) from error
    entries, attachments = run_metadata_of(prepared, system)
    with (
        supervision.open(system, list(prepared.fmus.values())) as supervisor,
        ExitStack() as living,
        TraceWriter(trace, run=entries, attachments=attachments, fsync=fsync) as writer,
    ):
        recorder = TraceRecorder(writer, system)
        try:
            completed = run_system(
                system,
                "run",
                report_progress,
                engine,
                recorder,
                living=living,
                events=events,
                pace=pace,
                supervisor=supervisor,
                call_limit=supervision.limits.call,
            )
        except ComponentError as error:
            writer.finish(refused_entries(error))
            raise
        zero_state_run = _zero_state_run(
            prepared, system, completed.run, report_progress, living, supervisor, writer.flush
        )
        if supervisor is not None:
            recorder.run_ended = True
            living.close()
            supervisor.let_go()
        outcome, schedules = _outcome(
            prepared, system, completed, zero_state_run, trace, began, pace, supervisor
        )
        links: dict[str, str] = {}
        for name, schedule in schedules.items():
            links |= result_of_link(name, schedule.statistics())
        writer.finish({**result_entries(outcome), **links})
        outcome = replace(outcome, content_hash=content_hash(trace))
    outcome = replace(outcome, log_after_end=tuple(recorder.log_after_end))
    raise_if_interrupted(outcome, supervisor)
    return outcome


def execute_unrecorded(
    prepared: PreparedScenario,
    *,
    zero_state_run: bool = True,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    supervision: Supervision | None = None,
    supervisor: Supervisor | None = None,
) -> tuple[Outcome, Run]:
    """Run the scenario without a trace; return its outcome and its rows.

    zero_state_run : whether to make the zero-state run as well; without it no gain is measured,
        and envelope and limits are evaluated on this run alone.
    supervision : None: in this process, or by `supervisor`, which is open already.

    Raises
    ------
    InputError, ComponentError : see `execute_run`.
    """
    report_progress = progress or silent
    began = time.perf_counter()
    system, events = assembled_system(prepared)
    with ExitStack() as opened, ExitStack() as living:
        if supervision is not None:
            fmus = list(prepared.fmus.values())
            supervisor = opened.enter_context(supervision.open(system, fmus))
        completed = run_system(
            system,
            "run",
            report_progress,
            engine,
            living=living,
            events=events,
            pace=pace,
            supervisor=supervisor,
            call_limit=None if supervision is None else supervision.limits.call,
        )
        beside = None
        if zero_state_run:
            beside = _zero_state_run(
                prepared, system, completed.run, report_progress, living, supervisor
            )
        living.close()
        outcome, _ = _outcome(prepared, system, completed, beside, None, began, pace, supervisor)
    raise_if_interrupted(outcome, supervisor)
    return outcome, completed.run


def check_writable(trace: Path) -> None:
    """Check that a trace can be written, before anything takes time; creates nothing.

    Raises
    ------
    InputError : its folder, or the nearest existing one, cannot be written.
    """
    nearest = next(folder for folder in trace.absolute().parents if folder.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            "the folder of the trace cannot be written",
            where=str(trace.parent),
            expected=f"{nearest} to be a folder that can be written",
            hint="another place: --out",
        )


def assembled_system(prepared: PreparedScenario) -> tuple[System, Sequence[Event]]:
    """Assemble the system; return it and its events."""
    loaded = prepared.loaded
    scenario = loaded.scenario
    system = assemble(
        scenario,
        prepared.fmus,
        parameters=prepared.gain,
        worst_case=prepared.worst_case,
        origin=loaded.origin,
    )
    findings = Findings(loaded.origin)
    events = script_of(scenario, system, findings)
    verdicts_of(scenario, system, None, findings)
    return system, events


def _zero_state_run(
    prepared: PreparedScenario,
    system: System,
    run: Run,
    report_progress: Progress,
    living: ExitStack,
    supervisor: Supervisor | None,
    flush: Callable[[], None] | None = None,
) -> Run | None:
    """Make the zero-state run; None without a design, or after a failed or interrupted run.

    flush : writes what is recorded to disk, in case slaves must be ended first.
    """
    interrupted = run.cause is not None and run.cause.kind == "interrupted"
    if prepared.design is None or run.status == "failed" or interrupted:
        return None
    at_rest = assemble(
        prepared.loaded.scenario,
        prepared.fmus,
        parameters=prepared.gain,
        worst_case=prepared.worst_case,
        at_rest=True,
    )
    # a run from the zero state is its own zero-state run
    if same_start(system, at_rest):
        return run
    if any(fmu.can_be_instantiated_only_once for fmu in prepared.fmus.values()):
        if flush is not None:
            flush()
        living.close()
    events = script_of(prepared.loaded.scenario, at_rest, Findings())
    return run_system(
        at_rest,
        "zero-state run",
        report_progress,
        "auto",
        living=living,
        events=events,
        supervisor=supervisor,
    ).run


_DEATHS = ("crashed", "exited", "timed-out", "memory", "interrupted")


def _with_later_failure(
    outcome: Outcome, zero_state_run: Run | None, supervisor: Supervisor | None
) -> Outcome:
    """Return the outcome with what ended the child process beside or after a run that went well."""
    if outcome.cause is not None or supervisor is None:
        return outcome
    cause: Cause | None = None
    if zero_state_run is not None and zero_state_run.cause is not None:
        if zero_state_run.cause.kind in _DEATHS:
            cause, when, words = (
                zero_state_run.cause,
                "in the zero-state run",
                zero_state_run.reason,
            )
    elif supervisor.end_failure is not None:
        (cause, words), when = supervisor.end_failure, "after the run was complete"
    if cause is None:
        return outcome
    cause = replace(cause, detail=f"{when}: {cause.detail}")
    if not cause.failure:
        return replace(outcome, cause=cause)
    return replace(outcome, cause=cause, status="failed", reason=f"{when}: {words}")


def _outcome(
    prepared: PreparedScenario,
    system: System,
    completed: CompletedRun,
    zero_state_run: Run | None,
    trace: Path | None,
    began: float,
    pace: Pace | None,
    supervisor: Supervisor | None,
) -> tuple[Outcome, Mapping[str, PacketSchedule]]:
    scenario, run = prepared.loaded.scenario, completed.run
    schedules = run.schedules
    context = RunContext(
        scenario,
        prepared.problem,
        prepared.design,
        run,
        zero_state_run,
        schedules,
        prepared.worst_case,
        system,
        altered_by_events=completed.altered_by_events,
    )
    outcome = Outcome(
        scenario=prepared.loaded.name,
        title=scenario.title,
        status=status_of(context),
        reason=run.reason,
        trace=trace,
        content_hash=None,
        steps=max(run.points_ns.size - 1, 0),
        simulated_s=float(run.points_ns[-1]) / 1e9 if run.points_ns.size else 0.0,
        wall_s=time.perf_counter() - began,
        final=final_values(run),
        metrics=metrics_of(context),
        links={name: s.statistics() for name, s in schedules.items()},
        engine=run.engine,
        pace=pace,
        assertions=verdicts_of(scenario, system, run, Findings(prepared.loaded.origin)),
        design=prepared.source,
        cause=run.cause,
        supervised=None if supervisor is None else supervisor.method,
    )
    return _with_later_failure(outcome, zero_state_run, supervisor), schedules
