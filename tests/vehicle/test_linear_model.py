"""The linear model of a vehicle covers it over the whole envelope, with little to spare."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim import hinf
from cosim.core import InputError, NotAchievableError
from cosim.models import TABLE_1, DelaySystem, inertia
from cosim.vehicle import (
    LinearModel,
    find_trim,
    linear_model,
    load_vehicle,
    plant_note,
    vehicle_from_toml,
    vehicle_text,
)

Matrix = NDArray[np.float64]
NAMES = ("nps-auv2", "bluerov2-heavy", "remus100")
CURRENT = (0.03, 0.02, 0.01)


@cache
def model(name: str, current: tuple[float, float, float] = CURRENT) -> LinearModel:
    return linear_model(load_vehicle(name), current=current)


def points(found: LinearModel, count: int) -> list[dict[str, float]]:
    """Corners of the box, then points within it: deviations from the trim, and the current."""
    rng = np.random.default_rng(7)
    names, bounds = list(found.envelope), np.array(list(found.envelope.values()))
    corners = rng.choice((-1.0, 1.0), (count // 4, len(names)))
    shares = np.array([*corners, *rng.uniform(-1, 1, (count - count // 4, len(names)))])
    return [dict(zip(names, row, strict=True)) for row in shares * bounds]


def rates(found: LinearModel, y: Matrix, others: dict[str, float]) -> Matrix:
    """x' of the model's states from the vehicle's own equations, in floats; u = 0."""
    vehicle, own = found.vehicle, found.actuation
    x = dict(found.trim.state)
    for name, value in {**others, **dict(zip(found.states, y, strict=True))}.items():
        if name in x and not name.startswith("actual."):
            x[name] += value
    acting = {k: v for k, v in zip(found.states, y, strict=True) if k.startswith("acting.")}
    if acting:
        actual = own.at_trim + own.thrust_map @ np.array(list(acting.values()))
        for actuator, value in zip(vehicle.actuators, actual, strict=True):
            x[f"actual.{actuator.name}"] = float(value)
    for j, actuator in enumerate(vehicle.actuators):
        share = dict(zip(found.states, y, strict=True)).get(f"actual.{actuator.name}")
        if share is not None:
            x[f"actual.{actuator.name}"] = float(own.at_trim[j] + own.limits[j] * share)
    u = {**found.trim.commands, **{k: v for k, v in others.items() if k.startswith("current.")}}
    state = [x[name] for name in vehicle.states]
    late = [found.trim.state[name] for name in vehicle.states] if vehicle.damping else ()
    done = vehicle.rates(state, late, [u.get(name, 0.0) for name in vehicle.inputs])
    by_name = dict(zip(vehicle.states, done, strict=True))
    out = []
    for name in found.states:
        if name.startswith("acting."):
            out.append(np.nan)  # a lag, held by its own test
        elif name.startswith("actual."):
            j = [a.name for a in vehicle.actuators].index(name.removeprefix("actual."))
            out.append(by_name[name] / own.limits[j])
        else:
            out.append(by_name[name])
    return np.array(out)


def least_norm(system: DelaySystem, y: Matrix, left: Matrix) -> float:
    """The least norm of F = diag(...) with E F H y = left; infinite where there is none.

    Rows of a full block have it alone; another row shares its deviation among its entries.
    """
    worst, share = 0.0, np.zeros(len(left))
    for columns, rows in system.blocks:
        E, H = system.E[:, columns], system.H[rows] @ y
        if E.shape[1] > 1:
            mine = E.any(axis=1)
            size, most = np.linalg.norm(left[mine]), E.max() * np.linalg.norm(H)
            worst = max(worst, size / most if size > 1e-12 else 0.0)
            left = np.where(mine, 0.0, left)
        else:
            share += np.abs(E[:, 0] * H[0])
    shares = np.divide(np.abs(left), share, out=np.zeros(len(left)), where=share > 0)
    beyond = (share == 0) & (np.abs(left) > 1e-12)
    return np.inf if beyond.any() else max(worst, float(shares.max()))


