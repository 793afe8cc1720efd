"""A flight of FMUs agrees with one simulation of everything, to the method's order.

An axis, linear but for its limits; and the survey of `auv-survey`, whose vehicle is nonlinear, with
equations of the vehicle that are written again here, as matrices of products of velocities.
"""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import fmu_store
from vehicle import axis_flight as axis
from vehicle.monolithic import Loop, Packet, simulate

from cosim.scenario import (
    FmuCache,
    execute_run,
    execute_unrecorded,
    load,
    parse,
    prepare,
)
from cosim.trace import Trace

STEP, END = 0.05, axis.USUAL["end"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMUs of the axis."""
    return axis.write_axis(tmp_path_factory.mktemp("axis"))


def flight_of_axis(folder: Path, step: float) -> dict[str, np.ndarray]:
    """Signals of the flight with this integration step."""
    text = axis.scenario(step=step, plant='"w[1]" = 0.0')
    loaded = parse(text, name="axis", where="axis.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(folder / "fmus", folder))
    _, run = execute_unrecorded(prepared, zero_state_run=False)
    signals = [("plant", "x[1]"), ("plant", "x[2]")]
    signals += [("controller", "estimate[1]"), ("controller", "estimate[2]")]
    return {
        "points": run.points_ns / 1e9,
        "flight": np.column_stack([run.signal(*signal) for signal in signals]),
        "command": run.signal("controller", "u[1]"),
    }


def alone(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and estimates, then commands, of the simulation by SciPy at these points."""
    A, late, age = axis.A, axis.LATE, axis.AGE
    loop = Loop(
        lambda x, past, u: A @ x + late @ past(age) + np.array([0.0, u[0]]),
        *(np.array(axis.START), np.array(axis.ESTIMATE)),
        *(A, [(age, late)], np.array([[0.0], [1.0]]), axis.C, axis.L, axis.K),
        np.array([axis.LIMIT]),
    )
    end, transit = float(END), float(axis.USUAL["transit"])
    packets = [
        Packet(round(k * axis.FIX + STEP + transit, 9), 0, round(k * axis.FIX, 9))
        for k in range(round(end / axis.FIX))
    ]
    packets += [
        Packet(round(k * axis.SPEED + STEP, 9), 1, round(k * axis.SPEED, 9))
        for k in range(round(end / axis.SPEED))
    ]
    states, estimates, commands = simulate(loop, points.tolist(), packets)
    return np.hstack([states, estimates]), commands[:, 0]


def test_a_flight_agrees_with_one_simulation_of_everything(folder: Path) -> None:
    """The error falls by 16 as the integration step is halved: limits, delay and late fixes."""
    coarse, fine = flight_of_axis(folder, 0.05), flight_of_axis(folder, 0.025)
    truth, command = alone(coarse["points"])
    errors = [float(np.abs(one["flight"] - truth).max()) for one in (coarse, fine)]
    assert np.abs(command).max() == axis.LIMIT
    assert np.abs(fine["command"] - command).max() < 1e-4
    assert errors[0] < 1e-3
    assert 13 < errors[0] / errors[1] < 20


# the survey


def npsauv(x: np.ndarray, past: Any, thrust: np.ndarray) -> np.ndarray:
    """x' of NPS AUV II in four degrees of freedom: Healey and Lienard (1993), and its damping loop.

    Coefficients of products of velocities, non-dimensional by powers of the length: row by row
    X, Y, Z, N; the powers are those of the prime system.
    """
    mass, inertia, length, half = 5454.0, 13587.0, 5.3, 500.0
    added = np.array(
        [[-7.6e-3, 0, 0, 0], [0, -5.5e-2, 0, 1.2e-3], [0, 0, -2.4e-1, 0], [0, 1.2e-3, 0, -3.4e-3]]
    )
    scale = np.array([[3, 3, 3, 4], [3, 3, 3, 4], [3, 3, 3, 4], [4, 4, 4, 5]])
    M = np.diag([mass, mass, mass, inertia]) - half * length**scale * added
    u, v, w, r = x[4:]
    # u v w r: powers of the length 2, 3 with one r, 4 with two, and one more for the moment
    hydro = np.array(
        [
            5.3e-2 * v * v + 1.7e-1 * w * w + 2.0e-2 * length * v * r + 4.0e-3 * length**2 * r * r,
            -1.0e-1 * u * v + 6.8e-2 * v * w + length * (3.0e-2 * u * r - 1.9e-2 * w * r),
            -3.0e-1 * u * w - 6.8e-2 * v * v + 4.5e-2 * length * v * r - 7.4e-3 * (length * r) ** 2,
            length * (-7.4e-3 * u * v - 2.7e-2 * v * w)
            + length**2 * (-1.6e-2 * u * r + 7.4e-3 * w * r),
        ]
    )
    turning = mass * r * np.array([v, -u, 0.0, 0.0])
    late = past(0.5)[4:]
    nu = np.linalg.solve(M, turning + half * length**2 * hydro + thrust) - 0.05 * late
    c, s = np.cos(x[3]), np.sin(x[3])
    return np.concatenate(([c * u - s * v, s * u + c * v, w, r], nu))


FREE = {"eta.x": 1.0, "eta.y": -0.5, "eta.z": 0.3, "eta.psi": 0.5}
FAST = {"nu.u": 0.8, "nu.v": -0.3, "nu.w": 0.2, "nu.r": 0.15}
STATES = tuple({**FREE, **FAST})
AT = 0.2
"""Communication step of the flight [s], four times the scenario's: its errors can be seen."""


def flight_of_survey(step: float, folder: Path) -> Trace:
    """Its trace, with this integration step in plant and observer, far outside the envelope."""
    start = {f"initial.{name}": value for name, value in {**FREE, **FAST}.items()}
    quiet = {f"noise[{i}]": 0.0 for i in range(1, 7)}
    parameters: dict[str, dict[str, float]] = {
        "plant": {**start, "solver.step": step},
        "controller": {"solver.step": step, "age.onboard": 5.0, "initial.estimate[1]": 0.8},
        "onboard": {**quiet, "sample_time": AT},
        "usbl": {"noise[1]": 0.0, "noise[2]": 0.0, "sample_time": 2.0},
    }
    changed = [f"run.step={AT}", "run.end=10", "run.seed=4"]
    for name, values in parameters.items():
        listed = ", ".join(f'"{key}" = {value}' for key, value in values.items())
        changed.append(f"components.{name}.parameters={{ {listed} }}")
    changed += [f"links.{name}.offset={AT}" for name in ("onboard", "fixes", "set_points")]
    changed.append(f"links.onboard.delay={AT}")
    prepared = prepare(load("auv-survey", changed), FmuCache(fmu_store("native"), folder))
    return Trace(execute_run(prepared, folder / f"{step}.mcap").trace)


def survey_alone(trace: Trace) -> np.ndarray:
    """States and estimates at the points of a flight, with what its links and its sea gave."""
    path = files("cosim.scenario").joinpath("library", "designs", "auv-survey.json")
    design = json.loads(path.read_bytes())
    note, plant = design["plant_note"], design["plant"]
    B, K = np.array(plant["B"]), np.array(design["K"])
    into, outer = trace.read("/controller/input"), trace.read("/plant/input")
    points = trace.read("/plant/output").log_time_ns / 1e9
    packets = []
    for i, one in enumerate(design["measurements"]):
        stamps = into[f"stamp.{one['name']}"]
        new = np.flatnonzero(np.diff(stamps, prepend=stamps[0]))
        packets += [Packet(into.log_time_ns[k] / 1e9, i, float(stamps[k])) for k in new]
    columns = [f"reference[{i}]" if i < 5 else "" for i in range(1, 9)]
    reference = np.column_stack([into[c] if c else 0.0 * into.log_time_ns for c in columns])
    waves = np.column_stack([outer[f"disturbance.{axis}"] for axis in "uvwr"])

    def row_at(table: Any, rows: np.ndarray, t: float) -> np.ndarray:
        place = int(np.searchsorted(table.log_time_ns, round(t * 1e9), side="right")) - 1
        return np.asarray(rows[place])

    late = next(d for d in plant["delays"] if np.any(d["A"]))
    loop = Loop(
        npsauv,
        np.array([*FREE.values(), *FAST.values()]),
        np.array([0.8, *[0.0] * 7]),
        *(np.array(plant["A"]), [(late["d"], np.array(late["A"]))], B),
        *([np.array(m["C"]) for m in design["measurements"]], [np.array(L) for L in design["L"]]),
        *(K, np.full(4, 2500.0), np.array(note["thrust_map"]), np.array(note["control"]["map"])),
        reference=lambda t: row_at(into, reference, t),
        disturbance=lambda t: np.concatenate((np.zeros(4), row_at(outer, waves, t))),
    )
    states, estimates, _ = simulate(loop, points.tolist(), packets)
    return np.hstack([states, estimates])


@pytest.mark.slow
def test_a_flight_of_a_nonlinear_vehicle_agrees_with_one_simulation_of_everything(
    tmp_path: Path,
) -> None:
    """Far outside the envelope, over lossy links: the error falls by 16 as the step is halved."""
    errors: list[np.ndarray] = []
    truth = None
    for step in (0.2, 0.1):
        trace = flight_of_survey(step, tmp_path)
        truth = survey_alone(trace) if truth is None else truth
        plant, out = trace.read("/plant/output"), trace.read("/controller/output")
        signals = [plant[name] for name in STATES] + [out[f"estimate[{i}]"] for i in range(1, 9)]
        errors.append(np.abs(np.column_stack(signals) - truth).max(axis=0))
    assert 1e-10 < errors[0].max() < 1e-6
    assert 13 < errors[0].max() / errors[1].max() < 20
