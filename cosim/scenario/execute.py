"""Run a prepared scenario: the run itself, its zero-state run, metrics and trace."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from cosim.core import InputError, Progress, silent
from cosim.master import EngineName, Pace, Run, System, TraceRecorder
from cosim.network import PacketSchedule
from cosim.scenario.assembly import assemble, same_start
from cosim.scenario.assertions import verdicts_of
from cosim.scenario.metrics import RunContext, final_values, metrics_of, status_of
from cosim.scenario.origin import Findings
from cosim.scenario.outcome import Outcome, result_entries
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_metadata import run_metadata_of
from cosim.scenario.script import Event, script_of
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
) -> Outcome:
    """Run the scenario and its zero-state run, write the trace, then end the slaves.

    An FMU that allows one instance per process is ended before the zero-state run begins.

    `engine` affects speed only: "kernel", "python", or "auto". `pace` slows the run (not the
    zero-state run) down to wall-clock time; `fsync` as for `TraceWriter`.

    Raises
    ------
    InputError, ComponentError, LossError : what was recorded before is on disk.
    """
    if trace is None:
        return execute_unrecorded(prepared, progress=progress, engine=engine, pace=pace)[0]
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
        ExitStack() as living,
        TraceWriter(trace, run=entries, attachments=attachments, fsync=fsync) as writer,
    ):
        recorder = TraceRecorder(writer, system)
        completed = run_system(
            system,
            "run",
            report_progress,
            engine,
            recorder,
            living=living,
            events=events,
            pace=pace,
        )
        zero_state_run = _zero_state_run(
            prepared, system, completed.run, report_progress, living, writer.flush
        )
        outcome, schedules = _outcome(
            prepared, system, completed, zero_state_run, trace, began, pace
        )
        links: dict[str, str] = {}
        for name, schedule in schedules.items():
            links |= result_of_link(name, schedule.statistics())
        writer.finish({**result_entries(outcome), **links})
    late = tuple(recorder.log_after_end)
    return replace(outcome, content_hash=content_hash(trace), log_after_end=late)


def execute_unrecorded(
    prepared: PreparedScenario,
    *,
    zero_state_run: bool = True,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
) -> tuple[Outcome, Run]:
    """Run the scenario without a trace; return its outcome and its rows.

    zero_state_run : whether to make the zero-state run as well; without it no gain is measured,
        and envelope and limits are evaluated on this run alone.

    Raises
    ------
    InputError, ComponentError : see `execute_run`.
    """
    report_progress = progress or silent
    began = time.perf_counter()
    system, events = assembled_system(prepared)
    with ExitStack() as living:
        completed = run_system(
            system, "run", report_progress, engine, living=living, events=events, pace=pace
        )
        beside = None
        if zero_state_run:
            beside = _zero_state_run(prepared, system, completed.run, report_progress, living)
        return _outcome(prepared, system, completed, beside, None, began, pace)[0], completed.run


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
    flush: Callable[[], None] | None = None,
) -> Run | None:
    """Make the zero-state run; None without a design, or after a failed run.

    flush : writes what is recorded to disk, in case slaves must be ended first.
    """
    if prepared.design is None or run.status == "failed":
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
        at_rest, "zero-state run", report_progress, "auto", living=living, events=events
    ).run


def _outcome(
    prepared: PreparedScenario,
    system: System,
    completed: CompletedRun,
    zero_state_run: Run | None,
    trace: Path | None,
    began: float,
    pace: Pace | None,
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
    )
    return outcome, schedules
