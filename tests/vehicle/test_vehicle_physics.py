"""The equations of a vehicle against what physics says of them: energy, momentum, frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from vehicle_files import free, level, table_1

from cosim.models import TABLE_1, DelayLine, FloatFunctions, thrust_map, vehicle_derivatives
from cosim.vehicle import Vehicle

NU = np.array([0.7, -0.4, 0.3, 0.5, -0.3, 0.4])
ANGLES = np.array([0.3, -0.4, 0.8])
DRAG = 'X_u = -2.0\n"Y_|v|v" = -40.0\n"Z_|w|w" = -50.0\nK_p = -0.1\n"M_|q|q" = -2.0\nN_r = -1.0\n'


def motion(
    vehicle: Vehicle,
    start: Sequence[float],
    end: float,
    step: float,
    current: Sequence[float] = (0.0, 0.0, 0.0),
    seen: Callable[[float, np.ndarray], None] = lambda _t, _x: None,
) -> np.ndarray:
    """Integrate without commands; `seen` is called every tenth of a second."""
    u = [0.0] * len(vehicle.inputs)
    first = len(vehicle.actuators)
    u[first : first + 3] = current
    constants = vehicle.equations.constants(vehicle.parameters)

    def rates(_t: float, x: Any, _late: Any) -> list[float]:
        return vehicle.equations.rates(x, (), u, constants, FloatFunctions)

    line = DelayLine(start, [], step)
    for k in range(round(end / 0.1)):
        seen(line.time, np.array(line.x))
        line.advance((k + 1) * 0.1, rates, jump=False)
    seen(line.time, np.array(line.x))
    return np.array(line.x)


def mass(vehicle: Vehicle) -> np.ndarray:
    entries = vehicle.equations.mass_matrix(vehicle.parameters)
    found = np.zeros((6, 6))
    for at, value in entries.items():
        found[at] = value
    return found


def rotation(angles: Sequence[float]) -> np.ndarray:
    """R = Rz(psi) Ry(theta) Rx(phi), as three turns."""
    phi, theta, psi = angles
    c, s = math.cos, math.sin
    Rx = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    Ry = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    Rz = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)


def quaternion(angles: Sequence[float]) -> np.ndarray:
    """The quaternion of Euler angles, as a product of three turns."""

    def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
        return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])

    phi, theta, psi = (np.array([math.cos(a / 2), 0, 0, 0]) for a in angles)
    phi[1], theta[2], psi[3] = (math.sin(a / 2) for a in angles)
    return times(times(psi, theta), phi)


def test_without_drag_kinetic_energy_and_momentum_stay() -> None:
    """1/2 nu' M nu, R d/dv of it, and the angular momentum about the earth's origin."""
    vehicle = free()
    M = mass(vehicle)
    assert np.allclose(M, M.T)
    assert np.count_nonzero(M) == 24
    start = [1.0, -2.0, 3.0, *ANGLES, *NU]

    def kept(x: np.ndarray) -> np.ndarray:
        momentum, R = M @ x[6:], rotation(x[3:6])
        linear = R @ momentum[:3]
        angular = R @ momentum[3:] + np.cross(x[:3], linear)
        return np.array([x[6:] @ momentum / 2, *linear, *angular])

    before = kept(np.array(start))
    errors = [
        np.abs(kept(motion(vehicle, start, 5.0, step)) - before).max()
        for step in (0.1, 0.05, 0.025)
    ]
    assert errors[2] < 2e-6 * np.abs(before).max()
    # the order of the integrator: 16 for each halving
    assert 10 < errors[0] / errors[1] < 40
    assert 10 < errors[1] / errors[2] < 40


def test_with_drag_energy_falls_all_the_time() -> None:
    vehicle = free(DRAG)
    M, energies = mass(vehicle), []
    start = [0.0, 0.0, 0.0, *ANGLES, *NU]
    motion(vehicle, start, 5.0, 0.02, seen=lambda _t, x: energies.append(x[6:] @ M @ x[6:] / 2))
    assert np.all(np.diff(energies) < 0)
    assert energies[-1] < 0.5 * energies[0]


def test_weight_and_buoyancy_keep_the_sum_of_energies() -> None:
    """Not neutral, both centres off the origin: kinetic energy less W z_g plus B z_b."""
    W, B = 200.0, 190.0
    r_g, r_b = np.array([0.03, 0.01, 0.04]), np.array([-0.02, 0.005, -0.03])
    vehicle = free(weight=str(W), buoyancy=str(B), r_g=str(r_g.tolist()), r_b=str(r_b.tolist()))
    M = mass(vehicle)

    def energy(x: np.ndarray) -> float:
        down = rotation(x[3:6])[2]
        return float(x[6:] @ M @ x[6:] / 2 - W * (x[2] + down @ r_g) + B * (x[2] + down @ r_b))

    start = np.array([0.0, 0.0, 0.0, *ANGLES, *NU])
    moved = motion(vehicle, start.tolist(), 3.0, 0.0125)
    assert abs(moved[2]) > 0.5
    assert energy(moved) == pytest.approx(energy(start), abs=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_small_swing_has_the_period_of_a_pendulum(axis: int) -> None:
    """2 pi sqrt((I + added) / (B z)), in roll and in pitch, about the centre of gravity."""
    z = 0.05
    vehicle = free(
        inertia="[0.6, 2.2, 2.4]", r_g="[0.0, 0.0, 0.0]", r_b=f"[0.0, 0.0, {-z}]", gravity="9.81"
    )
    inertia = ((0.6, 0.2), (2.2, 1.1))[axis]
    if axis:  # heave moves with pitch: Z_qdot
        M = mass(vehicle)
        inertia = (M[4, 4] - M[2, 4] ** 2 / M[2, 2], 0.0)
    period = 2 * math.pi * math.sqrt(sum(inertia) / (20.0 * 9.81 * z))
    start = [0.0] * 12
    start[3 + axis] = 1e-4
    swing: list[tuple[float, float]] = []
    motion(vehicle, start, 3 * period, 0.02, seen=lambda t, x: swing.append((t, x[3 + axis])))
    t, angle = np.array(swing).T
    rises = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    # between samples the angle is a sine: its zero by the arc sine of both neighbours
    phase = np.arcsin(np.clip(angle / 1e-4, -1, 1))
    first, last = (t[i] - 0.1 * phase[i] / (phase[i + 1] - phase[i]) for i in rises[[0, -1]])
    assert (last - first) / (len(rises) - 1) == pytest.approx(period, rel=1e-5)


def test_a_quaternion_and_euler_angles_give_the_same_motion() -> None:
    """Away from the singularity; and the quaternion keeps its length."""
    changes = {"r_b": "[0.0, 0.0, -0.02]", "buoyancy": "200.0"}
    start = [0.0, 0.0, 0.0]
    e = motion(free(DRAG, **changes), [*start, *ANGLES, *NU], 4.0, 0.02)
    vehicle = free(DRAG, attitude="quaternion", **changes)
    q = motion(vehicle, [*start, *quaternion(ANGLES), *NU], 4.0, 0.02)
    assert np.abs(e[3:6]).max() > 0.5
    angles = list(vehicle.equations.euler(q, FloatFunctions).values())
    assert np.abs(q[:3] - e[:3]).max() < 1e-6
    assert np.abs(q[7:] - e[6:]).max() < 1e-6
    assert np.abs(np.sin(angles) - np.sin(e[3:6])).max() < 1e-6
    assert abs(q[3:7] @ q[3:7] - 1) < 1e-9


def test_a_quaternion_passes_the_vertical() -> None:
    """A vehicle that pitches on and on: up to 90 degrees, then down with the roll turned over."""
    vehicle, seen = free(attitude="quaternion"), []

    def look(_t: float, x: np.ndarray) -> None:
        seen.append([*vehicle.equations.euler(x, FloatFunctions).values()])

    moved = motion(vehicle, [0.0] * 3 + [1.0] + [0.0] * 7 + [1.5, 0.0], 3.0, 0.02, seen=look)
    phi, theta, _ = np.abs(seen).T
    assert theta.max() > 1.4
    assert phi.max() > 2.0
    assert moved[3:7] @ moved[3:7] == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("attitude", ["euler", "quaternion"])
def test_a_constant_current_carries_everything_along(attitude: str) -> None:
    """Galilean invariance: with the water's velocity added, the same motion, carried along."""
    vehicle = free(DRAG, attitude=attitude, r_b="[0.0, 0.0, -0.02]")
    current = np.array([0.4, -0.3, 0.1])
    turned = ANGLES if attitude == "euler" else quaternion(ANGLES)
    with_current = np.add(NU, [*(rotation(ANGLES).T @ current), 0, 0, 0])
    still = motion(vehicle, [0.0, 0.0, 0.0, *turned, *NU], 2.0, 0.02)
    moved = motion(vehicle, [0.0, 0.0, 0.0, *turned, *with_current], 2.0, 0.02, current.tolist())
    n = 3 + len(turned)
    assert np.abs(moved[:3] - still[:3] - 2.0 * current).max() < 1e-6
    assert np.abs(moved[3:n] - still[3:n]).max() < 1e-6
    angles = vehicle.equations.euler(still, FloatFunctions).values() or still[3:n]
    flow = rotation([*angles]).T @ current
    assert np.abs(moved[n:] - still[n:] - [*flow, 0, 0, 0]).max() < 1e-6


