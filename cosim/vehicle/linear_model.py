"""The linear uncertain model of a vehicle about its trim, proved over its envelope.

With y the deviation of the controlled states and of the actuators with a lag, o that of all other
states and of the current, each within its bound,

    f(x0 + y + o) = [f(x0 + o) - f(x0)] + (A + dA(y, o)) y + A1 y(t-d) + B u,   dA = E F H,

is exact: dA is the mean of the derivative along a path (`cosim.hinf`), enclosed over the whole box.
The first bracket is not proportional to y: it is a disturbance, and `disturbance` bounds it by row.
Among o is the current: drag acts on the velocity through the water, so a current adds both to dA
and to the disturbance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.core import InputError
from cosim.models import Delay, DelaySystem
from cosim.vehicle.actuation import Actuation, actuation_of
from cosim.vehicle.trim import Trim, find_trim
from cosim.vehicle.vehicle import Vehicle

Matrix = NDArray[np.float64]

POSITION_WEIGHT = 0.1
"""Weight in z of a controlled position or angle without one in the file [1/s2]."""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A vehicle as a `DelaySystem`.

    Attributes
    ----------
    system : x is the deviation from the trim of the controlled states, then of the actuators.
    states : name of each state: an FMI name, or `acting.NAME` of a command that a lag delays.
    commands : name of each entry of u: a velocity whose acceleration [m/s2, rad/s2] is commanded,
        or an actuator, as a share of its limit.
    trim : the steady motion.
    envelope : state or current by FMI name -> bound about the trim, as far as it matters.
    disturbance : row of x' -> bound of what other states and the current add, beside w.
    actuation : from u to commands of actuators.
    """

    vehicle: Vehicle
    system: DelaySystem
    states: tuple[str, ...]
    commands: tuple[str, ...]
    trim: Trim
    envelope: Mapping[str, float]
    disturbance: Mapping[str, float]
    actuation: Actuation = field(repr=False)


def linear_model(
    vehicle: Vehicle,
    *,
    current: Sequence[float] = (0.0, 0.0, 0.0),
    loop_delay: float = 0.0,
    envelope: Mapping[str, float] | None = None,
) -> LinearModel:
    """Return the linear model of a vehicle about its trim.

    Parameters
    ----------
    current : bound of the current north, east and down [m/s].
    loop_delay : greatest age of the feedback [s]; 0: u = K x(t).
    envelope : bounds in place of those of the vehicle.

    Raises
    ------
    InputError : a state that matters has no bound; the equations are not differentiable over the
        envelope; the commands do not stabilise the controlled states.
    NotAchievableError : as `find_trim`.
    """
    trim = find_trim(vehicle)
    model = _Coordinates(vehicle, trim, current, vehicle.envelope | (envelope or {}))
    n, m = len(model.states), len(model.commands)
    found = hinf.enclose(model.rates, model.box(), n, first=model.attitude, weights=model.weights)
    _require_defined(found, model)
    A, A1 = found.centre[:, :n], found.centre[:, n : 2 * n]
    B = found.centre[:, 2 * n :]
    if (found.radius[:, 2 * n :] > 0).any():
        i, j = np.argwhere(found.radius[:, 2 * n :] > 0)[0]
        raise InputError(
            "the effect of a command depends on the state",
            where=f"{model.commands[j]}, on {model.states[i]}'",
            expected="an actuator with a lag: its angle is then a state, and this is covered",
            hint="lag = 0.1",
        )
    names = model.states
    late = (found.factors.H[:, n : 2 * n], A1)
    delays = []
    if vehicle.damping is not None:
        delays.append(Delay(vehicle.damping.delay, late[1], late[0], any_age=True))
    if loop_delay > 0:
        delays.append(Delay(loop_delay, np.zeros((n, n)), feedback=True, any_age=True))
    weights = np.diag(model.weights)[model.weights > 0]
    p = len(weights)
    entry = np.array([[float(k == i) for k in range(n)] for i in model.accelerations]).T
    system = DelaySystem(
        A=A,
        B=B,
        C=entry,
        D=np.vstack([weights, np.zeros((m, n))]),
        D1=np.zeros((p + m, entry.shape[1])),
        D2=np.vstack([np.zeros((p, m)), model.effort]),
        E=found.factors.E if found.factors.blocks else None,
        H=found.factors.H[:, :n] if found.factors.blocks else None,
        delays=tuple(delays),
        name=vehicle.name,
        uncertainty_blocks=found.factors.blocks or None,
    )
    disturbance = {
        f"{names[i]}'": float(value) for i, value in enumerate(found.disturbance) if value > 0
    }
    bounds = {
        name: bound
        for name, bound in model.bounds.items()
        if np.isfinite(bound) and bound > 0 and name in found.used
    }
    return LinearModel(
        vehicle,
        system,
        names,
        model.commands,
        trim,
        MappingProxyType(bounds),
        MappingProxyType(disturbance),
        model.actuation,
    )
