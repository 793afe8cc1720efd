"""Parameters of a vehicle by FMI name, and the terms that its equations have."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

from cosim.models import Derivative, derivative_named, effect_of
from cosim.vehicle.schema import FinPart, VehicleFile

LEAST = 1e-9
"""Least value of a parameter that must be positive."""
_HOERNER = (
    *((0.0109, 1.9661), (0.1766, 1.9657), (0.3530, 1.8976), (0.4519, 1.7872), (0.4728, 1.5837)),
    *((0.4929, 1.2786), (0.4933, 1.2108), (0.5585, 1.0836), (0.6464, 0.9986), (0.8336, 0.8796)),
    *((0.9880, 0.8284), (1.3081, 0.7599), (1.6392, 0.6914), (1.8600, 0.6571), (2.3129, 0.6307)),
    *((2.6000, 0.5962), (3.0088, 0.5868), (3.4508, 0.5859), (3.7379, 0.5599), (4.0031, 0.5593)),
)
"""Breadth over twice the draught -> drag coefficient of a section (Hoerner 1965, as in MSS)."""


class Parameter(NamedTuple):
    """A parameter of the plant: FMI name, value, unit, meaning, least value."""

    name: str
    value: float
    unit: str | None
    text: str
    least: float | None = None


def hoerner(breadth: float, draught: float) -> float:
    """Return the cross-flow drag coefficient of a section, interpolated on Hoerner's curve."""
    at = breadth / (2 * draught)
    if at <= _HOERNER[0][0]:
        return _HOERNER[0][1]
    for (x0, y0), (x1, y1) in pairwise(_HOERNER):
        if at <= x1:
            return y0 + (y1 - y0) * ((at - x0) / (x1 - x0))
    return _HOERNER[-1][1]


def terms_of(file: VehicleFile) -> dict[str, Any]:
    """Return the terms that the equations of a vehicle have (`cosim.models.VehicleEquations`)."""
    level = file.degrees_of_freedom == 4
    body, hydro, flow, wing = file.body, file.hydro, file.cross_flow, file.lift_drag
    r_g = _named("xy" if level else "xyz", body.r_g)
    r_b = [] if level else _named("xyz", body.r_b)
    weighs = body.buoyancy is not None or (not level and (r_g or r_b))
    weight = "given" if body.weight is not None else "gravity"
    return {
        "degrees_of_freedom": file.degrees_of_freedom,
        "attitude": file.attitude,
        "r_g": r_g,
        "r_b": r_b,
        "inertia": ["z"] if level else [name for name, _ in _inertia(file)],
        "weight": weight if weighs else None,
        "buoyancy": "weight" if body.buoyancy is None else "given",
        "prime": hydro.prime,
        "derivatives": [d.name for d, _ in hydro_derivatives(file)],
        "fading": [_canonical(name) for name in hydro.fading],
        "coriolis": hydro.coriolis,
        "coriolis_without": hydro.coriolis_without,
        "rigid_body_coriolis": hydro.rigid_body_coriolis,
        "current": hydro.current,
        "cross_flow": None
        if flow is None
        else {
            "planes": [p for p, cd in zip(("sway", "heave"), _drag(file), strict=True) if cd],
            "strips": flow.strips,
            "rule": flow.rule,
            "coupled": flow.coupled,
            "pitch": flow.pitch,
        },
        "lift_drag": None
        if wing is None
        else {"slope": wing.slope is not None, "stall": wing.stall > 0},
        "damping": [] if file.onboard_damping is None else list(file.onboard_damping.rates),
        "thrusters": [
            {
                "name": t.name,
                "effects": list(effect_of(t.direction, t.position, t.moment)),
                "lag": t.lag > 0,
            }
            for t in file.thrusters
        ],
        "fins": [_fin_terms(fin) for fin in file.fins],
    }


def _fin_terms(fin: FinPart) -> dict[str, Any]:
    return {
        "name": fin.name,
        "area": fin.area is not None,
        "drag": fin.drag > 0,
        "direction": _named("xyz", fin.direction or []),
        "position": _named("xyz", fin.position),
        "derivatives": [_canonical(name) for name in fin.derivatives],
        "lag": fin.lag > 0,
    }


def parameters_of(file: VehicleFile) -> list[Parameter]:
    """Return the parameters of a vehicle, in the order of its plant FMU."""
    return [
        *_of_body(file),
        *_of_hydro(file),
        *_of_hull(file),
        *_of_actuators(file),
        *_of_damping(file),
    ]


