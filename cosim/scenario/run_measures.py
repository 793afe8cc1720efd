"""What an outcome needs of the rows of a run and of its zero-state run, measured while they go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from cosim.core import Findings
from cosim.master import Connection, Run, System
from cosim.scenario.age import MeasuredAges, measured_ages
from cosim.scenario.applied_commands import commands_known
from cosim.scenario.assertions import assertion_results
from cosim.scenario.coupling import coupling_delays
from cosim.scenario.cut_delays import cut_delays
from cosim.scenario.design_events import DesignEvents
from cosim.scenario.envelope import ENVELOPE, Watch, largest_magnitudes
from cosim.scenario.final_values import last_outputs
from cosim.scenario.gain import observes
from cosim.scenario.guarantee.designed_loop import DesignedLoop, designed_loop
from cosim.scenario.guarantee.measured_noise import measured_noise
from cosim.scenario.guarantee.verdict import (
    fed_back,
)
from cosim.scenario.limits import Saturation, measured_saturation
from cosim.scenario.loss_bursts import loss_bursts
from cosim.scenario.measure import Measure, Measures
from cosim.scenario.measurement_ages import command_age, stamped_ages
from cosim.scenario.outage_measure import OutageFigures, measured_outages
from cosim.scenario.performance import MeasuredGain, measured_gain
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_events import EventCollector
from cosim.scenario.wanted import ALL_FIGURES, Wanted
from cosim.trace.outcome import SERIOUS, AssertionResult, EventCount, EventKind, RunEvent

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

    saturation, largest, outages : as in `RunFigures`.
    gain : measured; None if it could not be.
    energy : of the disturbance and the measurements' noise; None where that is not known.
    """

    saturation: Saturation | None = None
    largest: Mapping[str, float] | None = None
    gain: float | None = None
    outages: OutageFigures | None = None
    energy: float | None = 0.0


@dataclass(frozen=True, kw_only=True)
class RunFigures:
    """What an outcome needs of the rows of its run; what is not wanted is left out.

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

    saturation: Saturation | None = None
    largest: Mapping[str, float] | None = None
    ages: MeasuredAges | None = None
    ages_by_place: Mapping[str, MeasuredAges | None]
    stamped_ages: Mapping[str, MeasuredAges | None] | None = None
    command_age_ns: int | None = None
    commands_known: bool | None = None
    outages: OutageFigures | None = None
    last_outputs: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    coupling_delays_s: Mapping[str, float] = field(default_factory=dict)
    cut_delays_s: Mapping[Connection, float] = field(default_factory=dict)
    assertions: tuple[AssertionResult, ...]
    events: tuple[EventCount, ...]


class _Figures(Measures):
    """Measures of a run by the figures that they give, of which some are not wanted: None."""

    def __init__(
        self, figures: Mapping[str, Measure[Any] | None], *more: Measure[Any], at_once: bool = False
    ) -> None:
        self._by_figure = {name: each for name, each in figures.items() if each is not None}
        super().__init__([*self._by_figure.values(), *more], at_once=at_once)

    def results(self, run: Run) -> dict[str, Any]:
        """Return the figures at the end of the run."""
        self.complete(run)
        return {name: each.result(run) for name, each in self._by_figure.items()}


class ZeroStateMeasures(_Figures):
    """What an outcome needs of the zero-state run, measured while it goes.

    Parameters
    ----------
    noise : of the measurements of an observer, if it is measured already.
    """

    def __init__(self, prepared: PreparedScenario, noise: Measure[Any] | None = None) -> None:
        part, problem, design = prepared.loaded.scenario.design, prepared.problem, prepared.design
        own_noise = gain = None
        if part is not None and problem is not None:
            loop = None if noise is not None else loop_of(prepared)
            if loop is not None and observes(design):
                noise = own_noise = measured_noise(loop, design, problem.plant)
            gain = measured_gain(part.plant, problem.system, problem.plant, noise)
        figures: dict[str, Measure[Any] | None] = {
            "saturation": None if part is None else measured_saturation(part.controller),
            "largest": _envelope_measure(prepared),
            "gain": gain,
            "outages": _outage_measure(prepared),
        }
        super().__init__(figures, *(() if own_noise is None else (own_noise,)))

    def figures(self, run: Run) -> ZeroStateFigures:
        """Return them at the end of the run."""
        results = self.results(run)
        gain, energy = results.pop("gain", MeasuredGain())
        return ZeroStateFigures(gain=gain, energy=energy, **results)


class RunMeasures(_Figures):
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
            name: measured_saturation(name, self._collector)
            for name in system.components
            if wanted.has("events") or (part is not None and name == part.controller)
        }
        aged = part is not None and wanted.has("events", *_OF_AGE)
        envelope = wanted.has("events", "metrics.envelope_use", *OF_GUARANTEE)
        final = wanted.has("final", "metrics.position_error_m")
        coupled = wanted.has(*OF_COUPLING)
        self._by_place = _ages_by_place(prepared) if aged else {}
        # events of one instant are logged in this order
        figures: dict[str, Measure[Any] | None] = {
            "saturation": None if part is None else commands.pop(part.controller),
            "largest": _envelope_measure(prepared, self._events.envelope) if envelope else None,
            **(_age_measures(prepared, self._events) if aged else {}),
            "last_outputs": last_outputs() if final else None,
            "coupling_delays_s": coupling_delays(system) if coupled else None,
            "cut_delays_s": cut_delays(system) if coupled else None,
            "assertions": assertion_results(
                scenario, system, Findings(prepared.loaded.origin), self._collector
            ),
            "loss": loss_bursts(system, self._collector) if wanted.has("events") else None,
        }
        others: list[Measure[Any]] = [*self._by_place.values(), *commands.values()]
        super().__init__(figures, *others, at_once=at_once)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Count warnings of components, failures, outages, and events of the scenario."""
        kinds: dict[str, EventKind] = {"scenario": "scenario", "master": "failure"}
        kinds |= dict.fromkeys(self._modes, "scenario")
        kind = kinds.get(name, "outage" if name in self._links else "warning")
        if level in SERIOUS or kind == "scenario":
            self._collector.count(RunEvent(time_ns, level, kind, name, message))

    def figures(self, run: Run) -> RunFigures:
        """Return them at the end of the run."""
        results = self.results(run)
        results.pop("loss", None)  # its events are counted
        self._collector.close(run.end_ns)
        by_place = {name: ages.result(run) for name, ages in self._by_place.items()}
        return RunFigures(events=self._collector.counts(), ages_by_place=by_place, **results)


