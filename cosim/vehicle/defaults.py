"""What a design takes where a vehicle file leaves it open: sensors, speed, controlled states.

Each is chosen from what the vehicle is, and named (`Vehicle.defaults`): what the actuators move
apart from each other is controlled, roll and pitch are left to the restoring moments where these
hold them, and a vehicle that only fins steer is not at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from cosim.core import CosimError
from cosim.vehicle.actuation import MAINLY, command_effect
from cosim.vehicle.trim import Trim, find_trim
from cosim.vehicle.vehicle import Sensor, Vehicle

Matrix = NDArray[np.float64]

_SPEEDS = (2.0, 1.5, 1.0, 0.75, 0.5, 0.3)
"""Speeds of a vehicle that fins steer [m/s]: the first that takes half of no actuator."""
_MOVED = 0.01
"""Least acceleration by an actuator at its limit, in shares of the envelope per second."""
_ANGLE = {"p": "eta.phi", "q": "eta.theta", "r": "eta.psi"}
_PLACE = {"u": "eta.x", "v": "eta.y", "w": "eta.z"}
_STEP = 1e-5

DEFAULT_SENSORS = (
    Sensor("dvl", ("nu.u", "nu.v", "nu.w"), 0.2, (0.01,) * 3, 0.3, "onboard"),
    Sensor(
        "attitude", ("eta.phi", "eta.theta", "eta.psi"), 0.1, (0.003, 0.003, 0.01), 0.2, "onboard"
    ),
    Sensor("gyro", ("nu.p", "nu.q", "nu.r"), 0.1, (0.002,) * 3, 0.2, "onboard"),
    Sensor("depth", ("eta.z",), 0.2, (0.02,), 0.3, "onboard"),
    Sensor("usbl", ("eta.x", "eta.y"), 1.0, (0.3, 0.3), 2.0, "link"),
)
"""Of a file without sensors: what such vehicles carry, with typical figures."""


def with_defaults(vehicle: Vehicle, *, speed_given: bool) -> Vehicle:
    """Return a vehicle with sensors, a trim and controlled states, each where its file has none.

    speed_given : whether the file says at which speed the trim is.
    """
    taken = dict(vehicle.defaults)
    if not vehicle.sensors:
        chosen = (
            {*vehicle.states, *_ANGLE.values()}
            if vehicle.degrees_of_freedom == 6
            else {*vehicle.states}
        )
        vehicle = replace(vehicle, sensors=tuple(_measuring(DEFAULT_SENSORS, chosen)))
        taken["sensors"] = "; ".join(f"{s.name}: {', '.join(s.measures)}" for s in vehicle.sensors)
    euler = vehicle.attitude == "euler"
    if not speed_given and euler and any(a.kind == "fin" for a in vehicle.actuators):
        steered = _steered(vehicle)
        if steered is not vehicle:
            vehicle, taken["trim"] = (
                steered,
                f"u = {steered.trim['nu.u']:g} m/s, since fins steer it",
            )
    if not vehicle.control.states:
        motion = tuple(n for n in vehicle.outputs if n[:4] == "eta." or n[:3] == "nu.")
        states = (_controlled(vehicle) if euler else ()) or motion
        vehicle = replace(vehicle, control=replace(vehicle.control, states=states))
        if {*states} != {*motion}:
            taken["control.states"] = ", ".join(states)
    return replace(vehicle, defaults=MappingProxyType(taken))


def _measuring(sensors: Sequence[Sensor], names: set[str]) -> list[Sensor]:
    """Return the sensors with what they measure of these names."""
    measuring = []
    for sensor in sensors:
        noises = {m: n for m, n in zip(sensor.measures, sensor.noise, strict=True) if m in names}
        if noises:
            measuring.append(replace(sensor, measures=tuple(noises), noise=tuple(noises.values())))
    return measuring


def _trim(vehicle: Vehicle) -> Trim | None:
    try:
        return find_trim(vehicle)
    except CosimError:
        return None


def _steered(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle at the greatest usual speed that it holds; as it is where it can hover."""
    at_rest = _trim(vehicle)
    if at_rest is not None and {"r", "w"} <= {*_apart(vehicle, at_rest)}:
        return vehicle
    for speed in _SPEEDS:
        moving = replace(vehicle, trim=MappingProxyType({"nu.u": speed}))
        trim = _trim(moving)
        if trim is not None and all(
            abs(trim.commands[a.command]) <= 0.5 * a.limit for a in vehicle.actuators
        ):
            return moving
    return vehicle


