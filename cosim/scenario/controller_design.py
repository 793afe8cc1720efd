"""The design in a controller's FMU, where a scenario has no [design].

A controller that `cosim fmu controller` made carries its certificate. A scenario that connects
it to a plant, and does not change its gain, has what [design] would say: the gain, and the system
that it is proved for. The run is then judged as with `[design] file = "my-controller.fmu"`, and its
trace contains that key. Where the certificate cannot count, the reason is part of the outcome.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from cosim.core import CosimError
from cosim.fmu import FmuDescription
from cosim.fmu.inspect import carries_certificate
from cosim.hinf.problem import AuvDesignSettings
from cosim.scenario.gain import Problem, controller_parameters
from cosim.scenario.pinned import DesignSource, named_design
from cosim.scenario.plant import parameters_of_plant, require_vehicle_of
from cosim.scenario.read import LoadedScenario
from cosim.scenario.schema import DesignPart, ScenarioPart

if TYPE_CHECKING:
    from cosim.hinf import Result

_BUILT_IN, _ITS_PLANT, _ITS_DESIGN = "HinfController", "AuvPlant", "auv-1.25s"
_NAMES_IT = "[design] file, controller and plant say what counts"


class ControllerDesign(NamedTuple):
    """A scenario with the design of its controller; `made` and `source` of the design.

    Without one, `loaded` is the scenario as it was, and `source` the reason, if there is one.
    """

    loaded: LoadedScenario
    made: tuple[Problem, Result] | None
    source: DesignSource | None


def with_design_of_controller(
    loaded: LoadedScenario, fmus: Mapping[str, FmuDescription]
) -> ControllerDesign:
    """Return a scenario without [design] with that of its controller's FMU, if that has one.

    Only FMUs that the scenario names by file are opened.
    """
    scenario = loaded.scenario
    carriers = [
        name
        for name, part in scenario.components.items()
        if part.fmu.endswith(".fmu") and name in fmus and carries_certificate(fmus[name].path)
    ]
    if not carriers:
        _require_own_vehicle(scenario)
        return ControllerDesign(loaded, None, None)
    if len(carriers) > 1:
        return _none(loaded, f"{' and '.join(carriers)} carry certificates: {_NAMES_IT}")
    name = carriers[0]
    fmu = scenario.components[name].fmu
    plants = _plants(scenario, name)
    if len(plants) != 1:
        found = " and ".join(plants) or "no component"
        return _none(loaded, f"{fmu} carries a certificate, but {found} follows it: {_NAMES_IT}")
    changed = [key for key in scenario.components[name].parameters if key.startswith("K[")]
    if changed:
        return _none(loaded, f"{fmu} carries a certificate, but {name} has its own {changed[0]}")
    part = DesignPart(file=fmu, controller=name, plant=plants[0])
    # where the FMU was found: a cache may have it under another path than the scenario names
    there = part.model_copy(update={"file": str(fmus[name].path.resolve())})
    try:
        plant = parameters_of_plant(scenario, part)
        problem, design, _ = named_design(there, loaded.folder, plant)
        controller_parameters(design, fmus[name])
    except CosimError as error:
        reason = error.what if error.got is None else f"{error.what} ({error.got})"
        return _none(loaded, f"{fmu} carries a certificate that does not count here: {reason}")
    if problem.vehicle is not None:
        require_vehicle_of(problem.vehicle, scenario, part)
    digest = loaded.source_sha256 or hashlib.sha256(loaded.text.encode()).hexdigest()
    own = scenario.model_copy(update={"design": part})
    named = replace(loaded, scenario=own, text=own.to_toml(), source_sha256=digest)
    source = DesignSource(f"in {fmu}, the controller; its proof checked again", fmu)
    return ControllerDesign(named, (problem, design), source)


def _require_own_vehicle(scenario: ScenarioPart) -> None:
    """Refuse the built-in controller, with its own gain and thrust map, at another vehicle."""
    for name, component in scenario.components.items():
        changed = any(key.startswith(("K[", "thrust_map[")) for key in component.parameters)
        if component.fmu != _BUILT_IN or changed:
            continue
        for plant in _plants(scenario, name):
            if scenario.components[plant].fmu == _ITS_PLANT:
                part = DesignPart(file=_ITS_DESIGN, controller=name, plant=plant)
                require_vehicle_of(AuvDesignSettings(), scenario, part)


def _plants(scenario: ScenarioPart, controller: str) -> list[str]:
    """Return the components that a controller commands; if several, those that it measures."""
    ends = [
        (wire.source.partition(".")[0], wire.target.partition(".")[0])
        for _, wire in scenario.wires()
    ]
    commanded = dict.fromkeys(target for source, target in ends if source == controller)
    measured = {source for source, target in ends if target == controller}
    both = [name for name in commanded if name in measured]
    return both if len(commanded) > 1 and both else list(commanded)


def _none(loaded: LoadedScenario, why: str) -> ControllerDesign:
    return ControllerDesign(loaded, None, DesignSource(f"none: {why}"))
