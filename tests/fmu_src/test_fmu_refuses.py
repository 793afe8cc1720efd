"""What a python FMU must refuse: with a message through the logger, and never a crash.

Each abuse runs in a process of its own, since a crash would take the test session with it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from shared import sampled

PREPARE = """
import json, math, sys
from pathlib import Path
from fmpy.fmi1 import FMICallException
from raw_fmu import RawFmu

folder = Path(sys.argv[1])

def attempt(call, *arguments):
    try:
        return call(*arguments)
    except FMICallException as error:
        return f"status {error.status}"

def fresh(name="DelayedPlant", **parameters):
    return RawFmu(folder / f"{name}.fmu").initialise(parameters)
"""

LEAVE = """
result["messages"] = raw.messages
result["step"] = attempt(raw.step, 0.0, 0.1)
result["again"] = attempt(raw.step, 0.0, 0.1)
result["x"] = raw.get("x[1]")
result["terminate"] = attempt(raw.fmu.terminate)
raw.__exit__()
# the process and the FMU itself are none the worse
raw = fresh()
raw.step(0.0, 0.1)
result["next"] = raw.get("x[1]")
raw.__exit__()
print(json.dumps(result))
"""

REFUSED = {
    "NaN input": ("raw.put({'u[1]': math.nan})", "u[1] must be finite, got nan"),
    "infinite input": ("raw.put({'w[1]': -math.inf})", "w[1] must be finite, got -inf"),
    "unknown reference": (
        "raw.fmu.setReal([9999], [1.0])",
        "value reference 9999 is unknown; 1 to 44 exist",
    ),
    "unknown reference read": (
        "result['value'] = raw.fmu.getReal([9999])",
        "value reference 9999 is unknown; 1 to 44 exist",
    ),
    "largest reference": ("raw.fmu.getReal([2**32 - 1])", "is unknown; 1 to 44 exist"),
    "late parameter": (
        "raw.put({'A[1,1]': 2.0})",
        "A[1,1] is a fixed parameter and cannot be written after initialisation",
    ),
    "output": ("raw.put({'x[1]': 2.0})", "x[1] is an output and cannot be written"),
    "Integer call on a Real": (
        "raw.fmu.setInteger([1], [1])",
        "value reference 1 (u[1]) is of type Real, not Integer",
    ),
    "Integer read of a Real": ("raw.fmu.getInteger([1])", "(u[1]) is of type Real, not Integer"),
    "Boolean call": ("raw.fmu.setBoolean([1], [True])", "(u[1]) is of type Real, not Boolean"),
    "Boolean read": (
        "result['value'] = list(raw.fmu.getBoolean([1]))",
        "(u[1]) is of type Real, not Boolean",
    ),
    "String call": ("raw.fmu.setString([1], ['a'])", "(u[1]) is of type Real, not String"),
    "String read": (
        "result['value'] = [t.decode() for t in raw.fmu.getString([1, 2])]",
        "(u[1]) is of type Real, not String",
    ),
    "unreadable state": ("raw.resume(b'no state at all')", "the saved state cannot be read"),
    "state that is no object": ("raw.resume(b'[1, 2]')", "the saved state cannot be read"),
    "empty state": ("raw.resume(b'{}')", "the saved state is not one of this component"),
    "state of another component": (
        "other = fresh('WaveField'); raw.resume(other.saved()); other.__exit__()",
        "the saved state is not one of this component",
    ),
    "state cut at a value": (
        (
            "d = json.loads(raw.saved()); del d['behaviour']['line']['pieces']; "
            "raw.resume(json.dumps(d).encode())"
        ),
        "the saved state does not fit this component",
    ),
    "initialisation twice": (
        "raw.fmu.enterInitializationMode()",
        "enterInitializationMode is not allowed while running",
    ),
    "step from elsewhere": (
        "attempt(raw.step, 5.0, 0.1)",
        "the step starts at t = 5.0 s, but the instance is at 0.0 s",
    ),
    "step from NaN": ("attempt(raw.step, math.nan, 0.1)", "must start at a finite time, got nan"),
    "step backwards": ("attempt(raw.step, 0.0, -0.1)", "must be finite and not negative, got -0.1"),
    "step of NaN": ("attempt(raw.step, 0.0, math.nan)", "must be finite and not negative, got nan"),
}


def abused(fmus: Path, script: str) -> dict[str, Any]:
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, "-c", script, str(fmus)],
        check=False,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(Path(__file__).resolve().parent), "PYTHONFAULTHANDLER": "1"},
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


@pytest.mark.parametrize("case", sampled(REFUSED, 10))
def test_wrong_calls_are_refused_with_a_message(fmus: Path, case: str) -> None:
    """Nothing changes, the next step fails, and nothing crashes."""
    abuse, message = REFUSED[case]
    result = abused(fmus, f"{PREPARE}\nraw = fresh(); result = {{}}\n{abuse}\n{LEAVE}")
    assert message in result["messages"]
    assert result["step"] == result["again"] == "status 2"
    assert result["x"] == [10.0]
    assert result["terminate"] in (0, None)
    assert result["next"] == pytest.approx([5.275960814032278], rel=1e-9)
    assert not any(result.get("value", []))


def test_refused_write_changes_nothing_of_its_call(fmus: Path) -> None:
    """A call that holds one bad value is refused as a whole."""
    script = f"""{PREPARE}
raw = fresh(); result = {{}}
raw.put({{'u[1]': 3.0}})
raw.put({{'u[1]': 5.0, 'w[1]': math.nan}})
result["inputs"] = raw.get('u[1]', 'w[1]')
{LEAVE}"""
    assert abused(fmus, script)["inputs"] == [3.0, 0.0]


def test_step_past_the_stop_time_is_refused(fmus: Path) -> None:
    """Up to it all is well; a stop before the start fails the first step."""
    script = f"""{PREPARE}