def loop_of(prepared: PreparedScenario) -> DesignedLoop | None:
    """Return the loop that the design is about; None without a design."""
    part, design, problem = prepared.loaded.scenario.design, prepared.design, prepared.problem
    if part is None or design is None or problem is None:
        return None
    return designed_loop(design, problem, part.plant, part.controller, prepared.fmus[part.plant])


def _age_measures(
    prepared: PreparedScenario, events: DesignEvents
) -> dict[str, Measure[Any] | None]:
    """Return the measures of ages, and of what depends on them, of a run with a design."""
    scenario, problem, design = prepared.loaded.scenario, prepared.problem, prepared.design
    part = scenario.design
    if part is None:
        return {}
    commands = command_age(part.controller, part.plant)
    if observes(design):
        names = [each.name for each in design.measurements]
        plant = None if problem is None else problem.plant
        return {
            "stamped_ages": stamped_ages(part.controller, names, events.stamped),
            "command_age_ns": commands,
            "commands_known": commands_known(part.controller, part.plant, design.system, plant),
        }
    integral = problem is not None and problem.system.integrals
    ages = measured_ages(part.plant, part.controller, scenario.run.algorithm, events.age)
    return {
        "ages": ages,
        "outages": _outage_measure(prepared, events.collector),
        "command_age_ns": commands if integral else None,
    }


def _ages_by_place(prepared: PreparedScenario) -> dict[str, Measure[MeasuredAges | None]]:
    """Return measures of states that are fed back with ages of their own; none where all are."""
    part, design, loop = prepared.loaded.scenario.design, prepared.design, loop_of(prepared)
    if part is None or design is None or loop is None or observes(design):
        return {}
    each = fed_back(design, loop)
    of = partial(measured_ages, part.plant, part.controller, prepared.loaded.scenario.run.algorithm)
    return {age.place: of(states=own) for age, own in (each if len(each) > 1 else ()) if own}


def _envelope_measure(
    prepared: PreparedScenario, watch: Watch | None = None
) -> Measure[dict[str, float]] | None:
    part, problem = prepared.loaded.scenario.design, prepared.problem
    if problem is None or part is None:
        return None
    if problem.plant is not None and problem.plant.envelope:
        centres = [centre for centre, _ in problem.plant.envelope.values()]
        return largest_magnitudes(part.plant, list(problem.plant.envelope), watch, centres)
    if problem.vehicle is None:
        return None
    return largest_magnitudes(part.plant, list(ENVELOPE.values()), watch)


def _outage_measure(
    prepared: PreparedScenario, collector: EventCollector | None = None
) -> Measure[OutageFigures | None] | None:
    """Return the measure of a run; None without a proof across outages."""
    scenario, problem, design = prepared.loaded.scenario, prepared.problem, prepared.design
    part = scenario.design
    if part is None or problem is None or design is None or observes(design):
        return None
    if design.guarantees.outages is None:
        return None
    return measured_outages(
        *(part.plant, part.controller, scenario.run.algorithm, design, problem.plant),
        scenario.run.end,
        set_points=scenario.reference is not None,
        collector=collector,
    )
