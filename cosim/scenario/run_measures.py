"""What an outcome needs of the rows of a run and of its zero-state run, measured while they go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import Findings
from cosim.master import Connection, Run, System
from cosim.scenario.age import AgeMeasure, MeasuredAges
from cosim.scenario.applied_commands import AppliedCommands
from cosim.scenario.assertions import AssertionsMeasure
from cosim.scenario.coupling import CouplingMeasure
from cosim.scenario.cut_delays import CutMeasure
from cosim.scenario.design_events import DesignEvents
from cosim.scenario.envelope import ENVELOPE, LargestMagnitudes
from cosim.scenario.final_values import LastOutputs
from cosim.scenario.gain import observes
from cosim.scenario.guarantee.designed_loop import DesignedLoop, designed_loop
from cosim.scenario.guarantee.measured_noise import NoiseMeasure
from cosim.scenario.guarantee.observer_rows import ObserverRows
from cosim.scenario.guarantee.verdict import (
    fed_back,
)
from cosim.scenario.limits import Saturation, SaturationMeasure
from cosim.scenario.loss_bursts import LossBursts
from cosim.scenario.measure import Measure, Measures
from cosim.scenario.measurement_ages import CommandAge, StampedAges
from cosim.scenario.outage_measure import OutageFigures, OutageMeasure, both
from cosim.scenario.performance import GainMeasure
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_events import EventCollector
from cosim.scenario.wanted import ALL_FIGURES, Wanted
from cosim.trace import SERIOUS, AssertionResult, EventCount, EventKind, RunEvent

OF_GUARANTEE = tuple(
    f"metrics.{name}"
    for name in (
        "assumptions",
        "departures",
        "guarantee_claimed",
        "facts",
        "disturbed",
        "state_growth",
    )
)
"""Metrics for which all that a guarantee assumes is measured."""
_OF_AGE = (
    *("metrics.message_age_s", "metrics.feedback_age", "metrics.measurement_ages"),
    *("metrics.outages", *OF_GUARANTEE),
)
OF_COUPLING = tuple(
    f"metrics.{name}" for name in ("coupling_delay_s", "coupling_delays_s", "cut_connections")
)
"""Metrics for which ages, and delays of the coupling, are measured."""


@dataclass(frozen=True)
class ZeroStateFigures:
    """What an outcome needs of the zero-state run.

    saturation, largest : as in `RunFigures`.
    gain : measured; None if it could not be.
    energy : of the disturbance and the measurements' noise; None where that is not known.
    outages : as in `RunFigures`.
    """

    saturation: Saturation | None
    largest: Mapping[str, float] | None
    gain: float | None
    outages: OutageFigures | None
    energy: float | None = 0.0


@dataclass(frozen=True)
class RunFigures:
    """What an outcome needs of the rows of its run.

    Attributes
    ----------
    saturation : of the commands; None without a controller that has limits.
    largest : of the signals that the envelope bounds, by their names; None without one.
    ages : of the measurements in use; None without one.
    ages_by_place : the same of states that are fed back with an age of their own.
    stamped_ages : of the measurements that carry stamps, by name; None without an observer.
    command_age_ns : the greatest age of an observer's command in use; None without one.
    commands_known : whether the observer knew what acted; None without one.
    outages : what is proved across outages; None without such a proof.
    last_outputs : by component and output.
    coupling_delays_s, cut_delays_s : by connection.
    assertions : the verdicts.
    events : what happened during the run, and how often.
    """

    saturation: Saturation | None
    largest: Mapping[str, float] | None
    ages: MeasuredAges | None
    ages_by_place: Mapping[str, MeasuredAges | None]
    stamped_ages: Mapping[str, MeasuredAges | None] | None
    command_age_ns: int | None
    commands_known: bool | None
    outages: OutageFigures | None
    last_outputs: Mapping[str, Mapping[str, float]]
    coupling_delays_s: Mapping[str, float]
    cut_delays_s: Mapping[Connection, float]
    assertions: tuple[AssertionResult, ...]
    events: tuple[EventCount, ...]


class ZeroStateMeasures(Measures):
    """What an outcome needs of the zero-state run, measured while it goes.

    Parameters
    ----------
    noise : of the measurements of an observer, if it is measured already.
    """

    def __init__(self, prepared: PreparedScenario, noise: NoiseMeasure | None = None) -> None:
        part, own_noise = prepared.loaded.scenario.design, None
        self._saturation = None if part is None else SaturationMeasure(part.controller)
        self._largest = _envelope_measure(prepared)
        self._gain = None
        if part is not None and prepared.problem is not None:
            design, problem = prepared.design, prepared.problem
            loop = None if noise is not None else loop_of(prepared)
            if loop is not None and observes(design):
                rows = ObserverRows(loop, design)
                ends = part.controller, part.plant
                noise = own_noise = NoiseMeasure(*ends, design, rows, problem.plant)
            self._gain = GainMeasure(part.plant, problem.system, problem.plant, noise)
        self._outages, aged = _outage_measure(prepared), None
        if self._outages is not None and part is not None:
            algorithm = prepared.loaded.scenario.run.algorithm
            aged = AgeMeasure(part.plant, part.controller, algorithm, self._outages.age)
        found = (self._saturation, self._largest, self._gain, aged, self._outages, own_noise)
        super().__init__(_made(*found))

    def figures(self, run: Run) -> ZeroStateFigures:
        """Return them at the end of the run."""
        self.complete(run)
        return ZeroStateFigures(
            saturation=None if self._saturation is None else self._saturation.result(run),
            largest=None if self._largest is None else self._largest.result(run),
            gain=None if self._gain is None else self._gain.result(run),
            outages=None if self._outages is None else self._outages.result(run),
            energy=0.0 if self._gain is None else self._gain.energy_in,
        )


class RunMeasures(Measures):
    """What an outcome needs of its run, measured while it goes."""

    def __init__(
        self,
        prepared: PreparedScenario,
        system: System,
        collector: EventCollector | None = None,
        *,
        at_once: bool = False,
        wanted: Wanted = ALL_FIGURES,
    ) -> None:
        scenario = prepared.loaded.scenario
        part = scenario.design
        self._events = DesignEvents(
            prepared, collector or EventCollector(system.comm_schedule.start_ns)
        )
        self._collector, self._links = self._events.collector, frozenset(system.links)
        self._modes = frozenset(system.modes)
        commands = {
            name: SaturationMeasure(name, self._collector)
            for name in system.components
            if wanted.has("events") or (part is not None and name == part.controller)
        }
        self._saturation = None if part is None else commands[part.controller]
        self._largest = self._age = self._last_outputs = self._coupling = self._cut = None
        self._stamped = self._commands = self._applied = self._outages = None
        self._by_place: dict[str, AgeMeasure] = {}
        if wanted.has("events", "metrics.envelope_use", *OF_GUARANTEE):
            self._largest = _envelope_measure(prepared, self._events.envelope)
        aged = part is not None and wanted.has("events", *_OF_AGE)
        if part is not None and aged and observes(prepared.design):
            names = [each.name for each in prepared.design.measurements]
            self._stamped = StampedAges(part.controller, names, self._events.stamped)
            self._commands = CommandAge(part.controller, part.plant)
            plant = None if prepared.problem is None else prepared.problem.plant
            self._applied = AppliedCommands(
                part.controller, part.plant, prepared.design.system, plant
            )
        elif part is not None and aged:
            self._outages = _outage_measure(prepared, self._collector)
            watch = both(self._events.age, None if self._outages is None else self._outages.age)
            self._age = AgeMeasure(part.plant, part.controller, scenario.run.algorithm, watch)
            self._by_place = _ages_by_place(prepared)
            if prepared.problem is not None and prepared.problem.system.integrals:
                self._commands = CommandAge(part.controller, part.plant)
        if wanted.has("final", "metrics.position_error_m"):
            self._last_outputs = LastOutputs()
        if wanted.has(*OF_COUPLING):
            self._coupling, self._cut = CouplingMeasure(system), CutMeasure(system)
        self._assertions = AssertionsMeasure(
            scenario, system, Findings(prepared.loaded.origin), self._collector
        )
        self._loss = LossBursts(system, self._collector) if wanted.has("events") else None
        self._others = [m for m in commands.values() if m is not self._saturation]
        found = (self._saturation, self._largest, self._age, self._last_outputs, self._coupling)
        last = _made(
            *(self._outages, self._stamped, self._commands, self._applied),
            *(self._cut, self._assertions, self._loss),
            *self._by_place.values(),
        )
        super().__init__([*_made(*found), *last, *self._others], at_once=at_once)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Count warnings of components, failures, outages, and events of the scenario."""
        kinds: dict[str, EventKind] = {"scenario": "scenario", "master": "failure"}
        kinds |= dict.fromkeys(self._modes, "scenario")
        kind = kinds.get(name, "outage" if name in self._links else "warning")
        if level in SERIOUS or kind == "scenario":
            self._collector.count(RunEvent(time_ns, level, kind, name, message))

    def figures(self, run: Run) -> RunFigures:
        """Return them at the end of the run."""
        self.complete(run)
        self._events.close(run.end_ns)
        for measure in _made(self._loss, *self._others):
            measure.result(run)
        return RunFigures(
            saturation=None if self._saturation is None else self._saturation.result(run),
            largest=None if self._largest is None else self._largest.result(run),
            ages=None if self._age is None else self._age.result(run),
            ages_by_place={name: age.result(run) for name, age in self._by_place.items()},
            stamped_ages=None if self._stamped is None else self._stamped.result(run),
            command_age_ns=None if self._commands is None else self._commands.result(run),
            commands_known=None if self._applied is None else self._applied.result(run),
            outages=None if self._outages is None else self._outages.result(run),
            last_outputs={} if self._last_outputs is None else self._last_outputs.result(run),
            coupling_delays_s={} if self._coupling is None else self._coupling.result(run),
            cut_delays_s={} if self._cut is None else self._cut.result(run),
            assertions=self._assertions.result(run),
            events=self._collector.counts(),
        )


