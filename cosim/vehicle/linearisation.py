"""The linear uncertain model of a vehicle about its trim, proved over its envelope.

With y the deviation of the controlled states and of what the actuators do, o that of all other
states and of the current, each within its bound,

    f(x0 + y + o) - f(x0) = [f(x0 + o) - f(x0)] + (A + dA(y, o)) y + A1 y(t-d) + B u,   dA = E F H,

is exact: dA is the mean of the derivative along a path (`cosim.hinf`), enclosed over the whole box.
The first bracket is not proportional to y: it is a disturbance, and `disturbance` bounds it by row.
Among o is the current: drag acts on the velocity through the water, so a current adds both to dA
and to the disturbance. Limits of actuators are not in the model: it holds while none is reached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.hinf.problem import Box, LinearEnclosure, enclose
from cosim.models import Delay, DelaySystem
from cosim.vehicle.actuation import Actuation, actuation_of
from cosim.vehicle.computable import computable
from cosim.vehicle.trim import Trim, find_trim
from cosim.vehicle.vehicle import Vehicle

Matrix = NDArray[np.float64]

POSITION_WEIGHT = 0.1
"""Weight in z of a controlled position or angle, where the file gives none."""

_ANGLES = ("eta.phi", "eta.theta", "eta.psi")
_PLACES = ("eta.x", "eta.y", "eta.z")
_SPEEDS = ("nu.u", "nu.v", "nu.w")
_CURRENTS = ("current.x", "current.y", "current.z")


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A vehicle as a `DelaySystem`, and what must hold for the vehicle to be within it.

    Attributes
    ----------
    system : its x is the deviation from the trim.
    states : name of each state: an FMI name, or `acting.NAME`: the entry NAME of u as it acts, a
        lag after the command; the actuators do `thrust_map` times that.
    commands : name of each entry of u: a velocity whose acceleration [m/s2, rad/s2] is commanded,
        or a command of an actuator, as a share of its limit.
    trim : the steady motion.
    envelope : name of a state or of the current -> bound about the trim; those that matter.
    disturbance : name of a state -> bound on what other states and the current add to its rate,
        beside w; rows that they do not reach are absent.
    actuation : from u to the commands of the actuators.
    """

    vehicle: Vehicle
    system: DelaySystem
    states: tuple[str, ...]
    commands: tuple[str, ...]
    trim: Trim
    envelope: Mapping[str, float]
    disturbance: Mapping[str, float]
    actuation: Actuation = field(repr=False)


@computable("envelope")
def linear_model(
    vehicle: Vehicle,
    *,
    current: Sequence[float] = (0.0, 0.0, 0.0),
    loop_delay: float = 0.0,
    envelope: Mapping[str, float] | None = None,
) -> LinearModel:
    """Return the linear model of a vehicle about its trim.

        >>> from cosim.vehicle import linear_model, load_vehicle
        >>> model = linear_model(load_vehicle("nps-auv2"), envelope={"nu.u": 0.1})
        >>> model.system.A.shape, model.commands, model.envelope["nu.u"]
        ((8, 8), ('nu.u', 'nu.v', 'nu.w', 'nu.r'), 0.1)

    Parameters
    ----------
    current : bounds of the current north, east and down [m/s].
    loop_delay : greatest age of the feedback [s]; 0: u = K x(t).
    envelope : bounds in place of those of the vehicle, by FMI name.

    Raises
    ------
    InputError : a state that matters has no bound; the equations are not differentiable over the
        envelope; the commands do not stabilise the controlled states; an unknown name.
    NotAchievableError : as `find_trim`.
    """
    trim = find_trim(vehicle)
    model = _Coordinates(vehicle, trim, {**vehicle.envelope, **(envelope or {})}, current)
    enclosure = enclose(model.rates, model.box)
    return LinearModel(
        vehicle,
        _system(model, enclosure, loop_delay),
        model.states,
        model.actuation.commands,
        trim,
        MappingProxyType(
            {name: model.bounds[name] for name in enclosure.needed if name in model.bounds}
        ),
        MappingProxyType(
            {
                name: float(size)
                for name, size in zip(model.states, enclosure.disturbance, strict=True)
                if size > 0
            }
        ),
        model.actuation,
    )