def hydro_derivatives(file: VehicleFile) -> list[tuple[Derivative, float]]:
    """Return the derivatives of [hydro] that exist, with their numbers."""
    given = file.hydro.__pydantic_extra__ or {}
    named = [(derivative_named(name), float(value)) for name, value in given.items()]
    return [(d, value) for d, value in named if d is not None]


def dimension_of(of: Derivative) -> str:
    """Return the unit of a dimensional derivative."""
    length = of.power - 2 - (1 if of.dot else 0)
    factors = 2 if of.dot else len(of.factors)
    if of.dot:
        return _unit(length, 0)
    # [N or N m] per (m/s)^factors; angular ones have a metre less below
    return _unit(length + 1 - factors, 2 - factors)


def _unit(metres: int, seconds: int) -> str:
    head = "kg" + ("" if metres <= 0 else ".m" if metres == 1 else f".m{metres}")
    below = [*(["m" if metres == -1 else f"m{-metres}"] if metres < 0 else [])]
    below += [] if seconds == 0 else ["s" if seconds == 1 else f"s{seconds}"]
    return "/".join([head, *below])


def _of_body(file: VehicleFile) -> Iterator[Parameter]:
    body, terms = file.body, terms_of(file)
    yield Parameter("mass", body.mass, "kg", "dry mass m", LEAST)
    inertia = dict(_inertia(file))
    for name in terms["inertia"]:
        of = f"moment of inertia I_{name}" if len(name) == 1 else f"entry {name} of the inertia"
        least = LEAST if len(name) == 1 else None
        yield Parameter(f"inertia.{name}", inertia[name], "kg.m2", f"{of} about the origin", least)
    for key, text in (("r_g", "centre of gravity"), ("r_b", "centre of buoyancy")):
        for axis in terms[key]:
            value = getattr(body, key)["xyz".index(axis)]
            yield Parameter(f"{key}.{axis}", value, "m", f"{axis} of the {text}")
    if terms["weight"] == "given" and body.weight is not None:
        yield Parameter("weight", body.weight, "N", "weight W", 0.0)
    elif terms["weight"] == "gravity":
        yield Parameter("gravity", body.gravity, "m/s2", "acceleration of gravity", 0.0)
    if terms["weight"] is not None and body.buoyancy is not None:
        yield Parameter("buoyancy", body.buoyancy, "N", "buoyancy B", 0.0)
    if body.density is not None and needs_density(file):
        yield Parameter("density", body.density, "kg/m3", "density of water", LEAST)
    if body.length is not None and file.hydro.prime:
        yield Parameter("length", body.length, "m", "length L of the vehicle", LEAST)


def needs_density(file: VehicleFile) -> bool:
    """Return whether a term of the vehicle depends on the density of the water."""
    fins = any(fin.area is not None for fin in file.fins)
    return file.hydro.prime or fins or file.cross_flow is not None or file.lift_drag is not None


def _of_hydro(file: VehicleFile) -> Iterator[Parameter]:
    hydro = file.hydro
    if hydro.reference_speed is not None:
        text = "speed U of linear derivatives in the prime system"
        yield Parameter("hydro.reference_speed", hydro.reference_speed, "m/s", text, LEAST)
    for d, value in hydro_derivatives(file):
        unit = None if hydro.prime else dimension_of(d)
        text = f"hydrodynamic derivative {d.name}"
        yield Parameter(f"hydro.{d.parameter}", value, unit, text)
    for name, value in hydro.fading.items():
        d = _derivative(name)
        text = f"{d.name} is multiplied by exp(-this times the speed)"
        yield Parameter(f"fading.{d.parameter}", value, "s/m", text, 0.0)


def _of_hull(file: VehicleFile) -> Iterator[Parameter]:
    flow, wing = file.cross_flow, file.lift_drag
    if flow is not None:
        length = flow.length or file.body.length or math.nan
        yield Parameter("cross_flow.length", length, "m", "length of the hull", LEAST)
        for plane, side, value, cd in zip(
            ("sway", "heave"),
            ("height", "breadth"),
            (flow.height, flow.breadth),
            _drag(file),
            strict=True,
        ):
            if cd:
                yield Parameter(f"cross_flow.{side}", value, "m", f"{side} of the hull", LEAST)
                text = f"drag coefficient of a strip in {plane}"
                yield Parameter(f"cross_flow.drag_{plane}", cd, None, text, 0.0)
        if flow.softening is not None:
            text = "speed that keeps the direction of the drag defined at rest"
            yield Parameter("cross_flow.softening", flow.softening, "m/s", text, LEAST)
    if wing is not None:
        yield Parameter("lift_drag.span", wing.span, "m", "span of the body as a wing", LEAST)
        yield Parameter("lift_drag.area", wing.area, "m2", "area of the body as a wing", LEAST)
        text = "drag coefficient at no angle of attack"
        yield Parameter("lift_drag.drag", wing.drag, None, text, 0.0)
        yield Parameter("lift_drag.oswald", wing.oswald, None, "Oswald efficiency", LEAST)
        if wing.slope is not None:
            yield Parameter("lift_drag.slope", wing.slope, None, "slope of the lift coefficient")
        if wing.stall:
            yield Parameter("lift_drag.stall", wing.stall, None, "blending of the lift", 0.0)


