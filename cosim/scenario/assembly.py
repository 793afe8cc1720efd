"""Assemble the system of a scenario: FMUs, links in nanoseconds, connections, driven inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim import hinf
from cosim.core import NOWHERE, Findings, InputError, KeyPath, Origin, placed
from cosim.fmu import Feedthrough, FmuDescription, Port
from cosim.master import (
    CommunicationSchedule,
    Component,
    Connection,
    DelaySource,
    Endpoint,
    Link,
    LogLevel,
    Modes,
    PositionSource,
    System,
    make_schedule,
    receiving_order,
)
from cosim.network import TransportLink
from cosim.scenario.channels import delay_source, link_of
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.input_files import series_inputs
from cosim.scenario.link_keys import nanoseconds
from cosim.scenario.links import PacketPart
from cosim.scenario.matching import endpoint, matched
from cosim.scenario.media import media_of, position_sources
from cosim.scenario.schema import ComponentLogPart, ComponentPart, RunPart, ScenarioPart
from cosim.scenario.script import adjusted_links, changes_of, instants_ns
from cosim.scenario.signals import Signals, along_path, reference_inputs, worst_case_inputs
from cosim.scenario.units import numbers_of

Wires = list[tuple[Connection, KeyPath]]
"""Connections, each with its path in the scenario."""
_AT_ONCE = 1 << 16


def find_fmus(
    scenario: ScenarioPart, fmu_cache: FmuCache, findings: Findings | None = None
) -> dict[str, FmuDescription]:
    """Find the FMU of every component; build missing ones of the catalogue."""
    findings = findings or Findings()
    found = {}
    for name, part in scenario.components.items():
        with findings.at("components", name, "fmu"):
            found[name] = fmu_cache.find(part.fmu)
    return found


@dataclass(frozen=True)
class SystemParts:
    """The parts of a system.

    own, shaped : by component its parameters in the scenario, and its FMU with the lengths of
        arrays that these give.
    links_of : by link everything that it is made of.
    """

    components: Mapping[str, Component]
    wires: Wires
    links: Mapping[str, Link]
    links_of: Mapping[str, tuple[Any, ...]]
    driven: Signals
    comm_schedule: CommunicationSchedule
    own: Mapping[str, Mapping[str, Any]]
    shaped: Mapping[str, FmuDescription]


@dataclass(frozen=True)
class Assembled:
    """A system, and what it was assembled from; the next one may have parts of it.

    parameters : of components, beside those of the scenario.
    """

    scenario: ScenarioPart
    fmus: Mapping[str, FmuDescription]
    parameters: Mapping[str, Mapping[str, float]]
    parts: SystemParts
    system: System

    def has_component(
        self, name: str, scenario: ScenarioPart, fmus: Mapping[str, FmuDescription]
    ) -> bool:
        """Whether a component and its FMU are the same in another scenario."""
        same = self.scenario.components.get(name) is scenario.components[name]
        return same and self.scenario.log is scenario.log and self.fmus[name] is fmus[name]

    def numbers_of(
        self, name: str, part: ComponentPart, fmu: FmuDescription
    ) -> Mapping[str, Any] | None:
        """Return the parameters of a component that are the same in another scenario, converted.

        None if its arrays may have other lengths there: what fits one may not fit the other.
        """
        if self.fmus.get(name) is not fmu:
            return None
        before, own = self.scenario.components[name].parameters, self.parts.own[name]
        if not fmu.lengths.isdisjoint({*before, *part.parameters}):
            return None
        return {
            variable: own[variable]
            for variable, value in part.parameters.items()
            if variable in own and before.get(variable) is value
        }

    def has_points(self, scenario: ScenarioPart) -> bool:
        """Whether another scenario has the same communication points but for those of messages."""
        mine, other = self.scenario, scenario
        steps = [part.step for part in mine.components.values()]
        return (
            self.has_run(other.run)
            and mine.events is other.events
            and steps == [part.step for part in other.components.values()]
        )

    def has_run(self, run: RunPart) -> bool:
        """Whether [run] is the same in another scenario, but for its seed."""
        mine = self.scenario.run
        return mine is run or mine.model_copy(update={"seed": run.seed}) == run

    def has_wires(self, scenario: ScenarioPart, shaped: Mapping[str, FmuDescription]) -> bool:
        """Whether the connections are the same in another scenario with these FMUs."""
        mine, before = self.scenario, self.parts.shaped
        same = mine.connections is scenario.connections and mine.connect is scenario.connect
        same &= mine.links.keys() == scenario.links.keys() and before.keys() == shaped.keys()
        return same and all(before[name] is fmu for name, fmu in shaped.items())


def assemble(
    scenario: ScenarioPart,
    fmus: Mapping[str, FmuDescription],
    *,
    parameters: Mapping[str, Mapping[str, float]],
    worst_case: hinf.delay_lti.WorstCase | None = None,
    at_rest: bool = False,
    origin: Origin = NOWHERE,
    like: Assembled | None = None,
) -> Assembled:
    """Assemble the system of a scenario.

    Parameters
    ----------
    fmus : by component.
    parameters : by component, override the scenario's own (the gain of a design).
    worst_case : the worst-case disturbance of the scenario's design.
    at_rest : assemble the zero-state run: zero initial state and reference, all else equal;
        the gain from w to z is defined there.
    origin : locates the parts of the scenario in messages.
    like : one assembled before, `at_rest` or not as this one: what is the same object in its
        scenario is not made again.

    Raises
    ------
    InputError : unknown names, or parts that do not fit together.
    """
    findings = Findings(origin)
    parts = parts_of(
        scenario,
        fmus,
        findings,
        parameters=parameters,
        worst_case=worst_case,
        at_rest=at_rest,
        like=like,
    )
    system = system_of(scenario, parts, findings, like)
    return Assembled(scenario, fmus, parameters, parts, system)


def parts_of(
    scenario: ScenarioPart,
    fmus: Mapping[str, FmuDescription],
    findings: Findings,
    *,
    parameters: Mapping[str, Mapping[str, float]],
    worst_case: hinf.delay_lti.WorstCase | None = None,
    at_rest: bool = False,
    like: Assembled | None = None,
) -> SystemParts:
    """Make the parts of a system, as `assemble`; errors go to `findings`."""
    links, links_of = _links(scenario, findings, like)
    comm_schedule = _comm_schedule(scenario, links, findings, like)
    own, shaped, same = _own_parameters(scenario, fmus, findings, like)
    for name in scenario.log.components if scenario.log is not None else ():
        if name not in scenario.components:
            with findings.at("log", "components", name):
                raise InputError.unknown("component", name, scenario.components)
    declared: dict[str, Feedthrough | None] = {}
    for name, fmu in shaped.items():
        with findings.at("components", name, "feedthrough"):
            fmu.with_feedthrough(scenario.components[name].feedthrough)
            declared[name] = scenario.components[name].feedthrough
    if like is not None and like.has_wires(scenario, shaped):
        wires = like.parts.wires
    else:
        wires = _wires(scenario, shaped, findings)
    driven = _driven(scenario, shaped, comm_schedule, worst_case, findings, at_rest=at_rest)
    components = {}
    keep = like is not None and not at_rest and like.parts.wires is wires
    connected = {c.target for c, _ in wires} | set(driven)
    for name, fmu in shaped.items():
        more = parameters.get(name, {})
        if like is not None and keep and name in same and like.parameters.get(name, {}) == more:
            components[name] = like.parts.components[name]
            continue
        still = _at_rest(fmu, name, connected) if at_rest else {}
        part = scenario.components[name]
        with findings.at("components", name):
            components[name] = Component(
                fmu,
                {**own[name], **still, **more},
                None if part.step is None else nanoseconds(part.step),
                *_wanted_log(scenario, name),
                feedthrough=declared.get(name),
                isolate=part.isolate,
                event_mode=part.event_mode,
                clocks=part.clocks,
                intermediate=part.intermediate,
            )
    return SystemParts(components, wires, links, links_of, driven, comm_schedule, own, shaped)


def _own_parameters(
    scenario: ScenarioPart,
    fmus: Mapping[str, FmuDescription],
    findings: Findings,
    like: Assembled | None,
) -> tuple[dict[str, Mapping[str, Any]], dict[str, FmuDescription], set[str]]:
    """Return `own` and `shaped` of `SystemParts`, and the components that are those of `like`."""
    own: dict[str, Mapping[str, Any]] = {}
    shaped: dict[str, FmuDescription] = {}
    same: set[str] = set()
    for name, part in scenario.components.items():
        if like is not None and like.has_component(name, scenario, fmus):
            same.add(name)
            own[name], shaped[name] = like.parts.own[name], like.parts.shaped[name]
        elif name in fmus:
            before = None if like is None else like.numbers_of(name, part, fmus[name])
            own[name] = numbers_of(name, fmus[name], part.parameters, findings, before)
            shaped[name] = fmus[name].resized(own[name])
    return own, shaped, same


def _at_rest(fmu: FmuDescription, name: str, connected: set[Endpoint]) -> dict[str, Any]:
    """Return the start values of a component that is at rest."""
    return {
        p.name: [0.0] * p.size if p.shape else 0.0
        for p in fmu.ports.values()
        if _of_the_start(p, Endpoint(name, p.name) in connected)
    }


def _wanted_log(scenario: ScenarioPart, component: str) -> tuple[LogLevel, list[str] | None]:
    """Return the lowest level at which a component is logged, and its log categories."""
    if scenario.log is None:
        return "debug", None
    part = scenario.log.components.get(component, ComponentLogPart())
    return part.level or scenario.log.level, part.categories


def _links(
    scenario: ScenarioPart, findings: Findings, like: Assembled | None
) -> tuple[dict[str, Link], dict[str, tuple[Any, ...]]]:
    """Return `links` and `links_of` of `SystemParts`."""
    links: dict[str, Link] = {}
    links_of: dict[str, tuple[Any, ...]] = {}
    changes, adjusted = changes_of(scenario, findings), adjusted_links(scenario)
    media = media_of(scenario.medium, findings)
    packets = {n: part for n, part in scenario.links.items() if isinstance(part, PacketPart)}
    shared = {packets[name].medium for name in adjusted & packets.keys()} - {None}
    adjusted |= {name for name, part in packets.items() if part.medium in shared}
    for name, part in scenario.links.items():
        of = part, scenario.run.seed, changes.get(name, ()), media
        adjustable, start_ns = name in adjusted, scenario.run.start_ns
        links_of[name] = (*of, adjustable, start_ns)
        if like is not None and like.parts.links_of.get(name) == links_of[name]:
            links[name] = like.parts.links[name]
            continue
        with findings.at("links", name):
            links[name] = link_of(name, *of, adjustable=adjustable, start_ns=start_ns)
    return links, links_of


def _comm_schedule(
    scenario: ScenarioPart, links: Mapping[str, Link], findings: Findings, like: Assembled | None
) -> CommunicationSchedule:
    run = scenario.run
    transport = all(isinstance(link, TransportLink) for link in links.values())
    if like is not None and transport and like.has_points(scenario):
        return replace(like.parts.comm_schedule, links=links)
    step, end = nanoseconds(run.step), run.lasts_ns
    every = [nanoseconds(p.step) for p in scenario.components.values() if p.step is not None]
    with findings.at("run"):
        instants = instants_ns(scenario)
        return make_schedule(links, step, end, run.events, every, instants, run.start_ns)
    # a check goes on after this error: two points are enough for the other parts
    return CommunicationSchedule(1_000_000_000, 1_000_000_000, "grid")


def _wires(scenario: ScenarioPart, fmus: Mapping[str, FmuDescription], findings: Findings) -> Wires:
    wires: Wires = []
    for path, part in scenario.wires():
        with findings.at(*path):
            ends = endpoint(part.source), endpoint(part.target)
            found = (
                [Connection(*ends, part.link, part.policy)]
                if ends[0].component in {*scenario.links, *scenario.modes}.difference(fmus)
                else matched(fmus, *ends, part.link, part.policy, scenario.components)
            )
            wires += [(connection, path) for connection in found]
        if part.link is not None and part.link not in scenario.links:
            with findings.at(*path, "link"):
                raise InputError.unknown("link", part.link, scenario.links)
    return wires


def _driven(
    scenario: ScenarioPart,
    fmus: Mapping[str, FmuDescription],
    comm_schedule: CommunicationSchedule,
    worst_case: hinf.delay_lti.WorstCase | None,
    findings: Findings,
    *,
    at_rest: bool,
) -> Signals:
    driven: Signals = {}
    for place, part in scenario.paths():
        with findings.at(*place):
            _add(driven, along_path(reference_inputs(part, fmus), at_rest=at_rest))
    for i, series in enumerate(scenario.inputs):
        with findings.at("inputs", i):
            _add(driven, series_inputs(series, fmus, comm_schedule, at_rest=at_rest))
    if scenario.disturbance is not None and worst_case is not None:
        with findings.at("disturbance"):
            signals = worst_case_inputs(scenario.disturbance, worst_case, fmus, comm_schedule)
            _add(driven, signals)
    return driven


def _add(driven: Signals, found: Signals) -> None:
    """Add inputs that follow signals, none of which is driven already."""
    for end in found:
        if end in driven:
            raise InputError(
                "an input has two sources",
                where=str(end),
                got="two of the reference, the time series and the disturbance",
                hint="leave one of them out",
            )
    driven |= found


def system_of(
    scenario: ScenarioPart, parts: SystemParts, findings: Findings, like: Assembled | None = None
) -> System:
    """Make the system; an error of it is located at the part of the scenario it names.

    like : as in `assemble`.

    Raises
    ------
    InputError : as `System` and `receiving_order`.
    """
    run = scenario.run
    try:
        system = System(
            parts.components,
            [connection for connection, _ in parts.wires],
            parts.links,
            parts.driven,
            parts.comm_schedule,
            run.divergence,
            run.algorithm,
            run.order,
            delay_sources(scenario),
            run.threads,
            run.unknown_feedthrough,
            run.solve,
            run.solve_tolerance,
            run.solve_limit,
            modes=modes_of(scenario),
            like=None if like is None else like.system,
        )
        same = like is not None and like.parts.wires is parts.wires and like.has_run(run)
        # an algebraic loop is found here, not when the run begins
        receiving_order(system, like.system if like is not None and same else None)
    except InputError as error:
        raise placed(error, _blamed(error, parts.wires, scenario), findings.origin) from error
    return system


def modes_of(scenario: ScenarioPart) -> dict[str, Modes]:
    """Return the mode machines by name."""
    return {
        name: Modes(tuple(part.states), list(part.states).index(part.first))
        for name, part in scenario.modes.items()
    }


def delay_sources(scenario: ScenarioPart) -> dict[str, DelaySource | PositionSource]:
    """Return the delay sources of live links, and the position sources of media that they share."""
    found = {name: delay_source(part) for name, part in scenario.links.items()}
    shared = {part.medium for part in scenario.links.values() if isinstance(part, PacketPart)}
    media = {name: part for name, part in scenario.medium.items() if name in shared}
    live = {name: source for name, source in found.items() if source is not None}
    return {**live, **position_sources(media)}


def _blamed(error: InputError, wires: Wires, scenario: ScenarioPart) -> KeyPath:
    where = error.where or ""
    # an algebraic loop lists its connections as what it got
    listed = f", {where.removeprefix('connection ')}, {error.got}, "
    for connection, path in reversed(wires):
        named = f", {connection.source} -> {connection.target}"
        if (
            f"{named}, " in listed
            or f"{named} (dependencies" in listed
            or str(connection.target) == where
        ):
            return path
    for name in scenario.links:
        if where.startswith(f"link {name!r}: delay"):
            return ("links", name, "delay")
    for name in scenario.medium:
        if where.startswith(f"medium.{name}: nodes"):
            return ("medium", name, "nodes")
    for name in scenario.components:
        if where.startswith(f"component {name!r}"):
            return ("components", name)
    return ("run", "order") if where == "order" else ("run",)


def same_start(one: System, other: System) -> bool:
    """Whether two systems of one scenario have equal start values and driven inputs."""
    return all(
        _start(one.components[name], port) == _start(other.components[name], port)
        for name, component in one.components.items()
        for port in component.description.ports.values()
    ) and all(_same_signal(one, other, end) for end in one.driven)


def _same_signal(one: System, other: System, end: Endpoint) -> bool:
    """Whether a driven input has equal values in two systems, at the points without links."""
    a, b = one.driven[end], other.driven[end]
    if not callable(a) or not callable(b):
        return a is b or (not callable(a) and not callable(b) and np.array_equal(a, b))
    schedule = one.comm_schedule
    for after in range(-1, schedule.end_ns, _AT_ONCE * schedule.step_ns):
        known = schedule.known(after, after + _AT_ONCE * schedule.step_ns)
        seconds = (known + schedule.start_ns) / 1e9
        if not np.array_equal(a(seconds), b(seconds)):
            return False
    return True


def _start(component: Component, port: Port) -> Any:
    value = component.start_of(port.name)
    return np.ravel(value).tolist() if port.shape and value is not None else value


def _of_the_start(port: Port, connected: bool) -> bool:  # noqa: FBT001 - a predicate of both
    """Whether a variable belongs to the initial state: `initial.*`, or a connected input.

    The start value of an unconnected input holds for the whole run.
    """
    if port.kind != "float":
        return False
    if port.causality == "parameter":
        return port.name.startswith("initial.")
    return connected and port.causality == "input"
