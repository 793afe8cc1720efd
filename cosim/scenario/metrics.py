"""Status and metrics of a run, and the assumptions of its guarantee.

They are made of measures that watch the run, and its zero-state run. The guarantee applies to a
run only if all its assumptions were met; each is always listed by name, true or false.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import Connection, Run, System
from cosim.models import total
from cosim.scenario.age import AgeMeasure, MeasuredAges
from cosim.scenario.age_claim import age_figures, feedback_of, measurement_age_figures
from cosim.scenario.applied_commands import AppliedCommands
from cosim.scenario.assertions import AssertionsMeasure
from cosim.scenario.coupling import CouplingMeasure
from cosim.scenario.cut_delays import CutMeasure
from cosim.scenario.design_events import DesignEvents
from cosim.scenario.envelope import ENVELOPE, LargestMagnitudes, envelope_bounds
from cosim.scenario.feedback_age import FeedbackAge, feedback_age
from cosim.scenario.final_values import LastOutputs
from cosim.scenario.gain import Problem, observes
from cosim.scenario.guarantee.ages import of_commands
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import designed_loop
from cosim.scenario.guarantee.facts import facts_json, facts_of_run
from cosim.scenario.guarantee.law_measures import MeasuredLaw
from cosim.scenario.guarantee.measured_noise import NoiseMeasure
from cosim.scenario.guarantee.verdict import (
    LoopOfRun,
    MeasuredRun,
    fed_back,
    findings_of,
)
from cosim.scenario.limits import Saturation, SaturationMeasure
from cosim.scenario.loss_bursts import LossBursts
from cosim.scenario.matching import endpoint
from cosim.scenario.measure import Measure, Measures
from cosim.scenario.measurement_ages import CommandAge, PacketsInUse, StampedAges
from cosim.scenario.origin import Findings
from cosim.scenario.outage_measure import OutageFigures, OutageMeasure, both, outage_figures
from cosim.scenario.performance import GainMeasure
from cosim.scenario.plant import differences_json
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_events import EventCollector
from cosim.scenario.schema import PathPart, Scenario
from cosim.scenario.wanted import ALL_FIGURES, Wanted
from cosim.trace import SERIOUS, AssertionResult, EventCount, EventKind, RunEvent

if TYPE_CHECKING:
    from cosim.scenario.gain import AnyDesign

_POSITION = ("eta.x", "eta.y", "eta.z")
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
_OF_COUPLING = tuple(
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
            if observes(design) and noise is None:
                packets = PacketsInUse([one.name for one in design.measurements])
                ends = part.controller, part.plant
                noise = own_noise = NoiseMeasure(*ends, design, packets, problem.plant)
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
        if wanted.has(*_OF_COUPLING):
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


def _ages_by_place(prepared: PreparedScenario) -> dict[str, AgeMeasure]:
    """Return measures of states that are fed back with ages of their own; none where all are."""
    part, problem, design = prepared.loaded.scenario.design, prepared.problem, prepared.design
    if part is None or problem is None or design is None or observes(design):
        return {}
    loop = designed_loop(design, problem, part.plant, part.controller, prepared.fmus[part.plant])
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


@dataclass(frozen=True)
class RunContext:
    """A run with everything its metrics depend on.

    figures : of the run.
    zero_state : figures of its zero-state run; None if that was not made.
    links : statistics of the packet links.
    worst_case : of the design; None if the scenario does not apply it.
    altered : what events changed but the traffic of links.
    compared : the loop of the run beside that of the design; None without a design.
    laws : what was measured of the law of the run, and of its zero-state run if that is another.
    """

    scenario: Scenario
    problem: Problem | None
    design: AnyDesign | None
    system: System
    run: Run
    figures: RunFigures
    zero_state: ZeroStateFigures | None
    links: Mapping[str, Mapping[str, Any]]
    worst_case: hinf.WorstCase | None = None
    altered: Sequence[str] = ()
    compared: LoopOfRun | None = None
    laws: Mapping[str, MeasuredLaw] = field(default_factory=dict)

    @cached_property
    def known_age(self) -> FeedbackAge | None:
        """What the settings of the scenario say of the age of the feedback."""
        part = self.scenario.design
        if part is None:
            return None
        return feedback_age(self.system, part.plant, part.controller)

    @cached_property
    def findings(self) -> dict[str, list[Departure]]:
        """Every assumption of the guarantee, with why it was not met; empty without one."""
        if self.design is None or self.problem is None or self.compared is None:
            return {}
        figures, beside = self.figures, self.zero_state
        ages = dict(figures.stamped_ages or figures.ages_by_place)
        if figures.stamped_ages is None and not ages:
            ages = {"the feedback": figures.ages}
        step = self.system.comm_schedule.step_ns
        ages["the integrals"] = of_commands(figures.command_age_ns, step)
        used, at_rest = figures.saturation, None if beside is None else beside.saturation
        reached = None if used is None else used.fraction != 0.0
        if reached is False and at_rest is not None:
            reached = at_rest.fraction != 0.0
        measured = MeasuredRun(
            laws=_left(self.laws),
            ages=ages,
            command_age_ns=figures.command_age_ns,
            commands_known=figures.commands_known,
            substituted=any(link["substitutions"] for link in self.links.values()),
            envelope_use=_envelope_use(self),
            limits_reached=reached,
            altered=self.altered,
        )
        return findings_of(self.design, self.compared, measured, self._proved_again())

    def _proved_again(self) -> str:
        """Return what proves a design of constant ages for those that a run has."""
        part = self.scenario.design
        if self.design is None or part is None:
            return ""
        ages = [self.figures.command_age_ns or 0, *(_greatest_ns(self.figures.ages),)]
        where = part.file or f"{self.scenario.title}.design.json"
        hold = max(ages) / 1e9 or None
        command = hinf.reproving_command(self.design.certificate, where, hold=hold)
        return "" if command is None else f"proved anew by: {command}"

    @property
    def age_s(self) -> float | None:
        """The greatest age of a measurement in use [s]; None if none came into use."""
        ages = self.figures.ages
        return None if ages is None else ages.greatest_ns / 1e9

    @property
    def gain(self) -> float | None:
        """The gain that the zero-state run measured."""
        return None if self.zero_state is None else self.zero_state.gain


def _greatest_ns(ages: MeasuredAges | None) -> int:
    return 0 if ages is None else ages.greatest_ns


def _left(laws: Mapping[str, MeasuredLaw]) -> dict[str, list[Departure]]:
    """Return by assumption where runs left their law."""
    found: dict[str, list[Departure]] = {}
    for run, law in laws.items():
        for name, departures in law.departures.items():
            named = departures
            if run != "run":
                named = [one._replace(got=f"{one.got}, in the {run}") for one in departures]
            found.setdefault(name, []).extend(named)
    return found


def status_of(context: RunContext) -> str:
    """Return the status: finished, limit_cycle, stopped, diverged or failed."""
    if context.run.status != "finished":
        return context.run.status
    used = context.figures.saturation
    return "limit_cycle" if used is not None and used.limit_cycle else "finished"


def metrics_of(context: RunContext, wanted: Wanted = ALL_FIGURES) -> dict[str, Any]:
    """Return the metrics of a run, JSON-safe: None for what does not exist."""
    found = {
        name: metric(context) for name, metric in _METRICS.items() if wanted.has(f"metrics.{name}")
    }
    if wanted.has(*_OF_COUPLING):
        found |= _coupling(context)
    if context.system.modes and wanted.has("metrics.modes"):
        found["modes"] = _modes(context)
    if observes(context.design) and wanted.has("metrics.measurement_ages"):
        found["measurement_ages"] = measurement_age_figures(
            context.design, context.figures.stamped_ages or {}, context.figures.command_age_ns
        )
    proved = _outages_proved(context)
    if proved is not None and wanted.has("metrics.outages"):
        at_rest = None if context.zero_state is None else context.zero_state.outages
        found["outages"] = outage_figures(proved, context.figures.outages, at_rest)
    if wanted.has(*OF_GUARANTEE):
        found |= _assumptions(context)
    return found


def _assumptions(context: RunContext) -> dict[str, Any]:
    """Return whether each assumption was met, and by name and place what was not as designed."""
    found = context.findings
    named: dict[str, Any] = {"assumptions": {name: not each for name, each in found.items()}}
    if found:
        named["guarantee_claimed"] = not any(found.values())
    if departures := [
        {"assumption": name, **one.to_json()} for name, each in found.items() for one in each
    ]:
        named["departures"] = departures
    named |= _facts(context)
    if context.compared is not None and found:
        apart = [
            each
            for component, different in context.compared.differences.items()
            for each in differences_json(component, different)
        ]
        if apart:
            named["plant_differences"] = apart
    return named


def _facts(context: RunContext) -> dict[str, Any]:
    """Return the facts under the verdict, and how the state grew where nothing drove it."""
    design, problem, compared = context.design, context.problem, context.compared
    law = context.laws.get("run")
    if design is None or problem is None or compared is None or law is None:
        return {}
    at_rest = context.laws.get("zero-state run", law)
    beside, share = context.zero_state, None
    if beside is not None and beside.energy and at_rest.noise_energy is not None:
        share = at_rest.noise_energy / beside.energy
    disturbed = beside is None or beside.energy != 0.0 or bool(context.altered)
    facts = facts_of_run(
        *(design, problem, context.system, compared.wiring, law.motion, context.gain, share),
        disturbed=disturbed,
    )
    found: dict[str, Any] = {"facts": facts_json(facts), "disturbed": disturbed}
    if law.motion is not None and not law.motion.driven and not context.altered:
        found["state_growth"] = law.motion.growth
    return found


def _modes(context: RunContext) -> dict[str, Any]:
    """Return by mode machine the state at the end, how often it changed, and the time in each."""
    run, found = context.run, {}
    for machine, (states, _) in context.system.modes.items():
        times, numbers = run.instances[0].comm_points.event_values.changes(machine)
        times, numbers = times[times <= run.end_ns], numbers[times <= run.end_ns]
        spent = np.diff(times, append=run.end_ns) / 1e9
        found[machine] = {
            "state": states[int(numbers[-1])] if numbers.size else None,
            "changes": max(int(times.size) - 1, 0),
            "time_s": {s: float(total(spent[numbers == k])) for k, s in enumerate(states)},
        }
    return found


def _outages_proved(context: RunContext) -> hinf.Outages | None:
    """Return what the design proves across outages."""
    if context.design is None or observes(context.design):
        return None
    return context.design.guarantees.outages


def _of_design(name: str) -> Callable[[RunContext], Any]:
    return lambda c: None if c.design is None else getattr(c.design, name)


def _norm_reached(context: RunContext) -> float | None:
    norm = None if context.design is None else context.design.exact_norm
    return context.gain / norm if context.gain is not None and norm else None


def _gain_within_gamma(context: RunContext) -> bool | None:
    gamma = None if context.design is None else context.design.gamma
    return None if context.gain is None or gamma is None else context.gain <= gamma


def _of_commands(name: str) -> Callable[[RunContext], Any]:
    def figure(context: RunContext) -> Any:
        used = context.figures.saturation
        return None if used is None else getattr(used, name)

    return figure


def _feedback_age(context: RunContext) -> dict[str, Any] | None:
    if context.design is None or observes(context.design):
        return None
    feedback = None if context.problem is None else feedback_of(context.problem.system)
    return age_figures(feedback, context.figures.ages, context.known_age)


def _coupling(context: RunContext) -> dict[str, Any]:
    """Return the largest coupling delay, and that of each connection where they may differ."""
    if context.run.count < 2:
        return {"coupling_delay_s": None}
    delays, cut = context.figures.coupling_delays_s, context.figures.cut_delays_s
    own, system = context.scenario.components.values(), context.system
    plain = context.scenario.run.algorithm == "jacobi" and all(p.step is None for p in own)
    signals = (c for c in system.connections if not system.is_state(c.source))
    plain &= not cut and all(c.policy != "previous" for c in signals)
    found: dict[str, Any] = {"coupling_delay_s": max(delays.values(), default=0.0)}
    if not plain:
        found["coupling_delays_s"] = delays
    if cut:
        found["cut_connections"] = [
            {"from": str(c.source), "to": str(c.target), "delay_s": late} for c, late in cut.items()
        ]
    return found


def _position_error(context: RunContext) -> float | None:
    part = context.scenario.design
    if part is None:
        return None
    values = context.figures.last_outputs.get(part.plant, {})
    plant = None if context.problem is None else context.problem.plant
    path = _path_to(part.controller, context.scenario)
    if plant is not None:  # of the positions that are controlled, from the trim
        trim = dict(zip(plant.state.names, plant.state.trim, strict=True))
        controlled = [name for name in _POSITION if name in trim and name in values]
        error = [values[name] - trim[name] for name in controlled]
        if not controlled:
            return None
    elif not all(name in values for name in _POSITION):
        return None
    else:
        target = {} if path is None else dict(zip(path.axes, path.points[-1][1:], strict=True))
        error = [values[name] - target.get(name.removeprefix("eta."), 0.0) for name in _POSITION]
    size = math.sqrt(total(part * part for part in error))
    return size if np.isfinite(size) else None


def _path_to(component: str, scenario: Scenario) -> PathPart | None:
    """Return the path that a component follows; where there is one path only, that one."""
    paths = [path for _, path in scenario.paths()]
    mine = [path for path in paths if endpoint(path.target).component == component]
    return next(iter(mine), paths[0] if len(paths) == 1 else None)


def final_values(figures: RunFigures) -> dict[str, float | None]:
    """Return `component.variable` -> value at the last point reached; None if not finite."""
    return {
        f"{component}.{name}": value if np.isfinite(value) else None
        for component, values in figures.last_outputs.items()
        for name, value in values.items()
    }


def _designed_age_s(context: RunContext) -> float | None:
    """Return the largest measurement age the design allows; 0 for immediate feedback."""
    if context.problem is None or observes(context.design):
        return None
    return context.problem.system.feedback_delay


def _envelope_use(context: RunContext) -> dict[str, float] | None:
    """Return the largest |value| / bound per axis, over the run and its zero-state run."""
    runs = [context.figures.largest]
    if context.zero_state is not None:
        runs.append(context.zero_state.largest)
    if context.problem is None or not runs[0]:
        return None
    bounds = envelope_bounds(context.problem)
    use = {}
    for axis, (name, bound) in bounds.items():
        largest = max(found[name] for found in runs if found)
        use[axis] = largest / bound if np.isfinite(largest) else float("1e300")
    return use or None


_METRICS: Mapping[str, Callable[[RunContext], Any]] = MappingProxyType(
    {
        "gain": lambda c: c.gain,
        "norm_reached": _norm_reached,
        "gain_within_gamma": _gain_within_gamma,
        "gamma": _of_design("gamma"),
        "exact_norm": _of_design("exact_norm"),
        "abscissa": _of_design("abscissa"),
        "worst_case": lambda c: None if c.worst_case is None else asdict(c.worst_case),
        "position_error_m": _position_error,
        "saturated_fraction": _of_commands("fraction"),
        "largest_command": _of_commands("largest"),
        "message_age_s": lambda c: c.age_s,
        "designed_age_s": _designed_age_s,
        "feedback_age": _feedback_age,
        "envelope_use": _envelope_use,
    }
)
"""By name how each metric is computed, but for those of `_coupling` and `_assumptions`."""
