"""The parameters of a run's plant: what a design is made for, and where they differ from it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from cosim import hinf
from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.fmu.export import component_module
from cosim.models import TABLE_1, DelaySystem, inertia, thrust_map
from cosim.scenario.schema import DesignPart, ScenarioPart
from cosim.scenario.values import parse_value

_PLANT = component_module("delayed_plant.variables")
_ENTRY = re.compile(r"(?:[AH][0-9]*|[BCE]|D[12]?)\[[0-9]+,[0-9]+\]")
_DAMPING = tuple(f"damping.{axis}" for axis in "uvwr")
_DELAY = "delay.d"
_LARGEST_FACTOR = 2.0

NO_PARAMETERS: Mapping[str, float] = MappingProxyType({})
"""Of a plant that has none of its own: it is the vehicle of Table 1."""


def parameters_of_plant(scenario: ScenarioPart, part: DesignPart | None = None) -> dict[str, float]:
    """Return the parameters of the vehicle that a scenario gives its plant, in SI units.

    What is no number, or has a wrong unit, is refused where the plant is made; here it is left
    out. `part` : [design], in place of the scenario's; empty without one.
    """
    part = part or scenario.design
    plant = None if part is None else scenario.components.get(part.plant)
    found: dict[str, float] = {}
    for name, value in (plant.parameters if plant is not None else {}).items():
        if name in TABLE_1 or name in _DAMPING or name == _DELAY:
            number = _number(value)
            if number is not None:
                found[name] = number
    return found


def _number(value: Any) -> float | None:
    try:
        number = parse_value(value).si if isinstance(value, str) else float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def design_settings_for(
    settings: hinf.problem.AuvDesignSettings,
    given: Mapping[str, Any],
    parameters: Mapping[str, float],
) -> hinf.problem.AuvDesignSettings:
    """Return the settings of a design for the vehicle with these parameters.

    given : keys of [design] that stand, whatever the plant has: `damping`, `state_delay`.
    """
    physical = {name: parameters.get(name, value) for name, value in TABLE_1.items()}
    changed: dict[str, Any] = {}
    if physical != dict(TABLE_1):
        changed["parameters"] = physical
    if "damping" not in given:
        own = zip(_DAMPING, settings.damping, strict=True)
        changed["damping"] = tuple(parameters.get(name, value) for name, value in own)
    if "state_delay" not in given and _DELAY in parameters:
        changed["state_delay"] = parameters[_DELAY]
    return replace(settings, **changed)


def thrust_map_parameters(
    design: hinf.problem.AuvDesignSettings | None,
    controller: FmuDescription,
    own: Mapping[str, Any],
) -> dict[str, float]:
    """Return the thrust map of a design as parameters of its controller's FMU.

    Only what the FMU does not start with, and the scenario (`own`) does not set.
    """
    wanted = {} if design is None else _thrust_map(design)
    return {
        name: value
        for name, value in wanted.items()
        if name in controller.ports and name not in own and controller.ports[name].start != value
    }


def _thrust_map(design: hinf.problem.AuvDesignSettings) -> dict[str, float]:
    rows = enumerate(inertia(design.parameters), 1)
    return {f"thrust_map[{i},{j}]": float(x) for i, row in rows for j, x in enumerate(row, 1)}


def require_vehicle_of(
    design: hinf.problem.AuvDesignSettings, scenario: ScenarioPart, part: DesignPart
) -> None:
    """Refuse a plant that the design named by `part.file` is not for: quite another vehicle.

    That is where an acceleration that the controller commands comes out at more than twice its
    size or less than half: the thrust map is the design's, or that of the scenario. A plant that
    differs less flies, and the outcome names what differs.

    Raises
    ------
    InputError : names the first parameter that differs, with both values.
    """
    found = parameters_of_plant(scenario, part)
    physical = {name: found.get(name, value) for name, value in TABLE_1.items()}
    other = [name for name, value in physical.items() if value != design.parameters[name]]
    if not other:
        return
    own = scenario.components[part.controller].parameters
    used = _thrust_map(design) | {n: x for n, v in own.items() if (x := _number(v)) is not None}
    rows = range(1, 5)
    commanded = np.array([[used[f"thrust_map[{i},{j}]"] for j in rows] for i in rows])
    try:
        factors = np.linalg.svd(np.array(thrust_map(physical)) @ commanded, compute_uv=False)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        factors = np.array([math.inf])
    if factors.min() >= 1 / _LARGEST_FACTOR and factors.max() <= _LARGEST_FACTOR:
        return
    more = f" ({len(other) - 1} more differ: {', '.join(other[1:4])})" if other[1:] else ""
    raise InputError(
        f"this design is for another vehicle: {other[0]} differs",
        where=f"components.{part.plant}.parameters.{other[0]}",
        expected=f"{design.parameters[other[0]]:g}, as in the design {part.file}",
        got=f"{physical[other[0]]:g}{more}",
        hint='[design] with system = "auv" and without file: a gain, its envelope and its thrust '
        "map are then made for the parameters of this plant",
    )


def vehicle_values(design: hinf.problem.AuvDesignSettings) -> dict[str, float]:
    """Return the parameters of the vehicle in the design."""
    wanted = {name: design.parameters[name] for name in TABLE_1}
    wanted |= dict(zip(_DAMPING, design.damping, strict=True))
    return {**wanted, _DELAY: design.state_delay}


def thrust_map_values(design: hinf.problem.AuvDesignSettings) -> dict[str, float]:
    """Return the thrust map of a controller as designed."""
    return _thrust_map(design)


def plant_values(system: DelaySystem, parameters: Mapping[str, float | None]) -> dict[str, float]:
    """Return the matrices and delays of a system, as in Eq. (7), as parameters of its plant.

    Matrices that the system does not have may be among the `parameters` of a plant: as zeros.
    """
    wanted = {
        f"{letter}[{i + 1},{j + 1}]": float(value)
        for letter, matrix in _PLANT.plant_matrices(system).items()
        for (i, j), value in np.ndenumerate(matrix)
    }
    others = filter(_ENTRY.fullmatch, parameters)
    entries = {name: wanted.get(name, 0.0) for name in (*wanted, *others)}
    delays = _PLANT.plant_delays(system)
    named = dict(zip(_PLANT.delay_names(len(delays)), (delay.d for delay in delays), strict=True))
    return {**entries, **named}
