"""Check a scenario without running it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from cosim import hinf
from cosim.core import ComponentError, CosimError, Findings, InputError, refusals
from cosim.fmu import FmuDescription, require_loadable
from cosim.master import System
from cosim.network import PacketLink
from cosim.scenario.assembly import (
    SystemParts,
    Wires,
    delay_sources,
    find_fmus,
    modes_of,
    parts_of,
    system_of,
)
from cosim.scenario.assertions import bind_assertions
from cosim.scenario.extend import Source
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.gain import controller_parameters, gain_parameters, observes, problem_of
from cosim.scenario.lowering import lowered
from cosim.scenario.pinned import named_design
from cosim.scenario.plant import parameters_of_plant, require_vehicle_of
from cosim.scenario.preparation import check_disturbance, check_own_numbers, check_roles
from cosim.scenario.read import LoadedScenario, loaded_of
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.script import script_of
from cosim.scenario.signals import no_disturbance


def problems_of(source: Source, fmu_cache: FmuCache) -> list[CosimError]:
    """Return every error of a scenario, in the order in which they are found.

    Parts that depend on a faulty part are not checked. No gain is designed.
    """
    broken = schema_problems(source)
    if broken:
        return [*broken]
    try:
        return problems_of_loaded(loaded_of(source), fmu_cache)
    except CosimError as error:
        return [error]


def problems_of_loaded(loaded: LoadedScenario, fmu_cache: FmuCache) -> list[CosimError]:
    """Return every error of a scenario whose keys are right, as `problems_of`."""
    findings = Findings(loaded.origin, collect=True)
    unloaded: list[CosimError] = []
    _look(loaded, fmu_cache, findings, unloaded)
    return [*unloaded, *findings.errors]


def schema_problems(source: Source) -> list[InputError]:
    """Return an error for every key that breaks the schema."""
    try:
        data, origin = source.written_out()
    except InputError as error:
        return [error]
    try:
        ScenarioPart.model_validate(data)
    except ValidationError as error:
        return refusals(ScenarioPart, error, data, origin)
    return []


def _look(
    loaded: LoadedScenario, fmu_cache: FmuCache, findings: Findings, unloaded: list[CosimError]
) -> None:
    scenario = loaded.scenario
    fmus = find_fmus(scenario, fmu_cache, findings)
    unloaded += _not_loadable(fmus, findings)
    scenario, fmus, _ = lowered(scenario, fmus, fmu_cache, findings)
    with findings.at("disturbance"):
        check_disturbance(loaded)
    parameters: dict[str, dict[str, float]] = {}
    worst_case: hinf.delay_lti.WorstCase | None = None
    design = scenario.design
    if design is not None:
        with findings.at("design"):
            check_roles(loaded, fmus)
            plant = parameters_of_plant(scenario)
            fmu, designed = fmus[design.controller], None
            if design.file is None:
                problem = problem_of(design, loaded.folder, plant)
            else:
                problem, designed, _ = named_design(design, loaded.folder, plant)
                if problem.vehicle is not None:
                    require_vehicle_of(problem.vehicle, scenario, design)
            check_own_numbers(scenario, fmu, design.controller, designed, findings)
            if observes(designed):
                parameters[design.controller] = controller_parameters(designed, fmu)
            else:
                blank = np.zeros(problem.system.B.T.shape)
                parameters[design.controller] = gain_parameters(blank, fmu)
            with findings.at("disturbance"):
                worst_case = (
                    None if scenario.disturbance is None else no_disturbance(problem.system)
                )
    parts = parts_of(scenario, fmus, findings, parameters=parameters, worst_case=worst_case)
    if set(fmus) != set(scenario.components) or _has_no_schedule(scenario, parts, findings):
        return
    if _has_wrong_delays(scenario, parts, findings):
        return
    good = _good_wires(scenario, parts, findings)
    if len(good) < len(parts.wires) and not findings.errors:
        good = parts.wires
    try:
        system = system_of(scenario, replace(parts, wires=good), findings)
    except InputError as error:
        if not findings.errors:
            findings.errors.append(error)
        return
    script_of(scenario, system, findings)
    bind_assertions(scenario, system, findings)


def _not_loadable(
    fmus: Mapping[str, FmuDescription], findings: Findings
) -> Iterator[ComponentError]:
    """Ask of every FMU what a run asks before any code of it runs."""
    for name, described in fmus.items():
        try:
            with findings.at("components", name, "fmu"):
                require_loadable(described, name)
        except ComponentError as error:
            yield error


def _has_no_schedule(scenario: ScenarioPart, parts: SystemParts, findings: Findings) -> bool:
    """Whether a link or the points of the run could not be made: what uses them would say so."""
    packets = [name for name, link in parts.links.items() if isinstance(link, PacketLink)]
    made = set(parts.links) == set(scenario.links) and parts.comm_schedule.links.keys() >= {
        *packets
    }
    return bool(findings.errors) and not made


def _has_wrong_delays(scenario: ScenarioPart, parts: SystemParts, findings: Findings) -> bool:
    """Find a signal that decides a delay and cannot; each connection would repeat the error."""
    try:
        system_of(scenario, replace(parts, wires=[], driven={}), findings)
    except InputError as error:
        if re.search(r"\b(links|medium)\.[\w-]+\.(delay|nodes)\b", error.where or ""):
            findings.errors.append(error)
            return True
    return False


def _good_wires(scenario: ScenarioPart, parts: SystemParts, findings: Findings) -> Wires:
    """Return the valid connections, each checked alone; of two into one input, the first."""
    good: Wires = []
    for wire in parts.wires:
        connection, path = wire
        if connection.link is not None and connection.link not in parts.links:
            continue
        with findings.at(*path):
            System(
                parts.components,
                [*(c for c, _ in good if c.target == connection.target), connection],
                parts.links,
                {end: s for end, s in parts.driven.items() if end == connection.target},
                parts.comm_schedule,
                scenario.run.divergence,
                delays=delay_sources(scenario),
                modes=modes_of(scenario),
            )
            good.append(wire)
    return good
