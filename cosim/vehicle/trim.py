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
from cosim.vehicle.computable import computable, finite
from cosim.vehicle.vehicle import Vehicle

_TURNS = 60
_STEP = 1e-6
_LARGEST_RATE = 1e-9
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


@computable("trim")
def find_trim(vehicle: Vehicle) -> Trim:
    """Return the trim of a vehicle, verified with its equations.

        >>> from cosim.vehicle import find_trim, load_vehicle
        >>> trim = find_trim(load_vehicle("remus100"))
        >>> trim.state["nu.u"], round(trim.commands["thruster.propeller"], 1), trim.residual < 1e-9
        (1.5, 13.8, True)

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
    motion = _Motion(vehicle)
    y = np.zeros(len(motion.scale))
    for _ in range(_TURNS):
        now = motion.left(y)
        if np.abs(now).max() <= 1e-14 or not np.isfinite(now).all():
            break
        pairs = [(y + step, y - step) for step in _STEP * np.eye(len(y))]
        slopes = [(motion.left(a) - motion.left(b)) / (2 * _STEP) for a, b in pairs]
        y = y - np.linalg.lstsq(finite(np.array(slopes).T, "trim"), now, rcond=1e-10)[0]
    residual = motion.left(y)
    worst = int(np.argmax(np.abs(residual)))
    if not abs(residual[worst]) <= _LARGEST_RATE:
        raise NotAchievableError(
            "nothing holds the trim",
            where="trim",
            expected="actuators and an attitude that keep every velocity and the depth constant",
            got=f"{vehicle.states[motion.rows[worst]]}' = {residual[worst]:.3g} is left",
        )
    x, u = motion.at(y)
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


class _Motion:
    """The motion of a vehicle in what is free at a trim: its actuators, then some states.

    rows : states whose rates must be zero.
    scale : of what is free.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle, self._places = vehicle, {name: i for i, name in enumerate(vehicle.states)}
        self.rows = [self._places[name] for name in ("eta.z", *vehicle.velocities)]
        across = ("nu.v", "nu.w") if any(vehicle.trim.values()) else ()
        free = [name for name in ("eta.phi", "eta.theta", *across) if name not in vehicle.trim]
        self._free = [self._places[name] for name in free if name in self._places]
        limits = [actuator.limit for actuator in vehicle.actuators]
        self.scale = np.array([*limits, *[1.0] * len(self._free)])
        self._start = [vehicle.trim.get(name, 0.0) for name in vehicle.states]

    def at(self, y: NDArray[np.float64]) -> tuple[list[float], list[float]]:
        """Return state and inputs at y, in share of `scale`."""
        values = (y * self.scale).tolist()
        count = len(self._vehicle.actuators)
        x, u = list(self._start), values[:count]
        for place, value in zip(self._free, values[count:], strict=True):
            x[place] = value
        for actuator, value in zip(self._vehicle.actuators, u, strict=True):
            if actuator.lag:
                x[self._places[f"actual.{actuator.name}"]] = value
        return x, [*u, *[0.0] * (len(self._vehicle.inputs) - count)]

    def left(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rates that must be zero."""
        x, u = self.at(y)
        rates = self._vehicle.rates(x, x if self._vehicle.damping else (), u)
        return np.array([rates[i] for i in self.rows])
