"""Fly a scenario: gain, FMUs, run, companion run, figures, trace."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.fmu import FmuDescription
from cosim.hinf import Design, WorstCase
from cosim.master import (
    EngineName,
    Observer,
    Run,
    System,
    TraceRecorder,
    simulate,
)
from cosim.network import PacketSchedule
from cosim.scenario.assemble import Hangar, assemble, find_fmus, same_start
from cosim.scenario.gain import Problem, gain_parameters, problem_of, solve
from cosim.scenario.identity import identity_of
from cosim.scenario.interrupt import Interruptible
from cosim.scenario.outcome import Outcome, result_entries
from cosim.scenario.read import LoadedScenario
from cosim.scenario.signals import blank_push, worst_case_of
from cosim.scenario.verdict import Flight, final_values, metrics_of, status_of
from cosim.trace import TraceWriter, content_hash, result_of_link

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done."""


@dataclass(frozen=True)
class Prepared:
    """A scenario with everything found that it needs, before anything runs."""

    loaded: LoadedScenario
    fmus: Mapping[str, FmuDescription]
    problem: Problem | None
    design: Design | None
    push: WorstCase | None = None


def prepare(
    loaded: LoadedScenario,
    hangar: Hangar,
    *,
    saved: tuple[Problem, Design] | None = None,
    progress: Progress | None = None,
) -> Prepared:
    """Find or build the FMUs and make the gain, unless a `saved` one is given.

    Raises
    ------
    InputError, NotAchievableError : see `assemble`, `gain` and `signals`.
    """
    tell = progress or _silent
    tell("FMUs", 0.0)
    fmus = find_fmus(loaded.scenario, hangar)
    part, disturbance = loaded.scenario.design, loaded.scenario.disturbance
    if part is None:
        if disturbance is not None:
            raise InputError(
                "a worst case is that of a design, and this scenario has none",
                where="disturbance",
                expected="[design]",
                hint="a wave field as a component needs no design",
            )
        return Prepared(loaded, fmus, None, None)
    for role, name in (("controller", part.controller), ("plant", part.plant)):
        if name not in fmus:
            raise InputError.unknown("component", name, fmus, where=f"design.{role}")
    # fit everything together before the design, which takes longest: what cannot run says so
    problem = problem_of(part, loaded.folder) if saved is None else saved[0]
    blank = gain_parameters(np.zeros(problem.system.B.T.shape), fmus[part.controller])
    still = None if disturbance is None else blank_push(problem.system)
    assemble(loaded.scenario, fmus, parameters={part.controller: blank}, push=still)
    tell("design", 0.0)
    found = solve(problem, part.gain, part.order) if saved is None else saved[1]
    push = None if disturbance is None else worst_case_of(disturbance, found)
    return Prepared(loaded, fmus, problem, found, push)


def fly(
    prepared: Prepared,
    trace: Path | None = None,
    *,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    fsync: bool = False,
) -> Outcome:
    """Run the scenario and its companion from rest; write the trace.

    `engine` is a matter of speed alone: "python", "compiled", or "auto"; `fsync` as for
    `TraceWriter`.

    Raises
    ------
    InputError, ComponentError, LossError : what was recorded before is on disk.
    """
    if trace is None:
        return fly_unrecorded(prepared, progress=progress, engine=engine)[0]
    tell = progress or _silent
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
    with TraceWriter(trace, run=entries, attachments=attachments, fsync=fsync) as writer:
        run = _simulate(system, "flight", tell, engine, TraceRecorder(writer, system))
        companion = _companion(prepared, system, run, parameters, tell)
        outcome, schedules = _outcome(prepared, run, companion, trace, began)
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
) -> tuple[Outcome, Run]:
    """Run the scenario without a trace, for who looks at its rows.

    companion : whether to run it from rest as well; without, no gain is measured, and what is
        said of envelope and limits is about this run alone.

    Raises
    ------
    InputError, ComponentError : see `fly`.
    """
    tell = progress or _silent
    began = time.perf_counter()
    system, parameters = _flown_system(prepared)
    run = _simulate(system, "flight", tell, engine)
    beside = _companion(prepared, system, run, parameters, tell) if companion else None
    return _outcome(prepared, run, beside, None, began)[0], run


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


_Parameters = Mapping[str, Mapping[str, float]]


def _flown_system(prepared: Prepared) -> tuple[System, _Parameters]:
    """What flies, and the parameters that its design sets."""
    scenario = prepared.loaded.scenario
    parameters = {}
    if scenario.design is not None and prepared.design is not None:
        controller = prepared.fmus[scenario.design.controller]
        parameters[scenario.design.controller] = gain_parameters(prepared.design.K, controller)
    system = assemble(scenario, prepared.fmus, parameters=parameters, push=prepared.push)
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
    return run if same_start(system, at_rest) else _simulate(at_rest, "companion", tell, "auto")


def _outcome(
    prepared: Prepared,
    run: Run,
    companion: Run | None,
    trace: Path | None,
    began: float,
) -> tuple[Outcome, Mapping[str, PacketSchedule]]:
    scenario = prepared.loaded.scenario
    schedules = run.schedules
    flight = Flight(
        scenario, prepared.problem, prepared.design, run, companion, schedules, prepared.push
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
    )
    return outcome, schedules


def _simulate(
    system: System, what: str, tell: Progress, engine: EngineName, *observers: Observer
) -> Run:
    """A run that says how far it is and can be interrupted between two steps."""
    with Interruptible() as wish:
        watcher = _Watcher(system, lambda share: tell(what, share), wish)
        return simulate(system, [*observers, watcher], engine=engine)


def _silent(_what: str, _share: float) -> None:
    """No progress asked for."""


class _Watcher(Observer):
    """Reports how far a run has come, and ends it on request."""

    def __init__(self, system: System, tell: Callable[[float], None], wish: Interruptible) -> None:
        self._wish = wish
        self._points = system.timetable.points_ns.size
        self._tell = tell

    def begin(self, stations: Sequence[Any]) -> None:
        del stations
        self._tell(0.0)

    def span(self, first: int, last: int) -> None:
        del first
        self._wish.obey()
        self._tell(last / self._points)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Log lines go to the trace; nothing to do here."""