def test_four_degrees_of_freedom_are_six_without_roll_and_pitch() -> None:
    """A hull with drag in strips, lift, products, a current, fins and thrusters."""
    four, six = level(4), level(6)
    here = [six.states.index(name) for name in four.states]
    rng = np.random.default_rng(3)
    for _ in range(20):
        values = dict(zip(four.states, rng.uniform(-1, 1, len(four.states)).tolist(), strict=True))
        x = [values.get(name, 0.0) for name in six.states]
        inputs = dict(zip(four.inputs, rng.uniform(-1, 1, len(four.inputs)).tolist(), strict=True))
        a = four.rates([*values.values()], [*values.values()], [*inputs.values()])
        b = six.rates(x, x, [inputs.get(name, 0.0) for name in six.inputs])
        assert np.array(b)[here] == pytest.approx(a, rel=1e-11, abs=1e-12)


def test_the_vehicle_of_table_1_is_the_one_of_the_paper() -> None:
    """The general equations in 4 degrees of freedom, against those of AuvPlant, to rounding."""
    vehicle = table_1()
    assert vehicle.states[:4] == ("eta.x", "eta.y", "eta.z", "eta.psi")
    rng = np.random.default_rng(1)
    p = {**TABLE_1, **{f"damping.{axis}": 0.05 for axis in "uvwr"}}
    for _ in range(30):
        x, late = rng.uniform(-2, 2, (2, 8)).tolist()
        tau, w = rng.uniform(-2e3, 2e3, 4).tolist(), rng.uniform(-0.1, 0.1, 4).tolist()
        paper = vehicle_derivatives(x, late[4:], tau, w, p, thrust_map(p), math)
        assert vehicle.rates(x, late, [*tau, 0, 0, 0, *w]) == pytest.approx(paper, rel=1e-11)
