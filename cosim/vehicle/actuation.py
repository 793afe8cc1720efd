"""From what a design commands to what the actuators of a vehicle are told.

An actuator that mainly drives an uncontrolled surge stays at the trim. Where the others can give
the controlled velocities any acceleration, the design commands accelerations, and the thrust map is
the least-squares one, actuators counted in share of their limits; accelerations of the other
velocities are kept at zero where the actuators can do that too. Otherwise the design commands the
actuators, in share of their limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.models import FloatFunctions
from cosim.vehicle.computable import computable, finite
from cosim.vehicle.trim import Trim
from cosim.vehicle.vehicle import Vehicle

Matrix = NDArray[np.float64]

_RANK = 1e-8
MAINLY = 0.3
"""Least effect of an actuator on a controlled velocity, as a share of that on surge, each in shares
of the envelope: a propeller that also pitches the vehicle a little is not for pitching."""


@dataclass(frozen=True, eq=False)
class Actuation:
    """commands = at_trim + thrust_map u.

    Attributes
    ----------
    actuators : FMI names of the commands, (k,).
    at_trim, limits : (k,), in the units of the commands.
    thrust_map : (k, m).
    commands : name of each entry of u: a velocity, or an actuator.
    accelerations : whether u are accelerations, not shares of a limit.
    lags : (k,) [s].
    """

    actuators: tuple[str, ...]
    at_trim: Matrix
    limits: Matrix
    thrust_map: Matrix
    commands: tuple[str, ...]
    accelerations: bool
    lags: Matrix

    @property
    def used(self) -> Matrix:
        """Whether an entry of u moves each actuator (k,); the others stay at the trim."""
        return np.asarray(self.thrust_map.any(axis=1))

    @property
    def common_lag(self) -> float | None:
        """The lag of all actuators in use; None where they differ."""
        lags = set(self.lags[self.used].tolist())
        return lags.pop() if len(lags) == 1 else None

    @property
    def authority(self) -> Matrix:
        """Magnitude (m,) of each entry of u, alone, at which the first actuator is at its limit."""
        left = (self.limits - np.abs(self.at_trim))[:, None]
        size = np.abs(self.thrust_map)
        shares = np.divide(left, size, out=np.full(size.shape, np.inf), where=size > 0)
        return np.asarray(shares.min(axis=0))


@computable("actuators")
def actuation_of(vehicle: Vehicle, trim: Trim, velocities: Sequence[str]) -> Actuation:
    """Return how the controlled velocities ("nu.u", ...) of a vehicle are commanded.

    Raises
    ------
    InputError : no actuator moves any of them.
    """
    effects = command_effect(vehicle, trim)
    limits = np.array([a.limit for a in vehicle.actuators])
    every = vehicle.velocities
    places = [every.index(name) for name in velocities]
    scaled = effects * limits
    bounds = np.array([vehicle.envelope.get(name, 1.0) for name in every])
    shares = np.abs(scaled) / bounds[:, None]
    controlled, ahead = shares[places].max(axis=0, initial=0.0), shares[every.index("nu.u")]
    moving = controlled > np.maximum(_RANK, MAINLY * ahead)
    scaled = scaled * moving
    k = len(limits)
    accelerations = _rank(scaled[places]) == len(places) > 0
    if accelerations:
        full_rank = _rank(scaled) == len(every)
        rows = range(len(every)) if full_rank else places
        inverse = limits[:, None] * np.linalg.pinv(scaled[list(rows)], rcond=_RANK)
        allocation = inverse[:, places] if full_rank else inverse
        allocation = np.where(
            np.abs(allocation) > 1e-10 * np.abs(allocation).max(), allocation, 0.0
        )
        commands = tuple(velocities)
    else:
        if not moving.any():
            raise InputError(
                "no actuator moves a controlled velocity",
                where="control.states",
                got=", ".join(velocities) or "no velocity",
            )
        allocation = (np.eye(k) * limits)[:, moving]
        commands = tuple(
            a.command for a, moves in zip(vehicle.actuators, moving, strict=True) if moves
        )
    return Actuation(
        tuple(a.command for a in vehicle.actuators),
        np.array([trim.commands[a.command] for a in vehicle.actuators]),
        limits,
        allocation,
        commands,
        accelerations,
        np.array([a.lag for a in vehicle.actuators]),
    )


def _rank(matrix: Matrix) -> int:
    return int(
        np.linalg.matrix_rank(matrix, tol=_RANK * max(np.abs(matrix).max(initial=0.0), 1e-6))
    )


@computable("actuators")
def command_effect(vehicle: Vehicle, trim: Trim) -> Matrix:
    """Return the acceleration of each velocity per thrust or angle at the trim, (velocities, k).

    Forces are at most quadratic in what an actuator does: a central difference is exact.
    """
    x = [trim.state[name] for name in vehicle.states]
    u = [trim.commands.get(name, 0.0) for name in vehicle.inputs]
    rows = [vehicle.states.index(name) for name in vehicle.velocities]
    columns = []
    for actuator in vehicle.actuators:
        ends = []
        for sign in (1.0, -1.0):
            y, v = list(x), list(u)
            step = sign * (actuator.limit - abs(trim.commands[actuator.command])) / 2
            if actuator.lag:
                y[vehicle.states.index(f"actual.{actuator.name}")] += step
            else:
                v[vehicle.inputs.index(actuator.command)] += step
            rates = vehicle.rates(y, x if vehicle.damping else (), v, FloatFunctions)
            ends.append(np.array([rates[i] for i in rows]) / (2 * step))
        columns.append(ends[0] + ends[1])
    return finite(np.array(columns).T.reshape(len(rows), len(vehicle.actuators)), "actuators")
