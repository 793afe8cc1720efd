"""Trim of a vehicle: the attitude and the commands that hold a steady motion.

The velocities of the trim are given; the others are zero, but at speed those across the hull (v, w)
are found with roll, pitch and the actuators, so that no velocity and not the depth changes. Of all
solutions the smallest is taken, actuators counted in share of their limits: Newton's method with
least steps, from rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, NotAchievableError
from cosim.models import FloatFunctions
from cosim.vehicle.vehicle import Vehicle

_TURNS = 60
_STEP = 1e-6
_HELD = 1e-9
"""Largest rate that is left of a trim [m/s2, rad/s2, m/s]."""


@dataclass(frozen=True)
class Trim:
    """A steady motion.

    Attributes
    ----------
    state : state by FMI name -> value; an actuator with a lag is at its command.
    commands : command of an actuator by FMI name -> value.
    residual : the largest rate that is left [m/s2, rad/s2, m/s].
    """

    state: Mapping[str, float]
    commands: Mapping[str, float]
    residual: float


def find_trim(vehicle: Vehicle) -> Trim:
    """Return the trim of a vehicle, verified with its equations.

    Raises
    ------
    InputError : its attitude is a quaternion: Euler angles are needed.
    NotAchievableError : no attitude and no actuators hold the motion; names what is left, or the
        actuator whose limit is too small.
    """
    if vehicle.attitude == "quaternion":
        raise InputError(
            "a vehicle with a quaternion has no linear model",
            where="attitude",
            expected='"euler": a steady motion has a pitch below 90 degrees',
            got='"quaternion"',
        )
    places = {name: i for i, name in enumerate(vehicle.states)}
    held = [i for name, i in places.items() if name.startswith("nu.") or name == "eta.z"]
    moving = any(vehicle.trim.values())
    free = ["eta.phi", "eta.theta", *(("nu.v", "nu.w") if moving else ())]
    angles = [name for name in free if name in places and name not in vehicle.trim]
    count, limits = len(vehicle.actuators), [a.limit for a in vehicle.actuators]
    scale = np.array([*limits, *(1.0 for _ in angles)])
    start = np.zeros(len(places))
    for name, value in vehicle.trim.items():
        start[places[name]] = value

    def whole(y: NDArray[np.float64]) -> tuple[list[float], list[float]]:
        x, u = start.copy(), [*(y[:count] * scale[:count]), *[0.0] * (len(vehicle.inputs) - count)]
        for name, value in zip(angles, y[count:], strict=True):
            x[places[name]] = value
        for actuator, value in zip(vehicle.actuators, u[:count], strict=True):
            if actuator.lag:
                x[places[f"actual.{actuator.name}"]] = value
        return x.tolist(), [float(value) for value in u]

    def left(y: NDArray[np.float64]) -> NDArray[np.float64]:
        x, u = whole(y)
        rates = vehicle.rates(x, x if vehicle.damping else (), u, FloatFunctions)
        return np.array([rates[i] for i in held])

    y = np.zeros(len(scale))
    for _ in range(_TURNS):
        now = left(y)
        if np.abs(now).max() <= 1e-14:
            break
        slopes = [
            (left(y + _STEP * one) - left(y - _STEP * one)) / (2 * _STEP) for one in np.eye(len(y))
        ]
        y = y - np.linalg.lstsq(np.array(slopes).T, now, rcond=1e-10)[0]
    residual = left(y)
    x, u = whole(y)
    worst = int(np.argmax(np.abs(residual)))
    if not abs(residual[worst]) <= _HELD:
        raise NotAchievableError(
            "nothing holds the trim",
            where="trim",
            expected="actuators and an attitude that keep every velocity and the depth constant",
            got=f"{vehicle.states[held[worst]]}' = {residual[worst]:.3g} is left",
        )
    for actuator, value in zip(vehicle.actuators, u, strict=False):
        if abs(value) >= actuator.limit:
            raise NotAchievableError(
                "the trim is beyond the limit of an actuator",
                where=actuator.command,
                expected=f"less than {actuator.limit:g} {actuator.unit}",
                got=f"{value:.6g} {actuator.unit}",
            )
    return Trim(
        MappingProxyType(dict(zip(vehicle.states, x, strict=True))),
        MappingProxyType({a.command: v for a, v in zip(vehicle.actuators, u, strict=False)}),
        float(np.abs(residual).max()),
    )
