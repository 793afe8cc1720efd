"""Compare the parameters of plant, controller and sensors with those of the design."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from cosim import hinf
from cosim.master import Component, System
from cosim.scenario.designed_plant import Difference, differences_from
from cosim.scenario.gain import Problem, controller_parameters, observes
from cosim.scenario.guarantee.claim import covers_plant_delays
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.wiring import Sensed
from cosim.scenario.plant import plant_values, thrust_map_values, vehicle_values

if TYPE_CHECKING:
    from cosim.hinf import Result

_FREE = ("initial.", "solver.", "delay.")
"""Parameters of a plant that are no part of its equations, or that have a rule of their own."""
_AMPLITUDE = "F.amplitude"


def plant_differences(design: Result, problem: Problem, plant: Component) -> list[Difference]:
    """Return where the parameters of a plant are not those that it was designed as.

    Its equations are compared number by number, its delays by what the proof says of each
    (`covers_plant_delays`), its uncertainty F(t) by its size; what it does not name must be as the
    FMU declares it. The initial state is free, and how the plant is integrated is measured.
    """
    found: list[Difference] = []
    own = _values(plant)
    if problem.plant is not None:
        designed: Mapping[str, float] = problem.plant.parameters
    elif problem.vehicle is not None:
        designed = vehicle_values(problem.vehicle)
    else:
        designed = plant_values(hinf.problem.without_integrals(problem.system), own)
    delays = {name: d for name, d in designed.items() if name.startswith("delay.")}
    equations = {name: x for name, x in designed.items() if name not in delays}
    found += differences_from(equations, own)
    found += [Difference(*one) for one in covers_plant_delays(design, delays, own)]
    found += _undesigned(plant, own, designed)
    return found + list(_uncertainty(problem, own))


def _undesigned(
    plant: Component, own: Mapping[str, Any], designed: Mapping[str, float]
) -> Iterator[Difference]:
    """Yield parameters that the design does not name, where they are not as the FMU has them."""
    for name, port in plant.description.ports.items():
        known = name in designed or name.startswith(_FREE) or name.startswith("F.")
        if port.causality == "parameter" and not known and own[name] != port.start:
            start = port.start if isinstance(port.start, int | float) else math.nan
            yield Difference(name, own[name], float(start))


def _uncertainty(problem: Problem, own: Mapping[str, Any]) -> Iterator[Difference]:
    """Yield the amplitude of F(t) where a proof does not cover it: |F| <= 1, in its blocks."""
    value = own.get(_AMPLITUDE)
    if value is None:
        return
    blocks = problem.system.uncertainty_blocks or ()
    # F.amplitude sin(...) stands on the main diagonal of F: inside square blocks alone
    most = 1.0 if problem.system.E.size and all(p == q for p, q in blocks) else 0.0
    if not abs(value) <= most:
        yield Difference(_AMPLITUDE, value, most)


def controller_differences(
    design: Result, problem: Problem, controller: Component
) -> list[Difference]:
    """Return where the numbers of a controller are not those of the design.

    They are its gain and the model and injections of its observer, the maps from controls to
    commands and back, and the trim of which it feeds back deviations.
    """
    own = _values(controller)
    designed = dict(controller_parameters(design, controller.description))
    if problem.vehicle is not None and "thrust_map[1,1]" in own:
        designed |= thrust_map_values(problem.vehicle)
    if observes(design) and problem.plant is not None:
        designed |= _of_note(design, problem)
    return differences_from(designed, own)


def _of_note(design: hinf.Result, problem: Problem) -> dict[str, float]:
    """Return the maps and the trim that a controller must have, by the note of its plant."""
    note = problem.plant
    if note is None:
        return {}
    found: dict[str, float] = {}
    maps = {"thrust_map": note.thrust_map, "allocation": note.control.map}
    for letter, rows in maps.items():
        for i, row in enumerate(() if rows is None else rows, 1):
            found |= {f"{letter}[{i},{j}]": float(x) for j, x in enumerate(row, 1)}
    found |= {f"trim.{n}": x for n, x in zip(note.control.names, note.control.trim, strict=True)}
    trim = dict(zip(note.state.names, note.state.trim, strict=True))
    names, rows = note.state.names, note.state.map
    for one in design.measurements:
        for i, row in enumerate(one.C if rows is None else one.C @ rows, 1):
            at_trim = sum(x * trim[name] for x, name in zip(row.tolist(), names, strict=True) if x)
            found[f"trim.{one.name}[{i}]"] = float(at_trim)
    return found


def sensor_departures(system: System, sensors: Mapping[str, Sensed]) -> Iterator[Departure]:
    """Yield errors of sensors beyond what the design counts with: noise, and any bias."""
    for sensed in sensors.values():
        own = _values(system.components[sensed.component])
        for input_name, (one, k) in sensed.values.items():
            place, size = f"{sensed.component}.", one.noise[k]
            noise, bias = own.get(f"noise{input_name[1:]}"), own.get(f"bias{input_name[1:]}")
            if noise is None or not noise <= size * (1 + 1e-12):
                expected = f"at most {size:g}, as designed" if size else "0, as designed"
                yield Departure(f"{place}noise{input_name[1:]}", expected, f"{noise}")
            if bias != 0:
                yield Departure(f"{place}bias{input_name[1:]}", "0", f"{bias}")


def _values(component: Component) -> dict[str, Any]:
    """Return the values of a component's parameters; None where one is not known."""
    return {
        name: component.start_of(name)
        for name, port in component.description.ports.items()
        if port.causality == "parameter"
    }