def _shares(vehicle: Vehicle, trim: Trim) -> Matrix:
    """Return the accelerations by each actuator at its limit, in shares of the envelope."""
    limits = np.array([a.limit for a in vehicle.actuators])
    bounds = np.array([vehicle.envelope.get(name, 1.0) for name in vehicle.velocities])
    return np.asarray(command_effect(vehicle, trim) * limits / bounds[:, None])


def _apart(vehicle: Vehicle, trim: Trim) -> list[str]:
    """Return the velocities (u, v, ...) that actuators move apart from those before them.

    At rest roll and pitch come last, which thrusters above the centre move as well. At speed those
    that are moved most come first: stern planes turn a vehicle, and its heave follows.
    """
    rows = _shares(vehicle, trim)
    apart: list[str] = []
    basis = np.zeros((0, rows.shape[1]))
    order = np.argsort(-np.linalg.norm(rows, axis=1), kind="stable").tolist()
    if not vehicle.trim:
        order.sort(key=lambda i: vehicle.velocities[i] in ("nu.p", "nu.q"))
    for i in order:
        size = float(np.linalg.norm(rows[i]))
        left = rows[i] - basis.T @ (basis @ rows[i])
        rest = float(np.linalg.norm(left))
        if size > _MOVED and rest > MAINLY * size:
            basis = np.vstack([basis, left / rest])
            apart.append(vehicle.velocities[i].removeprefix("nu."))
    return apart


def _controlled(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the states that actuators move and sensors show; nothing without a trim."""
    trim = _trim(vehicle)
    if trim is None:
        return ()
    apart, moving = {*_apart(vehicle, trim)}, bool(vehicle.trim)
    chosen = {letter for letter in "vwr" if letter in apart}
    if "q" in apart and (_tips(vehicle, trim, "q") or (moving and "w" not in apart)):
        chosen |= {"q", "w"} if moving else {"q"}
    if "p" in apart and _tips(vehicle, trim, "p"):
        chosen.add("p")
    if moving and "r" in apart:
        chosen.add("v")  # a turn at speed moves it
    if "u" in apart and (not moving or _also_ahead(vehicle, trim, chosen)):
        chosen.add("u")
    measured = {name for sensor in vehicle.sensors for name in sensor.measures}
    places = {_ANGLE[x] for x in chosen & {*_ANGLE}}
    places |= {_PLACE[x] for x in chosen & {"w"}} | (
        set() if moving else {_PLACE[x] for x in chosen & {"u", "v"}}
    )
    states = places | {f"nu.{x}" for x in chosen}
    follows = {_PLACE[x]: x for x in _PLACE} | {angle: x for x, angle in _ANGLE.items()}
    observed = {f"nu.{follows[name]}" for name in measured if name in follows}
    behind = {"eta.theta"} if moving and "eta.z" in measured else set()
    # at speed, sway follows from the turn, and heave and pitch from the depth
    observed |= {"nu.v"} if moving and "nu.r" in measured | observed else set()
    observed |= {"nu.w", "nu.q"} if behind else set()
    states = {name for name in states if name in measured | observed | behind}
    return tuple(name for name in vehicle.states if name in states)


def _also_ahead(vehicle: Vehicle, trim: Trim, letters: set[str]) -> bool:
    """Whether what moves these velocities moves the vehicle ahead as well."""
    shares, names = np.abs(_shares(vehicle, trim)), vehicle.velocities
    ahead = shares[names.index("nu.u")]
    share = shares[[names.index(f"nu.{x}") for x in sorted(letters)]].max(axis=0, initial=0.0)
    return bool(((share > MAINLY * ahead) & (ahead > MAINLY * share)).any())


def _tips(vehicle: Vehicle, trim: Trim, letter: str) -> bool:
    """Whether nothing holds roll (p) or pitch (q): no moment against a small angle."""
    state, commands = dict(trim.state), [trim.commands.get(n, 0.0) for n in vehicle.inputs]

    def rate(angle: float) -> float:
        moved: Mapping[str, float] = {**state, _ANGLE[letter]: state[_ANGLE[letter]] + angle}
        x = [moved[name] for name in vehicle.states]
        rates = vehicle.rates(x, x if vehicle.damping else (), commands)
        return float(rates[vehicle.states.index(f"nu.{letter}")])

    return not (rate(_STEP) - rate(-_STEP)) / (2 * _STEP) < -_MOVED
