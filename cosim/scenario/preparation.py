"""Prepare a scenario before it runs: find or build its FMUs, find or make its design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import hinf
from cosim.core import Findings, InputError, Progress, silent
from cosim.fmu import FmuDescription
from cosim.scenario.assembly import assemble, find_fmus
from cosim.scenario.controller_design import with_design_of_controller
from cosim.scenario.feedback_age import feedback_age
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.gain import (
    Problem,
    controller_parameters,
    gain_parameters,
    observes,
    problem_of,
    require_own_numbers,
)
from cosim.scenario.lowering import LinearMap, lowered
from cosim.scenario.pinned import DesignSource, kept_or_made, named_design
from cosim.scenario.plant import (
    parameters_of_plant,
    require_vehicle_of,
    thrust_map_parameters,
)
from cosim.scenario.read import LoadedScenario
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.signals import no_disturbance, reference_inputs, worst_case_of

if TYPE_CHECKING:
    from cosim.hinf import Result

MADE_BEFORE = DesignSource("made before, its proof checked again")
"""The source of a design that is given to `prepare`."""


@dataclass(frozen=True)
class PreparedScenario:
    """A scenario that is ready to run.

    worst_case : the worst-case disturbance to apply.
    source : where the design comes from.
    maps : the components that are a linear map before an input, by name.
    """

    loaded: LoadedScenario
    fmus: Mapping[str, FmuDescription]
    problem: Problem | None
    design: Result | None
    worst_case: hinf.delay_lti.WorstCase | None = None
    source: DesignSource | None = None
    maps: Mapping[str, LinearMap] = field(default_factory=dict)

    @property
    def gain(self) -> dict[str, dict[str, float]]:
        """The designed gain and thrust map as parameters, by component; empty without a design."""
        part = self.loaded.scenario.design
        if part is None or self.design is None:
            return {}
        fmu, own = self.fmus[part.controller], self.loaded.scenario.components[part.controller]
        vehicle = None if self.problem is None else self.problem.vehicle
        found = controller_parameters(self.design, fmu)
        found |= thrust_map_parameters(vehicle, fmu, own.parameters)
        return {part.controller: found | self._stamps(own.parameters)}

    def _stamps(self, own: Mapping[str, Any]) -> dict[str, float]:
        """Return the stamps before the first measurements, where a run begins later than at 0.

        A sensor's first values have a stamp of a second before the run (`Sensor`): they are none.
        """
        start, part = self.loaded.scenario.run.start, self.loaded.scenario.design
        if not start or part is None:
            return {}
        ports = self.fmus[part.controller].ports
        return {x: start - 1.0 for x in ports if x.startswith("stamp.") and x not in own}

    @property
    def at_rest(self) -> dict[str, dict[str, Any]]:
        """Start values of the zero-state run: of the plant those at the trim of its design.

        Of an observer's stamps those that say that nothing has been received.
        """
        part = self.loaded.scenario.design
        if part is None or self.problem is None:
            return {}
        controller = self.fmus[part.controller].ports
        none = {x.name: x.start for x in controller.values() if x.name.startswith("stamp.")}
        own = self.loaded.scenario.components[part.controller].parameters
        found: dict[str, dict[str, Any]] = {part.controller: none | self._stamps(own)}
        if self.problem.plant is not None:
            ports, trim = self.fmus[part.plant].ports, self.problem.plant.at_rest
            found[part.plant] = {name: value for name, value in trim.items() if name in ports}
        return found

    def again(self, loaded: LoadedScenario) -> PreparedScenario:
        """Return another scenario that is ready to run: one with the FMUs and design of this one.

        Raises
        ------
        InputError : numbers of its controller are not those of the design.
        """
        before, scenario = self.loaded.scenario, loaded.scenario
        if before.reference is not None:  # in the units of the inputs
            scenario = scenario.model_copy(update={"reference": before.reference})
            loaded = replace(loaded, scenario=scenario)
        part = scenario.design
        if part is not None:
            name = part.controller
            if scenario.components[name] is not before.components[name]:
                findings = Findings(loaded.origin)
                check_own_numbers(scenario, self.fmus[name], name, self.design, findings)
        return replace(self, loaded=loaded)


def check_own_numbers(
    scenario: ScenarioPart,
    fmu: FmuDescription,
    controller: str,
    design: Result | None,
    findings: Findings,
) -> None:
    """Refuse numbers of a controller that are not those of its design; errors go to `findings`."""
    with findings.at("components", controller, "parameters"):
        if design is not None:
            require_own_numbers(design, fmu, scenario.components[controller])


def prepare(
    loaded: LoadedScenario,
    fmu_cache: FmuCache,
    *,
    saved: tuple[Problem, Result] | None = None,
    worst_case: hinf.delay_lti.WorstCase | None = None,
    progress: Progress | None = None,
    of_links: bool = True,
    plant: Mapping[str, float] | None = None,
) -> PreparedScenario:
    """Find or build the FMUs; find the design that the scenario names, or make one.

        >>> from cosim import DelaySystem, Scenario
        >>> from cosim.scenario import FmuCache, prepare
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1.0]]))
        >>> prepared = prepare(lag.loaded(), FmuCache("fmus"))
        >>> list(prepared.fmus), prepared.problem is None
        (['lag'], True)

    saved : problem and design to use instead of the scenario's.
    worst_case : worst case to use instead of the one in the design.
    of_links : prove a new gain for the ages that the links justify; False if one design serves many
        links, as in a study.
    plant : parameters of the vehicle to design for, if one design serves many plants; None: those
        that the scenario gives its plant; then a named design for quite another vehicle is refused.

    Raises
    ------
    InputError, NotAchievableError : see `assemble`, `gain`, `pinned` and `signals`.
    """
    report_progress = progress or silent
    report_progress("FMUs", 0.0)
    findings = Findings(loaded.origin)
    fmus = find_fmus(loaded.scenario, fmu_cache, findings)
    source: DesignSource | None = MADE_BEFORE
    if loaded.scenario.design is None:
        loaded, saved, source = with_design_of_controller(loaded, fmus)
    plain, fmus, maps = lowered(loaded.scenario, fmus, fmu_cache, findings)
    loaded = loaded if plain is loaded.scenario else replace(loaded, scenario=plain)
    loaded = with_numbers(loaded, fmus, findings)
    scenario = loaded.scenario
    part, disturbance = scenario.design, scenario.disturbance
    if part is None:
        with findings.at("disturbance"):
            check_disturbance(loaded)
        return PreparedScenario(loaded, fmus, None, None, source=source, maps=maps)
    with findings.at("design"):
        check_roles(loaded, fmus)
        own = parameters_of_plant(scenario) if plant is None else plant
        found: Result | None = None
        if saved is not None:
            problem, found = saved
        elif part.file is not None:
            problem, found, source = named_design(part, loaded.folder, own)
            if plant is None and problem.vehicle is not None:
                require_vehicle_of(problem.vehicle, scenario, part)
        else:
            problem = problem_of(part, loaded.folder, own)
        if not observes(found):
            blank = gain_parameters(np.zeros(problem.system.B.T.shape), fmus[part.controller])
    with findings.at("disturbance"):
        still = None if disturbance is None else no_disturbance(problem.system)
    if found is None:
        # a scenario that cannot run fails before the design, which takes longest
        roles = {part.controller: blank}
        origin = loaded.origin
        system = assemble(scenario, fmus, parameters=roles, worst_case=still, origin=origin).system
        report_progress("design", 0.0)
        known = feedback_age(system, part.plant, part.controller) if of_links else None
        found, source = kept_or_made(loaded, problem, known)
        problem = replace(problem, system=found.system)
    check_own_numbers(scenario, fmus[part.controller], part.controller, found, findings)
    if disturbance is not None and worst_case is None:
        with findings.at("disturbance"):
            worst_case = worst_case_of(disturbance, found)
    return PreparedScenario(loaded, fmus, problem, found, worst_case, source, maps)


def with_numbers(
    loaded: LoadedScenario, fmus: Mapping[str, FmuDescription], findings: Findings
) -> LoadedScenario:
    """Convert the reference to the units of the inputs that follow it."""
    numbers = []
    for place, path in loaded.scenario.paths():
        with findings.at(*place):
            numbers.append(reference_inputs(path, fmus))
    if not numbers:
        return loaded
    several = isinstance(loaded.scenario.reference, list)
    update = {"reference": numbers if several else numbers[0]}
    return replace(loaded, scenario=loaded.scenario.model_copy(update=update))


def check_disturbance(loaded: LoadedScenario) -> None:
    """Refuse a worst-case disturbance without a design."""
    if loaded.scenario.disturbance is not None and loaded.scenario.design is None:
        raise InputError(
            "a worst case needs a design, and this scenario has none",
            where="disturbance",
            expected="[design]",
            hint="a wave field as a component needs no design",
        )


def check_roles(loaded: LoadedScenario, fmus: Mapping[str, FmuDescription]) -> None:
    """Check that the controller and the plant of the design exist."""
    part = loaded.scenario.design
    if part is not None:
        for role, name in (("controller", part.controller), ("plant", part.plant)):
            if name not in fmus:
                raise InputError.unknown("component", name, fmus, where=f"design.{role}")