def loop_of(prepared: PreparedScenario) -> DesignedLoop | None:
    """Return the loop that the design is about; None without a design."""
    part, design, problem = prepared.loaded.scenario.design, prepared.design, prepared.problem
    if part is None or design is None or problem is None:
        return None
    return designed_loop(design, problem, part.plant, part.controller, prepared.fmus[part.plant])


def _ages_by_place(prepared: PreparedScenario) -> dict[str, AgeMeasure]:
    """Return measures of states that are fed back with ages of their own; none where all are."""
    part, design, loop = prepared.loaded.scenario.design, prepared.design, loop_of(prepared)
    if part is None or design is None or loop is None or observes(design):
        return {}
    each = fed_back(design, loop)
    algorithm = prepared.loaded.scenario.run.algorithm
    return {
        age.place: AgeMeasure(part.plant, part.controller, algorithm, states=own)
        for age, own in (each if len(each) > 1 else ())
        if own
    }


def _envelope_measure(
    prepared: PreparedScenario,
    watch: Callable[[NDArray[np.int64], NDArray[np.float64]], None] | None = None,
) -> LargestMagnitudes | None:
    part = prepared.loaded.scenario.design
    problem = prepared.problem
    if problem is None or part is None:
        return None
    if problem.plant is not None and problem.plant.envelope:
        centres = [centre for centre, _ in problem.plant.envelope.values()]
        return LargestMagnitudes(part.plant, list(problem.plant.envelope), watch, centres)
    if problem.vehicle is None:
        return None
    return LargestMagnitudes(part.plant, list(ENVELOPE.values()), watch)


def _outage_measure(
    prepared: PreparedScenario, collector: EventCollector | None = None
) -> OutageMeasure | None:
    """Return the measure of a run; None without a proof across outages."""
    scenario, problem, design = prepared.loaded.scenario, prepared.problem, prepared.design
    part = scenario.design
    if part is None or problem is None or design is None or observes(design):
        return None
    if design.guarantees.outages is None:
        return None
    return OutageMeasure(
        part.plant,
        design,
        problem.plant,
        scenario.run.end,
        set_points=scenario.reference is not None,
        collector=collector,
    )


def _made(*measures: Measure[Any] | None) -> list[Measure[Any]]:
    return [measure for measure in measures if measure is not None]
