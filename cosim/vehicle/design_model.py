"""The linear model that a flight is designed for: `check` judges it, `fly` begins with it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from cosim.core import CosimError, InputError, NotAchievableError, parse_toml
from cosim.vehicle.flight_plan import FlightSettings, planned_sensors
from cosim.vehicle.linearisation import LinearModel, linear_model
from cosim.vehicle.read import vehicle_from_toml
from cosim.vehicle.vehicle import Vehicle

LAG_OF_FINS = 0.1
"""Lag of a fin whose file gives none [s]."""

_FINS = re.compile(r"\s*\[\[\s*fins\s*\]\]")
Say = Callable[[str], None]


def as_designed_for(vehicle: Vehicle, say: Say) -> Vehicle:
    """Return a vehicle that can be designed for: Euler angles, and a lag of every fin.

    The effect of a fin without a lag would depend on the speed, and commands must not.
    """
    text = vehicle.text
    if vehicle.attitude == "quaternion":
        text = re.sub(r"""(?m)^\s*attitude\s*=\s*(["'])quaternion\1""", 'attitude = "euler"', text)
        say("Euler angles in place of the quaternion: they are defined within the envelope")
    fins = iter(parse_toml(text, vehicle.name).get("fins", []))
    lines = []
    for line in text.splitlines():
        lines.append(line)
        if _FINS.match(line) and "lag" not in next(fins, {"lag": 0}):
            lines.append(f"lag = {LAG_OF_FINS}")
    if len(lines) > len(text.splitlines()):
        say(f"the file gives fins no lag: {LAG_OF_FINS:g} s")
    text = "\n".join(lines) + "\n"
    if text.strip() == vehicle.text.strip():
        return vehicle
    return vehicle_from_toml(text, where=vehicle.name)


def flight_model(
    craft: Vehicle, settings: FlightSettings | None = None
) -> tuple[LinearModel | None, list[CosimError]]:
    """Return the linear model of a vehicle `as_designed_for`, and why nothing can be designed.

    The model is None where there is none; with any refusal nothing is designed.
    """
    refused: list[CosimError] = list(_not_observed(craft))
    try:
        model = linear_model(craft)
        planned_sensors(craft.sensors, model.states, settings or FlightSettings())
    except (InputError, NotAchievableError) as error:
        return None, [*refused, error]
    return model, refused


def _not_observed(vehicle: Vehicle) -> Iterator[InputError]:
    """Yield the controlled states that are neither measured nor follow from what is.

    A velocity follows from its position or angle; at speed, pitch and heave from the depth, and
    sway from the turn.
    """
    measured = {name for sensor in vehicle.sensors for name in sensor.measures}
    of_rate = {"u": "x", "v": "y", "w": "z", "p": "phi", "q": "theta", "r": "psi"}
    observed = {f"nu.{rate}" for rate, place in of_rate.items() if f"eta.{place}" in measured}
    if vehicle.trim and "eta.z" in measured:
        observed |= {"eta.theta", "nu.w", "nu.q"}
    if vehicle.trim and measured & {"eta.psi", "nu.r"}:
        observed.add("nu.v")
    for name in vehicle.control.states:
        if name not in measured | observed:
            yield InputError(
                "a controlled state cannot be estimated from what the sensors measure",
                where=f"sensors: {name}",
                expected="a sensor that measures it, or a position or angle that follows from it",
                hint=f'measures = ["{name}"] in a [[sensors]], or [control] states without it',
            )
