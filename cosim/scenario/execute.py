"""Fly a scenario: run, companion run, figures, trace."""

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
from cosim.scenario.assemble import assemble, same_start
from cosim.scenario.assertions import verdicts_of
from cosim.scenario.conduct import Flown, conduct
from cosim.scenario.gain import gain_parameters
from cosim.scenario.identity import identity_of
from cosim.scenario.origin import Findings
from cosim.scenario.outcome import Outcome, result_entries
from cosim.scenario.prepare import Prepared, prepare
from cosim.scenario.script import Event, script_of
from cosim.scenario.verdict import Flight, final_values, metrics_of, status_of
from cosim.trace import TraceWriter, content_hash, result_of_link

__all__ = ["Prepared", "check_room", "fly", "fly_unrecorded", "prepare"]

_Parameters = Mapping[str, Mapping[str, float]]


def fly(
    prepared: Prepared,
    trace: Path | None = None,
    *,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    fsync: bool = False,
) -> Outcome:
    """Run the scenario and its companion from rest; write the trace; then end the slaves.

    An FMU that allows one instance per process is ended before the companion begins.

    `engine` is a matter of speed alone: "python", "compiled", or "auto". `pace` holds the run
    back to the clock on the wall (the companion is not held back); `fsync` as for `TraceWriter`.

    Raises
    ------
    InputError, ComponentError, LossError : what was recorded before is on disk.
    """
    if trace is None:
        return fly_unrecorded(prepared, progress=progress, engine=engine, pace=pace)[0]
    tell = progress or silent
    began = time.perf_counter()
    system, parameters, events = flown_system(prepared)
    check_room(trace)
    try:
        trace.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            "the folder of the trace cannot be made", where=str(trace.parent), got=str(error)
        ) from error
    entries, attachments = identity_of(prepared, system)
    with (
        ExitStack() as living,
        TraceWriter(trace, run=entries, attachments=attachments, fsync=fsync) as writer,
    ):
        recorder = TraceRecorder(writer, system)
        flown = conduct(
            system, "flight", tell, engine, recorder, living=living, events=events, pace=pace
        )
        companion = _companion(prepared, system, flown.run, parameters, tell, living, writer.flush)
        outcome, schedules = _outcome(prepared, system, flown, companion, trace, began, pace)
        links: dict[str, str] = {}
        for name, schedule in schedules.items():
            links |= result_of_link(name, schedule.statistics())
        writer.finish({**result_entries(outcome), **links})
    late = tuple(recorder.log_after_end)
    return replace(outcome, content_hash=content_hash(trace), log_after_end=late)


def fly_unrecorded(
    prepared: Prepared,
    *,
    companion: bool = True,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
) -> tuple[Outcome, Run]:
    """Run the scenario without a trace, for who looks at its rows.

    companion : whether to run it from rest as well; without, no gain is measured, and what is
        said of envelope and limits is about this run alone.

    Raises
    ------
    InputError, ComponentError : see `fly`.
    """
    tell = progress or silent
    began = time.perf_counter()
    system, parameters, events = flown_system(prepared)
    with ExitStack() as living:
        flown = conduct(system, "flight", tell, engine, living=living, events=events, pace=pace)
        beside = None
        if companion:
            beside = _companion(prepared, system, flown.run, parameters, tell, living)
        return _outcome(prepared, system, flown, beside, None, began, pace)[0], flown.run


def check_room(trace: Path) -> None:
    """See that a trace can be written, before anything takes time; makes nothing.

    Raises
    ------
    InputError : its folder, or the nearest one there is, cannot be written.
    """
    nearest = next(folder for folder in trace.absolute().parents if folder.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            "the folder of the trace cannot be written",
            where=str(trace.parent),
            expected=f"{nearest} to be a folder that can be written",
            hint="another place: --out",
        )


def flown_system(prepared: Prepared) -> tuple[System, _Parameters, Sequence[Event]]:
    """What flies, the parameters that its design sets, and what happens on the way."""
    loaded = prepared.loaded
    scenario = loaded.scenario
    parameters = {}
    if scenario.design is not None and prepared.design is not None:
        controller = prepared.fmus[scenario.design.controller]
        parameters[scenario.design.controller] = gain_parameters(prepared.design.K, controller)
    system = assemble(
        scenario,
        prepared.fmus,
        parameters=parameters,
        push=prepared.push,
        origin=loaded.origin,
    )
    findings = Findings(loaded.origin)
    events = script_of(scenario, system, findings)
    verdicts_of(scenario, system, None, findings)
    return system, parameters, events


def _companion(
    prepared: Prepared,
    system: System,
    run: Run,
    parameters: _Parameters,
    tell: Progress,
    living: ExitStack,
    flush: Callable[[], None] | None = None,
) -> Run | None:
    """The same from rest; None where nothing is designed, or there is nothing to compare.

    flush : brings what is recorded to the disk, where slaves must be ended now.
    """
    if prepared.design is None or run.ending == "failed":
        return None
    at_rest = assemble(
        prepared.loaded.scenario,
        prepared.fmus,
        parameters=parameters,
        push=prepared.push,
        at_rest=True,
    )
    # a run that starts from rest is its own companion
    if same_start(system, at_rest):
        return run
    if any(fmu.can_be_instantiated_only_once for fmu in prepared.fmus.values()):
        if flush is not None:
            flush()
        living.close()
    events = script_of(prepared.loaded.scenario, at_rest, Findings())
    return conduct(at_rest, "companion", tell, "auto", living=living, events=events).run


def _outcome(
    prepared: Prepared,
    system: System,
    flown: Flown,
    companion: Run | None,
    trace: Path | None,
    began: float,
    pace: Pace | None,
) -> tuple[Outcome, Mapping[str, PacketSchedule]]:
    scenario, run = prepared.loaded.scenario, flown.run
    schedules = run.schedules
    flight = Flight(
        scenario,
        prepared.problem,
        prepared.design,
        run,
        companion,
        schedules,
        prepared.push,
        system,
        touched=flown.touched,
    )
    outcome = Outcome(
        scenario=prepared.loaded.name,
        title=scenario.title,
        status=status_of(flight),
        reason=run.reason,
        trace=trace,
        content_hash=None,
        steps=max(run.points_ns.size - 1, 0),
        simulated_s=float(run.points_ns[-1]) / 1e9 if run.points_ns.size else 0.0,
        wall_s=time.perf_counter() - began,
        final=final_values(run),
        metrics=metrics_of(flight),
        links={name: s.statistics() for name, s in schedules.items()},
        engine=run.engine,
        pace=pace,
        assertions=verdicts_of(scenario, system, run, Findings(prepared.loaded.origin)),
        design=prepared.source,
    )
    return outcome, schedules