raw = RawFmu(folder / "DelayedPlant.fmu"); result = {{}}
raw.fmu.setupExperiment(startTime=0.0, stopTime=0.1)
raw.fmu.enterInitializationMode(); raw.fmu.exitInitializationMode()
result["first"] = attempt(raw.step, 0.0, 0.1)
result["past"] = attempt(raw.step, 0.1, 0.1)
raw.fmu.reset()
raw.fmu.setupExperiment(startTime=1.0, stopTime=0.5)
raw.fmu.enterInitializationMode(); raw.fmu.exitInitializationMode()
result["backwards"] = attempt(raw.step, 1.0, 0.1)
result["messages"] = raw.messages
raw.__exit__()
print(json.dumps(result))
"""
    result = abused(fmus, script)
    assert result["first"] != "status 2"
    assert result["past"] == result["backwards"] == "status 2"
    assert "ends at t = 0.2 s, after the stop time of 0.1 s" in result["messages"]
    assert "the stop time, 0.5 s, must not be before the start time, 1.0 s" in result["messages"]


@pytest.mark.slow
def test_parameter_out_of_bounds_is_refused(fmus: Path) -> None:
    """A negative delay and an amplitude beyond 1 are refused before anything runs."""
    for name, value in (("delay.d", -0.1), ("F.amplitude", 1.5), ("solver.step", 0.0)):
        script = f"""{PREPARE}
raw = RawFmu(folder / "DelayedPlant.fmu").initialise({{ {name!r}: {value} }}); result = {{}}
{LEAVE}"""
        assert f"{name} must be at " in abused(fmus, script)["messages"]


def test_integer_out_of_bounds_is_refused(fmus: Path) -> None:
    """A spectrum that does not exist; a reader of Reals on an Integer."""
    script = f"""{PREPARE}
raw = RawFmu(folder / "WaveField.fmu"); result = {{}}
raw.fmu.setInteger([raw.reference["spectrum"]], [7])
raw.fmu.getReal([raw.reference["spectrum"]])
raw.initialise()
result["step"] = attempt(raw.step, 0.0, 0.1)
result["messages"] = raw.messages
raw.__exit__()
print(json.dumps(result))
"""
    result = abused(fmus, script)
    assert "spectrum must be at most 2, got 7" in result["messages"]
    assert "(spectrum) is of type Integer, not Real" in result["messages"]
    assert result["step"] == "status 2"


def test_indefinite_mass_matrix_is_refused(fmus: Path) -> None:
    """An added mass greater than the vehicle's makes the mass matrix indefinite."""
    script = f"""{PREPARE}
raw = RawFmu(folder / "AuvPlant.fmu").initialise({{"hydro.X_udot": 1.0}}); result = {{}}
result["step"] = attempt(raw.step, 0.0, 0.1)
result["messages"] = raw.messages
raw.__exit__()
print(json.dumps(result))
"""
    result = abused(fmus, script)
    assert "mass plus added mass must be positive" in result["messages"]
    assert result["step"] == "status 2"


def test_step_before_initialisation_is_refused(fmus: Path) -> None:
    """The life cycle is FMI's; after termination values stay readable and steps are refused."""
    script = f"""{PREPARE}
raw = RawFmu(folder / "DelayedPlant.fmu"); result = {{}}
result["early"] = attempt(raw.step, 0.0, 0.1)
result["messages"] = raw.messages
raw.__exit__()
raw = fresh(); raw.step(0.0, 0.1); raw.fmu.terminate()
result["x"] = raw.get("x[1]")
result["late"] = attempt(raw.step, 0.1, 0.1)
result["after"] = raw.messages
raw.__exit__()
print(json.dumps(result))
"""
    result = abused(fmus, script)
    assert result["early"] == result["late"] == "status 2"
    assert "doStep is not allowed while instantiated" in result["messages"]
    assert "doStep is not allowed while terminated" in result["after"]
    assert result["x"] == pytest.approx([5.275960814032278], rel=1e-9)


def test_overflow_and_too_costly_delay_fail_the_step(fmus: Path) -> None:
    """A state that overflows, or a delay that would need millions of internal steps."""
    script = f"""{PREPARE}
result = {{}}
for key, parameters in (("explosion", {{"A[1,1]": 5000.0}}), ("tiny", {{"delay.d": 1e-12}})):
    raw = RawFmu(folder / "DelayedPlant.fmu").initialise(parameters)
    result[key] = attempt(raw.step, 0.0, 1.0), raw.messages
    raw.__exit__()
print(json.dumps(result))
"""
    result = abused(fmus, script)
    assert result["explosion"][0] == result["tiny"][0] == "status 2"
    assert "the state is no longer finite after t =" in result["explosion"][1]
    assert "use a shorter communication step" in result["tiny"][1]


def test_saved_state_restores_a_failed_instance(fmus: Path) -> None:
    """A host that saved before its mistake can go on."""
    script = f"""{PREPARE}
raw = fresh(); result = {{}}
raw.step(0.0, 0.1); saved = raw.saved()
raw.put({{"u[1]": math.nan}})
result["refused"] = attempt(raw.step, 0.1, 0.1)
raw.resume(saved); raw.step(0.1, 0.1)
other = fresh(); other.step(0.0, 0.1); other.step(0.1, 0.1)
result["same"] = raw.get("x[1]") == other.get("x[1]")
raw.__exit__(); other.__exit__()
print(json.dumps(result))
"""
    result = abused(fmus, script)
    assert result == {"refused": "status 2", "same": True}
