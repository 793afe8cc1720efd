"""A state feedback that reports the use of its assumptions; without that it is as it was."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pairs
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from raw_fmu import RawFmu
from shared import made_once
from wheel import tape_fmu

from cosim.core import InputError
from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, component_module

VARIABLES = component_module("hinf_controller.variables")
PLAIN = CATALOGUE["HinfController"]
SPEC = VARIABLES.watched_spec(PLAIN, age=1.25, envelope={"nu.u": 0.3, "eta.psi": 0.35})


@pytest.fixture(scope="module")
def native() -> Path:
    made = made_once("watched", lambda folder: build_fmu(SPEC, folder, prebuilt=False))
    return made / "HinfController.fmu"


def flight(count: int = 80) -> tuple[list[float], list[dict[str, float]]]:
    seeded, found = random.Random(4), []  # noqa: S311 - no secret
    points = [k * 0.05 for k in range(count + 1)]
    for t in points[:-1]:
        values = {"eta.x": seeded.uniform(-9, 9), "nu.u": seeded.uniform(-0.5, 0.5)}
        if seeded.random() < 0.1:
            values["stamp.state"] = t - seeded.uniform(0.0, 0.5)
        found.append(values)
    return points, found


def test_commands_are_those_without_a_watch_and_all_flavours_agree(
    native: Path, tmp_path: Path
) -> None:
    """In C, read by a prebuilt binary, and in Python; saved half-way and resumed."""
    points, inputs = flight()
    plain, own = Plain(), pairs.Equations(SPEC)
    expected = []
    for k, values in enumerate(inputs):
        plain.step(points[k + 1], values)
        own.step(points[k + 1], values)
        assert [own.v[name] for name in plain.outputs] == plain.row()
        expected.append(own.row())
    assert own.v["assumption.met"] == 0
    paths = [
        native,
        tape_fmu(SPEC, "sampled_watched", tmp_path),
        build_fmu(SPEC, tmp_path / "python", "python"),
    ]
    for path in paths:
        assert validate_fmu(str(path)) == []
        with RawFmu(path) as raw:
            raw.initialise()
            half = len(inputs) // 2
            assert pairs.drive(raw, SPEC, points[: half + 1], inputs) == expected[:half]
            data = raw.saved()
            for _ in range(2):
                assert pairs.drive(raw, SPEC, points[half:], inputs[half:]) == expected[half:]
                raw.resume(data)
            raw.put({"stamp.state": 99.0})
            with pytest.raises(FMICallException):
                raw.step(points[half], 0.05)
            assert "stamp.state is 99.0 s, in the future" in raw.messages


class Plain:
    """The controller without a watch."""

    def __init__(self) -> None:
        self.equations = pairs.Equations(PLAIN)
        self.outputs = [v.name for v in PLAIN.variables if v.causality == "output"]

    def step(self, end: float, inputs: dict[str, float]) -> None:
        known = {name: x for name, x in inputs.items() if not name.startswith("stamp")}
        self.equations.v.update(known)
        self.equations.behaviour.advance(self.equations.v, end)

    def row(self) -> list[Any]:
        return [self.equations.v[name] for name in self.outputs]


def test_every_use_is_a_share_of_what_is_allowed() -> None:
    """Age against 1.25 s, speed and heading against the envelope, thrust against its limit."""
    own = pairs.Equations(SPEC)
    own.step(0.5, {})
    assert (own.v["present.age"], own.v["assumption.met"]) == (0.4, 1)
    own.step(0.75, {"stamp.state": 0.25, "nu.u": -0.15, "eta.psi": 0.07})
    assert own.v["present.age"] == 0.4
    assert own.v["present.envelope"] == 0.5
    thrust = abs(own.v["force.x"])
    assert own.v["present.saturation"] == pytest.approx(thrust / 2500.0)
    own.step(1.5, {"nu.u": 0.0, "eta.x": 1000.0})
    assert own.v["present.age"] == 1.0
    assert own.v["assumption.met"] == 0
    assert own.v["present.saturation"] > 10
    assert own.v["assumption.envelope"] == 0.5
    assert own.v["present.envelope"] == pytest.approx(0.2)
    own.step(1.6, {"eta.x": 0.0})
    assert own.v["present.age"] == pytest.approx(1.35 / 1.25)
    assert own.v["present.saturation"] < 1 < own.v["assumption.saturation"]


def test_an_envelope_of_what_is_not_measured_is_refused() -> None:
    """And a limit that no share can be taken of."""
    with pytest.raises(InputError, match="does not fit what is measured"):
        VARIABLES.watched_spec(PLAIN, age=1.0, envelope={"nu.p": 0.1})
    with pytest.raises(ValueError, match=r"limit\.force must be positive"):
        pairs.Equations(SPEC, {"limit.force": 0.0})
