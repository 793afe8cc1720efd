"""A flight of FMUs agrees with one simulation of everything, to the method's order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from vehicle import axis_flight as axis
from vehicle.monolithic import Loop, Packet, simulate

from cosim.scenario import FmuCache, execute_unrecorded, parse, prepare

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
