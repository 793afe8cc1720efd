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


def test_the_mass_matrix_is_that_of_the_body_and_of_the_water() -> None:
    """[[m I, -m S(r_g)], [m S(r_g), I_o]] less the derivatives of the accelerations."""
    x, y, z = r_g = np.array([0.03, 0.01, 0.04])
    S = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert np.array_equal(S @ NU[:3], np.cross(r_g, NU[:3]))
    inertia = [[0.6, 0.02, -0.05], [0.02, 2.2, 0.03], [-0.05, 0.03, 2.4]]
    rigid = np.block([[20.0 * np.eye(3), -20.0 * S], [20.0 * S, np.array(inertia)]])
    water = np.diag([4.0, 15.0, 18.0, 0.2, 1.1, 1.3])
    water[1, 5] = water[5, 1] = -0.7
    water[2, 4] = water[4, 2] = 0.9
    assert mass(free()) == pytest.approx(rigid + water, rel=1e-14)


def force(more: str, commands: Sequence[float] = ()) -> np.ndarray:
    """Force and moment (6,) at NU of the tables `more`, at the mass matrix of the bare vehicle."""
    water = {"density": "1025.0", "length": "1.6"}
    vehicle, bare = free(more, **water), free(**water)
    x = [0.0, 0.0, 0.0, *ANGLES, *NU]
    without = np.array(bare.rates(x, [], [0.0] * 9)[6:])
    found = np.array(vehicle.rates([*x, *commands], [], [*commands, *[0.0] * 9])[6:12])
    return np.asarray(mass(bare) @ (found - without))


@pytest.mark.parametrize("law", ["", "coupled = true\nsoftening = 1e-12\n"])
def test_cross_flow_drag_is_that_of_strips_that_move_with_the_hull(law: str) -> None:
    """Each strip at x has the velocity (v + x r, w - x q), and its force the moment of its arm."""
    table = "[cross_flow]\nheight = 0.2\nbreadth = 0.3\ndrag = [0.9, 1.1]\nstrips = 5\n"
    _, v, w, _, q, r = NU
    total = np.zeros(6)
    for k in range(5):
        x = 1.6 * ((k + 0.5) / 5 - 0.5)
        speed = np.array([v + x * r, w - x * q])
        area = np.array([0.2 * 0.9, 0.3 * 1.1])
        size = 1025.0 / 2 * 1.6 / 5
        if law:
            acting = -size * (area @ speed**2) * speed / np.hypot(*speed)
        else:
            acting = -size * area * np.abs(speed) * speed
        total += [0, *acting, *np.cross([x, 0, 0], [0, *acting])]
    assert force(table + law) == pytest.approx(total, abs=1e-9)
    opposite = force(f'{table}{law}pitch = "opposite"\n') - total if law else np.zeros(6)
    assert np.flatnonzero(np.abs(opposite) > 1e-6).tolist() == ([4] if law else [])


def test_the_hull_lifts_across_its_path_and_drags_along_it() -> None:
    """In the plane of u and w: lift towards the side that is turned to the flow's lee."""
    u, v, w = NU[:3]
    alpha, pressure, aspect = math.atan2(w, u), 1025.0 / 2 * (u * u + v * v + w * w), 0.2**2 / 0.21
    slope = math.pi * aspect / (1 + math.sqrt(1 + (aspect / 2) ** 2))
    along = np.array([u, w]) / math.hypot(u, w)
    across = np.array([along[1], -along[0]])  # a flow from below pushes up, -z
    for stall in (0.0, 0.4):
        lift = (1 - stall) * slope * alpha + stall * 2 * math.sin(alpha) ** 2 * math.cos(alpha)
        drag = 0.1 + (slope * alpha) ** 2 / (math.pi * 0.7 * aspect)
        acting = pressure * 0.21 * (lift * across - drag * along)
        table = f"[lift_drag]\nspan = 0.2\narea = 0.21\ndrag = 0.1\nstall = {stall}\n"
        assert force(table) == pytest.approx([acting[0], 0, acting[1], 0, 0, 0], abs=1e-9)


def test_thrusters_and_fins_act_where_they_are() -> None:
    """With the moment of their arms; a fin by the square of the speed that it sees."""
    where, towards = np.array([-0.7, 0.1, -0.2]), np.array([0.0, -0.6, 0.8])
    place = f"position = {where.tolist()}\ndirection = {towards.tolist()}\nlimit = 20.0\n"
    thruster = f"[[thrusters]]\nname = 't'\n{place}moment = [0.02, 0.0, 0.0]\nlag = 0.3\n"
    acting = 7.0 * towards
    turn = np.cross(where, acting)
    turn[0] += 7.0 * 0.02
    assert force(thruster, [7.0]) == pytest.approx([*acting, *turn], abs=1e-9)
    fin = f"[[fins]]\nname = 'f'\n{place}area = 0.013\nlift = 3.0\ndrag = 0.5\nlag = 0.3\n"
    pressure = 1025.0 / 2 * 0.013 * (NU[0] ** 2 + (NU[:3] @ towards) ** 2)
    acting = pressure * (3.0 * 0.2 * towards - 0.5 * 0.2**2 * np.array([1.0, 0, 0]))
    assert force(fin, [0.2]) == pytest.approx([*acting, *np.cross(where, acting)], abs=1e-9)
    products = "derivatives = { Y_uud = 5.0, N_urd = -2.0, X_uudd = -3.0, K_d = 1.5 }\n"
    u, r = NU[0], NU[5]
    rows = [-3 * u * u * 0.04, 5 * u * u * 0.2, 0, 1.5 * 0.2, 0, -2 * u * r * 0.2]
    fin = f"[[fins]]\nname = 'f'\nlimit = 0.3\nlag = 0.3\n{products}"
    assert force(fin, [0.2]) == pytest.approx(rows, abs=1e-9)


def test_an_actuator_follows_its_command_up_to_its_limit() -> None:
    """T' = (command - T)/lag, the command clamped."""
    thruster = "[[thrusters]]\nname = 't'\ndirection = [1, 0, 0]\nlimit = 20.0\nlag = 0.5\n"
    vehicle = free(thruster)
    x = [*[0.0] * 12, 5.0]
    found = [vehicle.rates(x, [], [c, *[0.0] * 9])[-1] for c in (10.0, 30.0, -30.0)]
    assert found == [10.0, 30.0, -50.0]


def test_derivatives_act_on_what_they_name() -> None:
    """Absolute values, products of turning and moving, and damping that fades with the speed."""
    lines = '"Y_v|r|" = -4.0\n"N_|v|r" = -3.0\nM_uq = -6.0\nX_u = -2.0\nK_p = -0.3\n'
    u, v, w, p, q, r = NU
    rows = [-2 * u, -4 * v * abs(r), 0, -0.3 * p, -6 * u * q, -3 * abs(v) * r]
    assert force(lines) == pytest.approx(rows, abs=1e-12)
    rows[0] *= math.exp(-3.0 * math.hypot(u, v, w))
    assert force(f"{lines}fading = {{ X_u = 3.0 }}\n") == pytest.approx(rows, abs=1e-12)


def test_without_drag_kinetic_energy_and_momentum_stay() -> None:
    """1/2 nu' M nu, R d/dv of it, and the angular momentum about the earth's origin."""
    vehicle = free()
    M = mass(vehicle)
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
