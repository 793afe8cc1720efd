"""One axis of a vehicle with late onboard damping, an observer on board, and its FMUs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from cosim.core import DESIGN_FILE
from cosim.fmu import export as fmus
from cosim.hinf import Delay, DelaySystem, Result, design_output_feedback
from cosim.models import Measurement

A, LATE = np.array([[0.0, 1.0], [-8.0, -4.0]]), np.array([[0.0, 0.0], [0.0, -0.2]])
AGE = 0.37
K = np.array([[-0.3, -0.9]])
L = [np.array([[0.15], [0.1]]), np.array([[0.0], [0.2]])]
C = [np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])]
START, ESTIMATE, LIMIT = (2.0, -0.3), (1.5, 0.0), 0.3
FIX, SPEED = 0.4, 0.1
"""Intervals of the fixes and of the speed [s]."""

SYSTEM = DelaySystem(
    A, [[0.0], [1.0]], [[0.0], [1.0]], [[0.1, 0.0], [0.0, 0.0]], D2=[[0.0], [1.0]],
    delays=[Delay(AGE, LATE)], name="axis",
)  # fmt: skip

SCENARIO = """
title = "one axis"
connect = [
    "plant.x[1] -> fix.u[1]", "plant.x[2] -> speed.u[1]", {command}
    "fix.y -> controller.fix : up", "fix.stamp -> controller.stamp.fix : up",
    "speed.y -> controller.speed", "speed.stamp -> controller.stamp.speed",
]
[run]
end = {end}
step = 0.05
[components]
plant = {{ fmu = "plant.fmu", parameters = {{ "solver.step" = {step}, {plant} }} }}
fix = {{ fmu = "fix.fmu", parameters = {{ "noise[1]" = {noise} }} }}
speed = {{ fmu = "speed.fmu", parameters = {{ "noise[1]" = {speed} }} }}
controller = {{ fmu = "controller.fmu", parameters = {{ "solver.step" = {step}, {controller} }} }}
[links.up]
kind = "packet"
sample_time = 0.4
offset = 0.05
delay = {transit}
loss = {loss}
{more}
"""
USUAL = {
    "command": '"controller.u -> plant.u",',
    "end": 5.0,
    "step": 0.05,
    "plant": '"w[1]" = 0.01',
    "noise": 0.0,
    "speed": 0.0,
    "controller": '"sample_time" = 0.0',
    "transit": 0.55,
    "loss": 0.0,
    "more": '[design]\nfile = "design.json"\n',
}


def scenario(**changed: object) -> str:
    """Return the scenario with these parts in place of the usual ones."""
    return SCENARIO.format(**USUAL | changed)


def axis_design(command_age: float = 0.0) -> Result:
    """Prove K and L for fixes up to 1.2 s old and a speed up to 0.3 s old.

    command_age : a constant one, of a play-out; 0: any age up to a step and some.
    """
    measured = [
        Measurement(name, rows, d, any_age=True, noise=[noise])
        for name, rows, d, noise in zip(("fix", "speed"), C, (1.2, 0.3), (0.05, 0.0), strict=True)
    ]
    return design_output_feedback(
        *(SYSTEM, measured),
        gain=K,
        injections=L,
        order=0,
        command_age=command_age or 0.06,
        command_any_age=command_age == 0.0,
    )


def write_axis(folder: Path, *, command_age: float = 0.0) -> Path:
    """Write the FMUs of the axis and its design; return the folder."""
    found = axis_design(command_age)
    data = json.dumps(DESIGN_FILE.stamped(found.to_json()))
    folder.joinpath("design.json").write_text(data, "utf-8")
    module = fmus.component_module
    specs = {
        "plant": module("delayed_plant.variables").delayed_plant_spec(
            SYSTEM, name="plant", initial=START, F=(0.0, 1.0), origin=""
        ),
        "controller": module("observer.variables").output_feedback_spec(
            *("controller", json.dumps(found.certificate).encode()),
            limits=[LIMIT],
            initial=ESTIMATE,
            command_delay=command_age,
        ),
        "fix": module("sensor.variables").sensor_spec("fix", [("x", None)], sample_time=FIX),
        "speed": module("sensor.variables").sensor_spec("speed", [("v", None)], sample_time=SPEED),
    }
    kind = fmus.target_named("native", "prebuilt")
    for name, spec in specs.items():
        fmus.write_fmu(spec, folder / f"{name}.fmu", kind)
    return folder