def _system(model: _Coordinates, enclosure: LinearEnclosure, loop_delay: float) -> DelaySystem:
    vehicle, n, m = model.vehicle, len(model.states), len(model.actuation.commands)
    delays = []
    H = enclosure.uncertain.H if enclosure.uncertain.blocks else None
    if vehicle.damping is not None:
        delayed = None if H is None else H[:, n:]
        delays.append(Delay(vehicle.damping.delay, enclosure.A1, delayed, any_age=True))
    if loop_delay > 0:
        delays.append(Delay(loop_delay, np.zeros((n, n)), feedback=True, any_age=True))
    D = np.diag(model.weights)[np.array(model.weights) > 0]
    D2 = model.effort
    accelerated = [i for i, name in enumerate(model.states) if name.startswith("nu.")]
    C = np.eye(n)[:, accelerated]
    p = len(D) + len(D2)
    return DelaySystem(
        A=enclosure.A,
        B=enclosure.B,
        C=C,
        D=np.vstack([D, np.zeros((len(D2), n))]),
        D1=np.zeros((p, C.shape[1])),
        D2=np.vstack([np.zeros((len(D), m)), D2]),
        E=enclosure.uncertain.E if H is not None else None,
        H=None if H is None else H[:, :n],
        delays=delays,
        name=vehicle.name,
        uncertainty_blocks=enclosure.uncertain.blocks or None,
    )


