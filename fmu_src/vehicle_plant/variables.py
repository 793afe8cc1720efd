"""FMI variables of the plant of a vehicle file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.fmu.export import ComponentSpec, Variable, round_below, solver_step
from cosim.models import FloatFunctions, VehicleEquations

_LONGEST, _SHORTEST, _SHARE = 0.05, 1e-4, 0.2
"""Internal step [s]: at most, at least, and as a share of the shortest time constant."""
_STIR = 0.5
"""Velocities at which the time constants are taken as well, beside the trim [m/s, rad/s]."""
_STATE_TEXT = {
    "eta.x": ("m", "position north, earth frame"),
    "eta.y": ("m", "position east, earth frame"),
    "eta.z": ("m", "depth, earth frame (down positive)"),
    "eta.phi": ("rad", "roll angle"),
    "eta.theta": ("rad", "pitch angle"),
    "eta.psi": ("rad", "heading"),
    "nu.u": ("m/s", "surge speed, body frame"),
    "nu.v": ("m/s", "sway speed, body frame"),
    "nu.w": ("m/s", "heave speed, body frame (down positive)"),
    "nu.p": ("rad/s", "roll rate"),
    "nu.q": ("rad/s", "pitch rate"),
    "nu.r": ("rad/s", "yaw rate"),
    **{f"quaternion.q{i}": (None, f"q{i} of the attitude, q0 its real part") for i in range(4)},
}
_AXES = {"u": "surge", "v": "sway", "w": "heave", "p": "roll", "q": "pitch", "r": "yaw"}


def vehicle_plant_spec(vehicle: Any, *, name: str) -> ComponentSpec:
    """Specify the plant FMU of a vehicle: its numbers are start values, its terms are fixed.

    Parameters
    ----------
    vehicle : a `cosim.vehicle.Vehicle`, or its `PlantRecord`.
    name : of the model.
    """
    equations = VehicleEquations(vehicle.terms)
    step = default_step(vehicle, equations)
    return ComponentSpec(
        name=name,
        description=f"Vehicle {vehicle.name} in {vehicle.degrees_of_freedom} degrees of freedom",
        variables=tuple(_variables(vehicle, equations, step)),
        behaviour="cosim.components.vehicle_plant.behaviour:VehiclePlant",
        sources=(
            "cosim.models.delay_line",
            "cosim.models.vehicle_attitude",
            "cosim.models.vehicle_inertia",
            "cosim.models.vehicle_forces",
            "cosim.models.vehicle_actuators",
            "cosim.models.vehicle",
            "cosim.fmu.export.python.delay_plant",
            "cosim.components.vehicle_plant.behaviour",
        ),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=60.0,
        step_size=0.05,
        constants={"terms": {**vehicle.terms}},
        notes=_notes(vehicle),
    )


class _Actuator(NamedTuple):
    """What the FMU needs of a thruster or a fin."""

    name: str
    command: str
    unit: str
    limit: float


class _Parameter(NamedTuple):
    """A row of the parameter table."""

    name: str
    value: float
    unit: str | None
    text: str
    least: float | None


class PlantRecord(NamedTuple):
    """What a plant FMU is made from, as JSON values: a design keeps it beside its proof."""

    name: str
    description: str
    source: str
    degrees_of_freedom: int
    terms: dict[str, Any]
    trim: dict[str, float]
    actuators: list[_Actuator]
    parameter_table: list[_Parameter]


def plant_record(vehicle: Any) -> dict[str, Any]:
    """Return what the plant FMU of a `cosim.vehicle.Vehicle` is made from, as JSON values."""
    rows = {
        "actuators": [[a.name, a.command, a.unit, a.limit] for a in vehicle.actuators],
        "parameter_table": [list(row) for row in vehicle.parameter_table],
    }
    tables = {"terms": dict(vehicle.terms), "trim": dict(vehicle.trim)}
    words = {key: getattr(vehicle, key) for key in PlantRecord._fields[:4]}
    return {**words, **tables, **rows}


def record_from_json(data: Any) -> PlantRecord:
    """Read what `plant_record` returns; KeyError or TypeError for anything else."""
    rows = {
        "actuators": [_Actuator(*row) for row in data["actuators"]],
        "parameter_table": [_Parameter(*row) for row in data["parameter_table"]],
    }
    return PlantRecord(**{**data, **rows})


def unit_of_state(name: str) -> str | None:
    """Return the unit of a state of a vehicle by its FMI name; None where it has none."""
    return _STATE_TEXT.get(name, (None, ""))[0]


def initial_state(vehicle: Any, equations: VehicleEquations) -> dict[str, float]:
    """Return the start values of the states: level at the origin, at the speed of the trim."""
    start = dict.fromkeys(equations.states, 0.0)
    if "quaternion.q0" in start:
        start["quaternion.q0"] = 1.0
    return start | dict(vehicle.trim)


def default_step(vehicle: Any, equations: VehicleEquations) -> float:
    """Return the start value of `solver.step` [s].

    It is the largest of 1, 2, 5 times a power of ten up to 0.05 s that is at most 0.2 times the
    shortest time constant, the inverse of the greatest root of the linearised equations at the trim
    and with all velocities off it by 0.5.
    """
    p = {each.name: each.value for each in vehicle.parameter_table}
    constants = equations.constants(p)
    u = [0.0] * len(equations.inputs)
    start = initial_state(vehicle, equations)
    still = np.array(list(start.values()))
    moving = still + [_STIR * name.startswith("nu.") for name in start]

    def rates(x: Any) -> Any:
        values = x.tolist()
        return np.array(equations.rates(values, values, u, constants, FloatFunctions))

    fastest = 0.0
    for point in (still, moving):
        steps = np.eye(len(point)) * 1e-5
        columns = [(rates(point + h) - rates(point - h)) / 2e-5 for h in steps]
        fastest = max(fastest, float(np.abs(np.linalg.eigvals(np.array(columns).T)).max()))
    longest = min(_LONGEST, max(_SHARE / fastest, _SHORTEST)) if fastest > 0 else _LONGEST
    return round_below(longest * (1 + 1e-9))


class _Text(NamedTuple):
    unit: str | None
    text: str


def _variables(vehicle: Any, equations: VehicleEquations, step: float) -> list[Variable]:
    texts = {name: _Text(*of) for name, of in _STATE_TEXT.items()}
    for a in vehicle.actuators:
        what = "angle" if a.unit == "rad" else "moment" if a.unit == "N.m" else "thrust"
        texts[a.command] = _Text(a.unit, f"command of {a.name}: its {what}")
        texts[f"actual.{a.name}"] = _Text(a.unit, f"{what} of {a.name} after its lag")
    for axis, side in (("x", "north"), ("y", "east"), ("z", "down")):
        texts[f"current.{axis}"] = _Text("m/s", f"current towards {side}, earth frame")
    for letter, word in _AXES.items():
        unit = "rad/s2" if letter in "pqr" else "m/s2"
        texts[f"disturbance.{letter}"] = _Text(unit, f"{word} acceleration by waves")
    start = initial_state(vehicle, equations)
    angles = {} if "quaternion.q0" not in start else dict.fromkeys(("phi", "theta", "psi"), 0.0)
    outputs = {**start, **{f"eta.{angle}": value for angle, value in angles.items()}}
    table = [
        Variable(name, "input", texts[name].text, texts[name].unit) for name in equations.inputs
    ]
    table += [
        Variable(name, "output", texts[name].text, texts[name].unit, value)
        for name, value in outputs.items()
    ]
    table += [
        Variable(each.name, "parameter", each.text, each.unit, each.value, minimum=each.least)
        for each in vehicle.parameter_table
    ]
    table += [
        Variable(
            f"initial.{name}",
            "parameter",
            f"{texts[name].text}, for all t <= start",
            texts[name].unit,
            value,
        )
        for name, value in start.items()
    ]
    return [*table, solver_step(step)]


def _notes(vehicle: Any) -> str:
    """Return the part of the page on this vehicle."""
    source = f"Source: {vehicle.source}" if vehicle.source else ""
    lines = [f"## The vehicle {vehicle.name}", vehicle.description, source]
    return "\n\n".join(line for line in lines if line) + "\n"