def _of_actuators(file: VehicleFile) -> Iterator[Parameter]:
    for t in file.thrusters:
        unit = "N" if any(t.direction) else "N.m"
        yield Parameter(f"limit.{t.name}", t.limit, unit, f"largest command of {t.name}", 0.0)
        yield from _lag(t.name, t.lag)
        for letter, value in effect_of(t.direction, t.position, t.moment).items():
            per = "m" if letter in "KMN" and any(t.direction) else None
            text = f"{letter} per thrust of {t.name}"
            yield Parameter(f"effect.{t.name}.{letter}", value, per, text)
    for fin in file.fins:
        yield Parameter(f"limit.{fin.name}", fin.limit, "rad", f"largest angle of {fin.name}", 0.0)
        yield from _lag(fin.name, fin.lag)
        if fin.area is not None and fin.lift is not None:
            yield Parameter(f"area.{fin.name}", fin.area, "m2", f"area of {fin.name}", LEAST)
            text = f"slope of the lift coefficient of {fin.name}"
            yield Parameter(f"lift.{fin.name}", fin.lift, None, text)
            if fin.drag:
                text = f"drag coefficient of {fin.name} per squared angle"
                yield Parameter(f"drag.{fin.name}", fin.drag, None, text, 0.0)
            for key, values in (("direction", fin.direction or []), ("position", fin.position)):
                for axis in _named("xyz", values):
                    text = f"{axis} of the {key} of {fin.name}'s lift"
                    value, metres = values["xyz".index(axis)], "m" if key == "position" else None
                    yield Parameter(f"{key}.{fin.name}.{axis}", value, metres, text)
        for name, value in fin.derivatives.items():
            d = _derivative(name)
            dimension = None if file.hydro.prime else dimension_of(d)
            text = f"derivative {d.name} of {fin.name}"
            yield Parameter(f"derivative.{fin.name}.{d.parameter}", value, dimension, text)


def _lag(name: str, lag: float) -> Iterator[Parameter]:
    if lag > 0:
        text = f"time constant of {name} behind its command"
        yield Parameter(f"lag.{name}", lag, "s", text, LEAST)


def _of_damping(file: VehicleFile) -> Iterator[Parameter]:
    if file.onboard_damping is not None:
        for axis, value in file.onboard_damping.rates.items():
            text = f"gain of the onboard damping loop on nu.{axis}(t - delay.d)"
            yield Parameter(f"damping.{axis}", value, "1/s", text, 0.0)
        text = "age of the damping loop's data"
        yield Parameter("delay.d", file.onboard_damping.delay, "s", text, 0.0)


def _drag(file: VehicleFile) -> tuple[float, float]:
    flow = file.cross_flow
    if flow is None:
        return 0.0, 0.0
    if flow.drag == "hoerner":
        return hoerner(flow.breadth, flow.height), hoerner(flow.height, flow.breadth)
    sway, heave = flow.drag
    return float(sway), float(heave)


def _inertia(file: VehicleFile) -> list[tuple[str, float]]:
    """Return the entries of the inertia about the origin that are not zero, by name."""
    body = file.body
    rows: Any = body.inertia
    full = isinstance(rows[0], list)
    matrix = [
        [float(rows[i][j] if full else rows[i] * (i == j)) for j in range(3)] for i in range(3)
    ]
    if body.inertia_about == "centre-of-gravity":
        square = sum(x * x for x in body.r_g)
        for i in range(3):
            for j in range(3):
                matrix[i][j] += body.mass * (square * (i == j) - body.r_g[i] * body.r_g[j])
    names = (("x", 0, 0), ("y", 1, 1), ("z", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2))
    return [(name, matrix[i][j]) for name, i, j in names if matrix[i][j] or i == j]


def _named(axes: str, values: Any) -> list[str]:
    return [axis for axis, value in zip(axes, values, strict=False) if value]


def _canonical(name: str) -> str:
    return _derivative(name).name


def _derivative(name: str) -> Derivative:
    derivative = derivative_named(name)
    if derivative is None:
        raise KeyError(name)
    return derivative