class _Coordinates:
    """The variables of a linear model, and the equations of its vehicle in them.

    Variables: the controlled states, what u acts as behind a lag; the same d seconds ago; u; and
    then the other states, those d seconds ago, and the current.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        trim: Trim,
        envelope: Mapping[str, float],
        current: Sequence[float],
    ) -> None:
        self.vehicle, self._trim = vehicle, trim
        known = (*vehicle.states, *_CURRENTS)
        for name in envelope:
            if name not in known:
                raise InputError.unknown("state", name, known, where="envelope")
        lagged = [f"actual.{a.name}" for a in vehicle.actuators if a.lag]
        self._plant = [name for name in vehicle.control.states if name not in lagged]
        velocities = [name for name in self._plant if name.startswith("nu.")]
        self.actuation = actuation = actuation_of(vehicle, trim, velocities)
        self.acting = self._acting()
        self.states = (*self._plant, *self.acting)
        self._others = [x for x in vehicle.states if x not in self._plant and x not in lagged]
        self.bounds = {**dict(zip(_CURRENTS, current, strict=True)), **envelope}
        self.bounds |= self.acting
        self.weights = self._weights()
        self.effort = self._effort()
        self.box = self._box(actuation)

    def _acting(self) -> dict[str, float]:
        """Return the states of the actuators in use, with their bounds.

        With one lag for all, u itself acts behind it, whatever the thrust map.
        """
        actuation = self.actuation
        left = actuation.limits + np.abs(actuation.at_trim)
        if actuation.common_lag:
            inverse = np.abs(np.linalg.pinv(actuation.thrust_map))
            bounds = inverse @ left
            return {
                f"acting.{name}": float(x)
                for name, x in zip(actuation.commands, bounds, strict=True)
            }
        return {
            f"actual.{a.name}": float(left[i] / actuation.limits[i])
            for i, a in enumerate(self.vehicle.actuators)
            if actuation.used[i] and a.lag
        }

    def _weights(self) -> tuple[float, ...]:
        given = self.vehicle.control.weights
        usual = {name: POSITION_WEIGHT for name in self._plant if name.startswith("eta.")}
        for name in given:
            if name not in self._plant and name not in self.actuation.actuators:
                known = (*self._plant, *self.actuation.actuators)
                raise InputError.unknown("state", name, known, where="control.weights")
        return tuple(given.get(name, usual.get(name, 0.0)) for name in self.states)

    def _effort(self) -> Matrix:
        """Return D2: u, each entry by its weight, and actuators that have a weight of their own."""
        actuation, given = self.actuation, self.vehicle.control.weights
        if not actuation.accelerations:
            return np.diag([given.get(name, 1.0) for name in actuation.commands])
        rows = [
            given[name] * actuation.thrust_map[i] / actuation.limits[i]
            for i, name in enumerate(actuation.actuators)
            if name in given
        ]
        return np.vstack([np.eye(len(actuation.commands)), *rows])

    def _box(self, actuation: Actuation) -> Box:
        n, place = len(self.states), self._trim.state
        bound = {name: self.bounds.get(name, np.inf) for name in (*self.states, *self._others)}
        centre = [place.get(name, 0.0) for name in self.states]
        other = [place[name] for name in self._others]
        names = [
            *self.states,
            *(f"{name}(t-d)" for name in self.states),
            *(f"u of {name}" for name in actuation.commands),
            *self._others,
            *(f"{name}(t-d)" for name in self._others),
            *_CURRENTS,
        ]
        m = len(actuation.commands)
        sizes = [bound[name] for name in self.states], [bound[name] for name in self._others]
        moved = [self.bounds[name] for name in _CURRENTS]
        angles = tuple(self.states.index(x) for x in _ANGLES if x in self.states)
        rows, columns = (
            tuple(self.states.index(x) for x in names if x in self.states)
            for names in (_PLACES, _SPEEDS)
        )
        return Box(
            tuple(names),
            (*centre, *centre, *[0.0] * m, *other, *other, *[0.0] * len(_CURRENTS)),
            (*sizes[0], *sizes[0], *[0.0] * m, *sizes[1], *sizes[1], *moved),
            n,
            m,
            angles,
            (rows, columns),
            self.weights,
        )

    def rates(self, variables: Sequence[Any], ns: Any) -> list[Any]:
        """Return the rates of the states."""
        actuation, n, m = self.actuation, len(self.states), len(self.actuation.commands)
        x, delayed, u = variables[:n], variables[n : 2 * n], variables[2 * n : 2 * n + m]
        rest = variables[2 * n + m :]
        count = len(self._others)
        command = [
            _combined(middle, row, u)
            for middle, row in zip(actuation.at_trim, actuation.thrust_map, strict=True)
        ]
        actual = dict(zip(actuation.actuators, command, strict=True))
        acting = dict(zip(self.acting, x[len(self._plant) :], strict=True))
        for i, actuator in enumerate(self.vehicle.actuators):
            if actuator.lag and not actuation.used[i]:
                actual[actuator.command] = float(actuation.at_trim[i])
            elif actuator.lag:
                share = np.eye(len(actuation.actuators))[i] * actuation.limits[i]
                row = actuation.thrust_map[i]
                if not actuation.common_lag:
                    row = np.array(
                        [share[i] * (name == f"actual.{actuator.name}") for name in acting]
                    )
                actual[actuator.command] = _combined(
                    actuation.at_trim[i], row, list(acting.values())
                )
        now = dict(zip(self._plant, x, strict=False)) | dict(zip(self._others, rest, strict=False))
        then = dict(zip(self._plant, delayed, strict=False))
        then |= dict(zip(self._others, rest[count:], strict=False))
        for actuator in self.vehicle.actuators:
            if actuator.lag:
                now[f"actual.{actuator.name}"] = actual[actuator.command]
                then[f"actual.{actuator.name}"] = 0.0
        inputs = dict(zip(actuation.actuators, command, strict=True))
        inputs |= dict(zip(_CURRENTS, rest[2 * count :], strict=True))
        values = self.vehicle.rates(
            [now[name] for name in self.vehicle.states],
            [then[name] for name in self.vehicle.states] if self.vehicle.damping else (),
            [inputs.get(name, 0.0) for name in self.vehicle.inputs],
            ns,
        )
        by_name = dict(zip(self.vehicle.states, values, strict=True))
        return [by_name[name] for name in self._plant] + self._lags(list(acting.values()), u)

    def _lags(self, acting: Sequence[Any], u: Sequence[Any]) -> list[Any]:
        """Return the rates of what acts: within the limits, a first-order lag behind u."""
        actuation = self.actuation
        if actuation.common_lag:
            return [(u[j] - value) * (1.0 / actuation.common_lag) for j, value in enumerate(acting)]
        lagged = [i for i, lag in enumerate(actuation.lags) if lag and actuation.used[i]]
        return [
            (_combined(0.0, actuation.thrust_map[i] / actuation.limits[i], u) - value)
            * (1.0 / actuation.lags[i])
            for i, value in zip(lagged, acting, strict=True)
        ]


def _combined(middle: float, row: Any, values: Sequence[Any]) -> Any:
    """Return middle + row . values."""
    total: Any = float(middle)
    for factor, value in zip(row, values, strict=True):
        if factor:
            total = value * float(factor) + total
    return total