def uses(found: LinearModel, system: DelaySystem, count: int) -> tuple[float, float]:
    """The largest norm of F, and the largest share of a disturbance, over points of the box."""
    largest = share = 0.0
    nothing = np.zeros(len(found.states))
    at_trim = rates(found, nothing, {})
    for point in points(found, count):
        y = np.array([point.get(name, 0.0) for name in found.states])
        others = {k: v for k, v in point.items() if k not in found.states}
        about = rates(found, nothing, others)
        left = np.nan_to_num(rates(found, y, others) - about - system.A @ y)
        lag = np.array([name.startswith("acting.") for name in found.states])
        largest = max(largest, least_norm(system, y, np.where(lag, 0.0, left)))
        for name, moved in zip(found.states, about - at_trim, strict=True):
            if np.isfinite(moved) and abs(moved) > 1e-12:
                share = max(share, abs(moved) / found.disturbance.get(name, 1e-300))
    return largest, share


@pytest.mark.parametrize("name", NAMES)
def test_every_point_of_the_box_is_covered(name: str) -> None:
    """f(x) - f(o) - A x = E F H x with |F| <= 1 at corners and random points, currents included."""
    found = model(name)
    largest, share = uses(found, found.system, 200)
    assert 0.5 < largest <= 1 + 1e-9
    assert 0 < share <= 1 + 1e-9 or (name == "nps-auv2" and share == 0)
    smaller = replace(found.system, E=found.system.E * 0.7)
    assert uses(found, smaller, 200)[0] > 1  # a bound too small is noticed


@pytest.mark.slow
@pytest.mark.parametrize("name", [*NAMES, "nps-auv2-6dof"])
def test_ten_thousand_points_are_covered(name: str) -> None:
    found = model(name)
    largest, share = uses(found, found.system, 10_000)
    assert largest <= 1 + 1e-9
    assert share <= 1 + 1e-9
    """The same, for as many points as say something of a box in eleven dimensions."""


def test_the_linear_part_is_the_jacobian_at_the_trim() -> None:
    """In a small box the centre is what finite differences of the equations give."""
    for name in NAMES:
        vehicle = load_vehicle(name)
        small = dict.fromkeys(vehicle.envelope, 1e-06)
        found = linear_model(vehicle, envelope=small)
        n = len(found.states)
        steps = [1e-5 * one for one in np.eye(n)]
        slopes = [(rates(found, s, {}) - rates(found, -s, {})) / 2e-5 for s in steps]
        plant = [i for i, state in enumerate(found.states) if not state.startswith("acting.")]
        assert found.system.A[plant] == pytest.approx(np.array(slopes).T[plant], abs=2e-4)


def test_the_paper_s_vehicle_is_what_it_was() -> None:
    """A, A1, B and the thrust map of `nps-auv2` are those of the built-in system."""
    found = linear_model(load_vehicle("nps-auv2"), loop_delay=1.25)
    old = hinf.auv_system(
        hinf.problem.AuvDesignSettings(envelope=hinf.problem.Envelope(0.15, 0.15, 0.1, 0.05, 0.175))
    )
    assert np.array_equal(found.system.A, old.A)
    assert np.array_equal(found.system.B, old.B)
    assert np.array_equal(found.system.delays[0].A, old.delays[0].A)
    mass = np.array(inertia(TABLE_1))
    assert found.actuation.thrust_map == pytest.approx(mass, rel=1e-9, abs=1e-6)


@pytest.mark.slow
def test_the_paper_s_vehicle_has_no_worse_gamma() -> None:
    """The general proof costs no more than the one that was made for this vehicle."""
    found, box = (
        model("nps-auv2", (0.0, 0.0, 0.0)),
        hinf.problem.Envelope(0.15, 0.15, 0.1, 0.05, 0.175),
    )
    old = hinf.auv_system(hinf.problem.AuvDesignSettings(envelope=box))
    new = linear_model(found.vehicle, loop_delay=1.25).system
    one, other = (
        hinf.design(x, hinf.problem.DEFAULT_K1, hinf.problem.DEFAULT_K2).gamma for x in (new, old)
    )
    assert one is not None
    assert other is not None
    assert one <= 1.01 * other


