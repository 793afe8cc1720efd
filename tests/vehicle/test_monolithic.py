"""A flight of FMUs agrees with one simulation of plant, observer and links, to the method's order."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cosim import fmu as fmus
from cosim.hinf import Delay, DelaySystem, analyse, output_feedback_to_json, pair_of
from cosim.models import Measurement
from cosim.scenario import FmuCache, execute_unrecorded, parse, prepare
from tests.vehicle.monolithic import Loop, Packet, simulate

A, LATE = np.array([[0.0, 1.0], [-8.0, -4.0]]), np.array([[0.0, 0.0], [0.0, -0.2]])
AGE = 0.37
K = np.array([[-0.3, -0.9]])
L = [np.array([[0.15], [0.1]]), np.array([[0.0], [0.2]])]
C = [np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])]
START, ESTIMATE, LIMIT = (2.0, -0.3), (1.5, 0.0), 0.3
STEP, END = 0.05, 5.0
FIX, TRANSIT, SPEED = 0.4, 0.55, 0.1

SCENARIO = f"""
title = "one axis"
connect = [
    "plant.x[1] -> fix.u[1]", "plant.x[2] -> speed.u[1]", "controller.u -> plant.u",
    "fix.y -> controller.fix : up", "fix.stamp -> controller.stamp.fix : up",
    "speed.y -> controller.speed", "speed.stamp -> controller.stamp.speed",
]
[run]
end = {END}
step = {STEP}
[components]
plant = {{ fmu = "plant.fmu", parameters = {{ "solver.step" = 0.05 }} }}
fix = {{ fmu = "fix.fmu" }}
speed = {{ fmu = "speed.fmu" }}
controller = {{ fmu = "controller.fmu", parameters = {{ "solver.step" = 0.05 }} }}
[links.up]
kind = "packet"
sample_time = {FIX}
offset = {STEP}
delay = {TRANSIT}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMUs of the axis, with a certificate of its pair."""
    made = tmp_path_factory.mktemp("axis")
    system = DelaySystem(
        A, [[0.0], [1.0]], [[0.0], [1.0]], [[0.1, 0.0], [0.0, 0.0]], D2=[[0.0], [1.0]],
        delays=[Delay(AGE, LATE)],
    )  # fmt: skip
    ages = (1.2, 0.3)
    measured = [
        Measurement(name, rows, d, any_age=True)
        for name, rows, d in zip(("fix", "speed"), C, ages, strict=True)
    ]
    pair = pair_of(system, measured, K, L)
    found = analyse(pair.system, pair.gain, order=0)
    assert found.certificate is not None
    data = json.dumps(output_feedback_to_json(pair, found.certificate)).encode()
    module = fmus.component_module
    specs = {
        "plant": module("delayed_plant.variables").delayed_plant_spec(
            system, name="plant", initial=START, F=(0.0, 1.0), origin=""
        ),
        "controller": module("observer.variables").output_feedback_spec(
            "controller", data, limits=[LIMIT], initial=ESTIMATE
        ),
        "fix": module("sensor.variables").sensor_spec("fix", [("x", None)], sample_time=FIX),
        "speed": module("sensor.variables").sensor_spec("speed", [("v", None)], sample_time=SPEED),
    }
    kind = fmus.target_named("native", "prebuilt")
    for name, spec in specs.items():
        fmus.write_fmu(spec, made / f"{name}.fmu", kind)
    return made


def flown(folder: Path, step: float) -> dict[str, np.ndarray]:
    """Signals of the flight with this integration step."""
    text = SCENARIO.replace('"solver.step" = 0.05', f'"solver.step" = {step}')
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
    loop = Loop(
        lambda x, past, u: A @ x + LATE @ past(AGE) + np.array([0.0, u[0]]),
        *(np.array(START), np.array(ESTIMATE)),
        *(A, [(AGE, LATE)], np.array([[0.0], [1.0]]), C, L, K, np.array([LIMIT])),
    )
    packets = [
        Packet(round(k * FIX + STEP + TRANSIT, 9), 0, round(k * FIX, 9))
        for k in range(round(END / FIX))
    ]
    packets += [
        Packet(round(k * SPEED + STEP, 9), 1, round(k * SPEED, 9))
        for k in range(round(END / SPEED))
    ]
    states, estimates, commands = simulate(loop, points.tolist(), packets)
    return np.hstack([states, estimates]), commands[:, 0]


def test_a_flight_agrees_with_one_simulation_of_everything(folder: Path) -> None:
    """The error falls by 16 as the integration step is halved: limits, delay and late fixes."""
    coarse, fine = flown(folder, 0.05), flown(folder, 0.025)
    truth, command = alone(coarse["points"])
    errors = [float(np.abs(one["flight"] - truth).max()) for one in (coarse, fine)]
    assert np.abs(command).max() == LIMIT
    assert np.abs(fine["command"] - command).max() < 1e-4
    assert errors[0] < 1e-3
    assert 13 < errors[0] / errors[1] < 20
