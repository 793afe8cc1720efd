"""The plant FMU of a vehicle file: every flavour computes the same bits, and refuses alike."""

from __future__ import annotations

import math
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from raw_fmu import RawFmu
from shared import made_once, sampled
from test_native_agrees import differing
from wheel import tape_fmu

from cosim.fmu import build_fmu
from cosim.fmu.export import ComponentSpec

sys.path.insert(0, str(Path(__file__).parents[1] / "vehicle"))
from vehicle_files import every_term, free

STEPS = [0.05] * 20 + [1 / math.pi] * 4 + [1e-4, 0.3]
START = {"initial.nu.u": 0.7, "initial.nu.r": 0.1, "initial.actual.rudder": 0.1}


def spec_of(attitude: str) -> ComponentSpec:
    return every_term(attitude).fmu_spec(f"Every_{attitude}")


def compiled(name: str) -> Path:
    """The native FMU of a vehicle, built once."""
    spec = spec_of(name)

    def build(folder: Path) -> None:
        build_fmu(spec, folder, prebuilt=False)

    return made_once(f"vehicle-plant/{name}", build) / f"{spec.name}.fmu"


@pytest.mark.parametrize("attitude", sampled(["euler", "quaternion"], 1))
def test_c_and_python_agree_to_the_last_bit(attitude: str) -> None:
    """Every term there is, with inputs that jump, lags, limits, a delay."""
    spec, path = spec_of(attitude), compiled(attitude)
    assert validate_fmu(str(path)) == []
    assert differing(path, spec, STEPS, START) == []


def rows(path: Path) -> list[list[float]]:
    """Every output of a run of one second."""
    with RawFmu(path) as raw:
        raw.initialise(START)
        found = []
        for k in range(20):
            raw.put({"thruster.propeller": 20.0 * math.sin(k), "fin.rudder": 0.2, "current.y": 0.3})
            raw.step(k * 0.05, 0.05)
            found.append(raw.get(*raw.outputs()))
        assert raw.messages == ""
        return found


@pytest.mark.parametrize("attitude", sampled(["euler", "quaternion"], 1))
def test_a_binary_that_reads_its_model_and_a_python_slave_compute_the_same(
    attitude: str, tmp_path: Path
) -> None:
    """Euler angles need a kind of their own, which watches the pitch; a quaternion does not."""
    spec = spec_of(attitude)
    kind = "vehicle" if attitude == "euler" else "plant"
    tape = tape_fmu(spec, kind, tmp_path / "tape")
    slave = build_fmu(spec, tmp_path / "python", "python")
    expected = rows(compiled(attitude))
    assert rows(tape) == expected
    assert rows(slave) == expected


@pytest.mark.parametrize("flavour", ["tape", "python"])
def test_a_run_ends_by_name_where_euler_angles_have_no_rates(flavour: str, tmp_path: Path) -> None:
    """A vehicle that pitches up without end; what it was before the step can still be read."""
    spec = free().fmu_spec("Free")
    if flavour == "tape":
        path = tape_fmu(spec, "vehicle", tmp_path)
    else:
        path = build_fmu(spec, tmp_path, "python")
    with RawFmu(path) as raw:
        raw.initialise({"initial.nu.q": 0.8, "initial.eta.theta": 1.2})
        raw.step(0.0, 0.1)
        before = raw.get("eta.theta")
        with pytest.raises(FMICallException):
            raw.step(0.1, 1.0)
        assert "near +-90 degrees Euler angles have no rates" in raw.messages
        assert 'set attitude = "quaternion" in the vehicle file' in raw.messages
        if flavour != "python":
            assert raw.get("eta.theta") == before
    # the Python slave logs, and refuses the first step
    refused = nullcontext() if flavour == "python" else pytest.raises(FMICallException)
    for wrong, why in (
        ({"initial.eta.theta": -1.56}, "near +-90 degrees"),
        ({"hydro.N_rdot": 2.41}, "positive definite: it fails at nu.r"),
    ):
        with RawFmu(path) as raw:
            with refused:
                raw.initialise(wrong)
            assert why in raw.messages


@pytest.mark.slow
def test_a_quaternion_has_the_length_one() -> None:
    """Anything else is refused before the run."""
    with RawFmu(compiled("quaternion")) as raw:
        with pytest.raises(FMICallException):
            raw.initialise({"initial.quaternion.q0": 0.9})
        assert "the initial quaternion must have the length 1" in raw.messages