def test_the_thrust_map_gives_what_is_commanded() -> None:
    """Accelerations as commanded, none of roll and pitch, within the limits at full authority."""
    found = model("bluerov2-heavy")
    vehicle, own = found.vehicle, found.actuation
    x = [found.trim.state[name] for name in vehicle.states]
    for j, name in enumerate(own.commands):
        most = own.thrust_map[:, j] * own.authority[j]
        both = np.abs([own.at_trim + most, own.at_trim - most])
        assert both.max() == pytest.approx(own.limits[0])
        command = own.at_trim + most
        y = dict(zip(vehicle.states, x, strict=True))
        for actuator, value in zip(vehicle.actuators, command, strict=True):
            y[f"actual.{actuator.name}"] = value
        done = dict(
            zip(vehicle.states, vehicle.rates(list(y.values()), (), [0.0] * 17), strict=True)
        )
        for state, rate in done.items():
            if state.startswith("nu."):
                assert rate == pytest.approx(own.authority[j] * (state == name), abs=1e-9)


def test_the_note_has_the_parameters_of_its_vehicle() -> None:
    """By which a run names a plant that is another: mass and delay are among them."""
    found = model("nps-auv2")
    own, designed = dict(found.vehicle.parameters), dict(plant_note(found).parameters)
    assert {name: own.get(name) for name in designed} == designed
    assert (designed["mass"], designed["delay.d"]) == (5454.0, 0.5)


def test_the_note_says_which_share_of_the_envelope_is_proved() -> None:
    """The whole of it, or the share of the ladder that a design was made for."""
    vehicle = load_vehicle("nps-auv2")
    assert plant_note(linear_model(vehicle)).envelope_share == 1.0
    half = {name: 0.5 * bound for name, bound in vehicle.envelope.items()}
    assert plant_note(linear_model(vehicle, envelope=half)).envelope_share == 0.5


def test_what_holds_no_trim_is_refused() -> None:
    """Names the actuator that is too weak, and the motion that nothing holds."""
    text = vehicle_text("bluerov2-heavy")
    with pytest.raises(NotAchievableError, match=r"thruster\.t5.*limit|limit.*thruster\.t"):
        find_trim(vehicle_from_toml(text.replace("limit = 30.4", "limit = 0.1"), where="x"))
    text = vehicle_text("remus100").replace("limit = 41.2", "limit = 0.5")
    with pytest.raises(NotAchievableError, match=r"thruster\.propeller"):
        find_trim(vehicle_from_toml(text, where="x"))
    quaternion = vehicle_text("remus100").replace(
        "degrees_of_freedom = 6", 'degrees_of_freedom = 6\nattitude = "quaternion"'
    )
    with pytest.raises(InputError, match="quaternion"):
        find_trim(vehicle_from_toml(quaternion, where="x"))


def test_the_trim_holds() -> None:
    """At the trim no velocity changes, and not the depth: from the plant's own equations."""
    for name in NAMES:
        vehicle = load_vehicle(name)
        trim = find_trim(vehicle)
        x = [trim.state[state] for state in vehicle.states]
        u = [trim.commands.get(state, 0.0) for state in vehicle.inputs]
        done = vehicle.rates(x, x if vehicle.damping else (), u)
        by_name = dict(zip(vehicle.states, done, strict=True))
        still = [rate for s, rate in by_name.items() if s[:3] in ("nu.", "act") or s == "eta.z"]
        assert max(map(abs, still)) < 1e-9
        assert trim.state["nu.u"] == vehicle.trim.get("nu.u", 0.0)
