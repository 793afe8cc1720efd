"""Find what is wrong with a vehicle file, and what is doubtful about the vehicle.

Errors: the file is refused, or nothing can be designed for it. Warnings: it can be, but energy
comes from nowhere, or an actuator is too weak. Notes: what is good to know.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import CosimError, InputError, all_refusals
from cosim.models import VELOCITIES
from cosim.vehicle.actuation import command_effect
from cosim.vehicle.check import Faults
from cosim.vehicle.computable import computable
from cosim.vehicle.design_model import as_designed_for, flight_model
from cosim.vehicle.read import vehicle_data, vehicle_from_toml
from cosim.vehicle.schema import VehicleFile
from cosim.vehicle.trim import Trim, find_trim
from cosim.vehicle.vehicle import Vehicle

Matrix = NDArray[np.float64]
Level = Literal["error", "warning", "note"]

_SAMPLES = 400
_STEP = 1e-6
_RIGHT = 1e-6  # [1/s], beyond which a pole is in the right half plane
_STEP_OF_RUNS = 0.05  # [s]


@dataclass(frozen=True)
class Finding:
    """Something about a vehicle: how serious, and an error that says what, where and what to do."""

    level: Level
    error: CosimError

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"level": self.level, **self.error.to_json()}


def diagnose(text: str, where: str) -> list[Finding]:
    """Return everything that is wrong with a vehicle file or doubtful about its vehicle.

    Errors of the file come alone: without it there is no vehicle to look at.
    """
    findings: list[Finding] = []
    try:
        for error in _file_errors(text, where):
            findings.append(Finding("error", error))  # noqa: PERF401 - what is found before one raises
        if findings:
            return findings
        vehicle = vehicle_from_toml(text, where=where)
        findings.extend(_of_motion(vehicle))
        findings.extend(_of_sensors(vehicle))
    except CosimError as beyond:
        findings.append(Finding("error", beyond))
    return findings


def _file_errors(text: str, where: str) -> Iterator[InputError]:
    try:
        data = vehicle_data(text, where)
    except InputError as error:
        yield error
        return
    refused = all_refusals(VehicleFile, text, data, where)
    if refused:
        yield from refused
        return
    with computable(where):
        yield from Faults(VehicleFile.model_validate(data), text, where).all()


def _of_motion(vehicle: Vehicle) -> Iterator[Finding]:
    """Look at energy, trim, stability, actuators and the linear model."""
    yield from _energy(vehicle)
    for where, taken in vehicle.defaults.items():
        what = (
            "the file gives no bound for some states" if where == "envelope" else "not in the file"
        )
        yield _finding("note", f"{what}: a default is taken", where=where, got=taken)
    remarks: list[str] = []
    craft = as_designed_for(vehicle, remarks.append)
    for line in remarks:
        yield _finding("note", line, where="a flight")
    trim = None
    with suppress(CosimError):  # what has no trim has no linear model for the same reason
        trim = find_trim(craft)
    if trim is not None:
        yield from _actuators(craft, trim)
        yield from _stability(craft, trim)
    for refusal in flight_model(craft)[1]:
        yield Finding("error", refusal)


def _energy(vehicle: Vehicle) -> Iterator[Finding]:
    """Find a velocity at which the forces of the water do work on the vehicle."""
    power, nu = greatest_power(vehicle)
    if power > 0:
        at = ", ".join(f"{name} = {value:.3g}" for name, value in nu.items() if value)
        yield _finding(
            "warning",
            "the forces of the water drive the vehicle: drag is not dissipative",
            where=f"hydro, at {at}",
            expected="a power <= 0 at every velocity",
            got=f"{power:.3g} W",
            hint="a sign of a derivative, or Coriolis entries that are left out alone",
        )


@computable("hydro")
def greatest_power(vehicle: Vehicle) -> tuple[float, dict[str, float]]:
    """Return the greatest power of the water's forces [W] and the velocity there.

    At velocities drawn within twice the envelope about the trim; the power of M nu' without
    actuators, less that at rest, is that of drag, lift and Coriolis forces.
    """
    names = vehicle.velocities
    at = [vehicle.states.index(name) for name in names]
    mass = mass_matrix(vehicle)
    bound = np.array([2 * vehicle.envelope.get(name, 0.5) for name in names])
    centre = np.array([vehicle.trim.get(name, 0.0) for name in names])
    drawn = np.random.default_rng(1).uniform(-1, 1, (_SAMPLES, len(names)))
    alone = np.vstack([np.eye(len(names)), -np.eye(len(names))])
    rest = _accelerations(vehicle, np.zeros(len(names)), at)
    best, where = 0.0, centre
    for share in (*alone, *drawn):
        nu = centre + bound * share
        moved = _accelerations(vehicle, nu, at) - rest
        power, scale = float(nu @ mass @ moved), float(np.abs(nu) @ np.abs(mass @ moved))
        if power > max(best, 1e-9 * scale):
            best, where = power, nu
    return best, dict(zip(names, where.tolist(), strict=True))


def _accelerations(vehicle: Vehicle, nu: Matrix, at: list[int]) -> Matrix:
    x = [0.0] * len(vehicle.states)
    if "quaternion.q0" in vehicle.states:
        x[vehicle.states.index("quaternion.q0")] = 1.0
    for i, value in zip(at, nu.tolist(), strict=True):
        x[i] = value
    still = [0.0] * len(x)  # what the damping loop on board knows is apart from the water
    rates = vehicle.rates(x, still if vehicle.damping else (), [0.0] * len(vehicle.inputs))
    return np.array([rates[i] for i in at])


def mass_matrix(vehicle: Vehicle) -> Matrix:
    """Return M with added mass, in the order of the velocities of the vehicle."""
    sparse = vehicle.equations.mass_matrix(vehicle.parameters)
    axes = [VELOCITIES.index(name[3:]) for name in vehicle.velocities]
    return np.array([[float(sparse.get((i, j), 0.0)) for j in axes] for i in axes])


def _actuators(vehicle: Vehicle, trim: Trim) -> Iterator[Finding]:
    """Compare what holds the trim, and the drag at the envelope, with the limits."""
    for actuator in vehicle.actuators:
        share = abs(trim.commands[actuator.command]) / actuator.limit
        if share > 0.5:
            yield _finding(
                "warning",
                "the trim takes more than half of an actuator",
                where=actuator.command,
                expected=f"at most {0.5 * actuator.limit:.4g} {actuator.unit}",
                got=f"{trim.commands[actuator.command]:.4g} {actuator.unit}",
            )
    for name, share in drag_shares(vehicle, trim).items():
        if share > 1:
            yield _finding(
                "warning",
                "the actuators cannot hold the vehicle at this bound of its envelope",
                where=f"envelope: {name}",
                expected="a share of the limits of at most 1",
                got=f"{share:.3g}",
                hint="a smaller bound, or stronger actuators",
            )


@computable("envelope")
def drag_shares(vehicle: Vehicle, trim: Trim) -> dict[str, float]:
    """Return by velocity which share of the limits holds it at its bound, beside the trim.

    Empty where the actuators cannot hold each velocity apart from the others.
    """
    at = [vehicle.states.index(name) for name in vehicle.velocities]
    effect = command_effect(vehicle, trim)
    limits = np.array([a.limit for a in vehicle.actuators])
    shares: dict[str, float] = {}
    if np.linalg.matrix_rank(effect * limits, tol=1e-8) < len(_driven(vehicle, effect, at)):
        return shares  # at speed, what holds one velocity moves another
    for i in at:
        name = vehicle.states[i]
        if name not in vehicle.envelope or name[3:] not in _driven(vehicle, effect, at):
            continue
        base, moved = dict(trim.state), dict(trim.state)
        moved[name] += vehicle.envelope[name]
        change = _rates_at(vehicle, moved, trim)[at] - _rates_at(vehicle, base, trim)[at]
        needed = np.zeros(len(at))
        needed[at.index(i)] = -change[at.index(i)]
        scaled = np.linalg.lstsq(effect * limits, needed, rcond=1e-9)[0]
        shares[name] = float(np.abs(scaled).max(initial=0.0))
    return shares


def _driven(vehicle: Vehicle, effect: Matrix, at: list[int]) -> set[str]:
    size = np.abs(effect).max(axis=1, initial=0.0)
    return {vehicle.states[i][3:] for i, s in zip(at, size, strict=True) if s > 1e-9}


def _rates_at(vehicle: Vehicle, state: Mapping[str, float], trim: Trim) -> Matrix:
    """Return x' at a state, commands those of the trim."""
    x = [state[name] for name in vehicle.states]
    u = [trim.commands.get(name, 0.0) for name in vehicle.inputs]
    return np.array(vehicle.rates(x, x if vehicle.damping else (), u))


