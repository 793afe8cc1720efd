"""Fly a scenario: run, companion run, figures, trace."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cosim.errors import InputError
from cosim.master import EngineName, Pace, Run, System, TraceRecorder
from cosim.network import PacketSchedule
from cosim.scenario.assemble import assemble, same_start
from cosim.scenario.conduct import conduct
from cosim.scenario.gain import gain_parameters
from cosim.scenario.identity import identity_of
from cosim.scenario.outcome import Outcome, result_entries
from cosim.scenario.prepare import Prepared, Progress, prepare, silent
from cosim.scenario.verdict import Flight, final_values, metrics_of, status_of
from cosim.trace import TraceWriter, content_hash, result_of_link

__all__ = ["Prepared", "Progress", "check_room", "fly", "fly_unrecorded", "prepare"]

_Parameters = Mapping[str, Mapping[str, float]]


def fly(
    prepared: Prepared,
    trace: Path | None = None,
    *,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
) -> Outcome:
    """Run the scenario and its companion from rest; write the trace.

    `engine` is a matter of speed alone: "python", "compiled", or "auto". `pace` holds the run
    back to the clock on the wall (the companion is not held back).

    Raises
    ------
    InputError, ComponentError, LossError : what was recorded before is on disk.
    """
    if trace is None:
        return fly_unrecorded(prepared, progress=progress, engine=engine, pace=pace)[0]
    tell = progress or silent
    began = time.perf_counter()
    system, parameters = _flown_system(prepared)
    check_room(trace)
    try:
        trace.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            "the folder of the trace cannot be made", where=str(trace.parent), got=str(error)
        ) from error
    entries, attachments = identity_of(prepared, system)
    with TraceWriter(trace, run=entries, attachments=attachments) as writer:
        run = conduct(system, "flight", tell, engine, TraceRecorder(writer, system), pace=pace)
        companion = _companion(prepared, system, run, parameters, tell)
        outcome, schedules = _outcome(prepared, system, run, companion, trace, began, pace)
        links: dict[str, str] = {}
        for name, schedule in schedules.items():
            links |= result_of_link(name, schedule.statistics())
        writer.finish({**result_entries(outcome), **links})
    return replace(outcome, content_hash=content_hash(trace))


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
    system, parameters = _flown_system(prepared)
    run = conduct(system, "flight", tell, engine, pace=pace)
    beside = _companion(prepared, system, run, parameters, tell) if companion else None
    return _outcome(prepared, system, run, beside, None, began, pace)[0], run


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


def _flown_system(prepared: Prepared) -> tuple[System, _Parameters]:
    """What flies, and the parameters that its design sets."""
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
    return system, parameters


def _companion(
    prepared: Prepared, system: System, run: Run, parameters: _Parameters, tell: Progress
) -> Run | None:
    """The same from rest; None where nothing is designed, or there is nothing to compare."""
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
    return run if same_start(system, at_rest) else conduct(at_rest, "companion", tell, "auto")


def _outcome(
    prepared: Prepared,
    system: System,
    run: Run,
    companion: Run | None,
    trace: Path | None,
    began: float,
    pace: Pace | None,
) -> tuple[Outcome, Mapping[str, PacketSchedule]]:
    scenario = prepared.loaded.scenario
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
    )
    return outcome, schedules