@computable("trim")
def poles(vehicle: Vehicle, trim: Trim) -> NDArray[np.complex128]:
    """Return the poles at the trim without control, the damping on board taken at once."""
    n = len(vehicle.states)
    columns = []
    for i in range(n):
        ends = []
        for sign in (1, -1):
            state = dict(trim.state)
            state[vehicle.states[i]] += sign * _STEP
            ends.append(_rates_at(vehicle, state, trim))
        columns.append((ends[0] - ends[1]) / (2 * _STEP))
    roots = np.linalg.eigvals(np.array(columns).T)
    return np.asarray(sorted(roots, key=lambda s: (-s.real, -s.imag)), dtype=np.complex128)


def _stability(vehicle: Vehicle, trim: Trim) -> Iterator[Finding]:
    unstable = [s for s in poles(vehicle, trim) if s.real > _RIGHT]
    if unstable:
        worst = unstable[0]
        yield _finding(
            "note",
            "the vehicle is unstable at its trim: the controller must hold it",
            where="trim",
            got=f"a pole at {worst.real:.3g}{worst.imag:+.3g}j 1/s",
        )


def _of_sensors(vehicle: Vehicle) -> Iterator[Finding]:
    """Look at ages against intervals, and for what comes over the link."""
    for i, sensor in enumerate(vehicle.sensors):
        least = max(sensor.interval, _STEP_OF_RUNS) + _STEP_OF_RUNS
        if sensor.over == "onboard" and sensor.age < least:
            yield _finding(
                "warning",
                "the age of a sensor is less than its interval and a step make it",
                where=f"sensors[{i}]: {sensor.name}",
                expected=f"age >= {least:g} s",
                got=f"{sensor.age:g} s",
                hint="the age is that where the value acts, until the next one does",
            )
    if not any(sensor.over == "link" for sensor in vehicle.sensors):
        yield _finding(
            "note",
            "no sensor's values come over a link: only set-points do",
            where="sensors",
            hint='over = "link" for fixes that come from outside',
        )


def _finding(level: Level, what: str, **parts: Any) -> Finding:
    return Finding(level, InputError(what, **parts))
