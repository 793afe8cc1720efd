"""What a native FMU must refuse: with a status, a message, and everything left as it was."""

from __future__ import annotations

import ctypes
import json
import math
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import two_delays
from fmpy import fmi2
from fmpy.fmi1 import FMICallException
from raw_fmu import RawFmu

from cosim.fmu import build_fmu

if TYPE_CHECKING:
    from collections.abc import Callable

DISCARD, ERROR = 2, 3


def fresh(folder: Path, name: str = "DelayedPlant", **parameters: float) -> RawFmu:
    return RawFmu(folder / f"{name}.fmu").initialise(parameters)


def attempt(call: Callable[..., Any], *arguments: Any) -> int | None:
    """Give the status of a call that fails."""
    try:
        call(*arguments)
    except FMICallException as error:
        return int(error.status)
    return None


REFUSED: dict[str, tuple[Callable[[RawFmu], Any], str]] = {
    "NaN input": (lambda r: r.put({"u[1]": math.nan}), "u[1] must be finite, got nan"),
    "infinite input": (lambda r: r.put({"w[1]": -math.inf}), "w[1] must be finite, got -inf"),
    "unknown reference": (
        lambda r: r.fmu.setReal([9999], [1.0]),
        "value reference 9999 is unknown; 1 to 44 exist",
    ),
    "unknown reference read": (
        lambda r: r.fmu.getReal([9999]),
        "value reference 9999 is unknown; 1 to 44 exist",
    ),
    "reference of none": (
        lambda r: r.fmu.getReal([0]),
        "value reference 0 is unknown; 1 to 44 exist",
    ),
    "largest reference": (lambda r: r.fmu.getReal([2**32 - 1]), "is unknown; 1 to 44 exist"),
    "late parameter": (
        lambda r: r.put({"A[1,1]": 2.0}),
        "A[1,1] is a fixed parameter and cannot be written after initialisation",
    ),
    "output": (lambda r: r.put({"x[1]": 2.0}), "x[1] is an output and cannot be written"),
    "Integer call on a Real": (
        lambda r: r.fmu.setInteger([1], [1]),
        "value reference 1 (u[1]) is of type Real, not Integer",
    ),
    "Integer read of a Real": (
        lambda r: r.fmu.getInteger([1]),
        "value reference 1 (u[1]) is of type Real, not Integer",
    ),
    "Boolean call": (lambda r: r.fmu.setBoolean([1], [True]), "is of type Real, not Boolean"),
    "Boolean read": (lambda r: r.fmu.getBoolean([1]), "is of type Real, not Boolean"),
    "String call": (lambda r: r.fmu.setString([1], ["a"]), "is of type Real, not String"),
    "String read": (lambda r: r.fmu.getString([1]), "is of type Real, not String"),
    "no state at all": (lambda r: r.resume(b"no state at all" * 9), "is none of these FMUs'"),
    "short state": (lambda r: r.resume(b"[1, 2]"), "cut short"),
    "half a state": (lambda r: r.resume(r.saved()[:-8]), "its size is wrong"),
    "changed state": (
        lambda r: r.resume(r.saved()[:-1] + bytes([r.saved()[-1] ^ 1])),
        "it was damaged",
    ),
    "setup twice": (
        lambda r: r.fmu.setupExperiment(startTime=0.0),
        "setting the start time is not allowed while running",
    ),
    "initialisation twice": (
        lambda r: r.fmu.enterInitializationMode(),
        "enterInitializationMode is not allowed while running",
    ),
    "end of no initialisation": (
        lambda r: r.fmu.exitInitializationMode(),
        "exitInitializationMode is not allowed while running",
    ),
    "step from elsewhere": (
        lambda r: r.step(5.0, 0.1),
        "the step starts at t = 5.0 s, but the instance is at 0.0 s",
    ),
    "step from NaN": (lambda r: r.step(math.nan, 0.1), "must start at a finite time, got nan"),
    "step backwards": (lambda r: r.step(0.0, -0.1), "must be finite and not negative, got -0.1"),
    "step of NaN": (lambda r: r.step(0.0, math.nan), "must be finite and not negative, got nan"),
    "step without end": (lambda r: r.step(0.0, math.inf), "must be finite and not negative"),
    "derivative by a parameter": (
        lambda r: r.fmu.getDirectionalDerivative(
            [r.reference["z[1]"]], [r.reference["A[1,1]"]], [1.0]
        ),
        "A[1,1] is no input",
    ),
    "derivative of an input": (
        lambda r: r.fmu.getDirectionalDerivative([1], [1], [1.0]),
        "u[1] is no output",
    ),
    "derivatives of inputs": (
        lambda r: r.fmu.fmi2SetRealInputDerivatives(
            r.fmu.component,
            (ctypes.c_uint * 1)(0),
            1,
            (ctypes.c_int * 1)(1),
            (ctypes.c_double * 1)(1.0),
        ),
        "inputs are held",
    ),
    "unknown log category": (
        lambda r: r.fmu.setDebugLogging(True, ["gossip"]),  # noqa: FBT003 - fmpy's signature
        "there is no log category gossip",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_calls_are_refused_with_a_message(native_fmus: Path, case: str) -> None:
    """Status and message; values stay; steps fail; a saved state or a reset brings it back."""
    abuse, message = REFUSED[case]
    with fresh(native_fmus) as raw, fresh(native_fmus) as other:
        saved = raw.saved()
        assert attempt(abuse, raw) == ERROR
        assert message in raw.messages
        assert {status for status, _ in raw.logged} == {ERROR}
        assert attempt(raw.step, 0.0, 0.1) == ERROR
        assert "doStep is not allowed while failed" in raw.messages
        assert attempt(raw.put, {"u[1]": 1.0}) == ERROR
        assert raw.get("x[1]", "u[1]", "A[1,1]") == [10.0, 0.0, -5.0]
        other.step(0.0, 0.1)
        expected = other.get("x[1]", "z[1]")
        raw.resume(saved)
        raw.step(0.0, 0.1)
        assert raw.get("x[1]", "z[1]") == expected
        attempt(abuse, raw)
        raw.fmu.reset()
        raw.initialise()
        raw.step(0.0, 0.1)
        assert raw.get("x[1]", "z[1]") == expected


def test_refused_write_changes_nothing_of_its_call(native_fmus: Path) -> None:
    """A call that holds one bad value is refused as a whole."""
    with fresh(native_fmus) as raw:
        raw.put({"u[1]": 3.0})
        assert attempt(raw.put, {"u[1]": 5.0, "w[1]": math.nan}) == ERROR
        assert raw.get("u[1]", "w[1]") == [3.0, 0.0]


@pytest.mark.parametrize(
    ("name", "value", "bounds"),
    [
        ("delay.d", -0.1, "at least 0.0, got -0.1"),
        ("F.amplitude", 1.5, "at most 1.0, got 1.5"),
        ("solver.step", 0.0, "at least 1e-06, got 0.0"),
    ],
)
def test_parameter_out_of_bounds_is_refused(
    native_fmus: Path, name: str, value: float, bounds: str
) -> None:
    """Before anything runs, with the bounds."""
    with RawFmu(native_fmus / "DelayedPlant.fmu") as raw:
        assert attempt(raw.put, {name: value}) == ERROR
        assert f"{name} must be {bounds}" in raw.messages


def test_integer_out_of_bounds_is_refused(native_fmus: Path) -> None:
    """A spectrum that does not exist; a reader of Reals on an Integer."""
    with RawFmu(native_fmus / "WaveField.fmu") as raw:
        reference = raw.reference["spectrum"]
        assert attempt(raw.fmu.getReal, [reference]) == ERROR
        assert "(spectrum) is of type Integer, not Real" in raw.messages
        raw.fmu.reset()
        assert attempt(raw.fmu.setInteger, [reference], [7]) == ERROR
        assert "spectrum must be at most 2.0, got 7.0" in raw.messages
        raw.fmu.reset()
        assert raw.fmu.getInteger([reference]) == [1]


def test_step_past_the_stop_time_is_refused(native_fmus: Path) -> None:
    """FMI 2.0.4, 4.2.2: an error; up to it, rounding of a summed time included, all is well."""
    with RawFmu(native_fmus / "DelayedPlant.fmu") as raw:
        raw.fmu.setupExperiment(startTime=0.0, stopTime=0.3)
        raw.fmu.enterInitializationMode()
        raw.fmu.exitInitializationMode()
        for k in range(3):
            raw.step(k * 0.1, 0.1)
        state = raw.saved()
        assert attempt(raw.step, 0.3, 1e-3) == ERROR
        assert "ends at t = 0.301 s, after the stop time of 0.3 s" in raw.messages
        raw.resume(state)  # which has the stop time
        assert attempt(raw.step, 0.3, 0.1) == ERROR
        raw.fmu.reset()
        raw.initialise().step(0.0, 1.0)


@pytest.mark.parametrize("stop", [0.5, math.nan])
def test_stop_before_the_start_is_refused(native_fmus: Path, stop: float) -> None:
    with RawFmu(native_fmus / "DelayedPlant.fmu") as raw:
        call = lambda: raw.fmu.setupExperiment(startTime=1.0, stopTime=stop)  # noqa: E731
        assert attempt(call) == ERROR
        assert f"the stop time, {stop} s, must not be before the start time" in raw.messages


def test_indefinite_mass_matrix_is_refused(native_fmus: Path) -> None:
    """An added mass greater than the vehicle's makes the mass matrix indefinite."""
    with RawFmu(native_fmus / "AuvPlant.fmu") as raw:
        assert attempt(raw.initialise, {"hydro.X_udot": 1.0}) == ERROR
        assert "mass plus added mass must be positive" in raw.messages
    with RawFmu(native_fmus / "AuvPlant.fmu") as raw:
        assert attempt(raw.initialise, {"length": 1e200}) == ERROR


def test_messages_of_conditions_are_escaped_in_c(tmp_path: Path) -> None:
    """Quotes, percent signs, comment ends and umlauts are kept."""
    path = build_fmu(two_delays.SPEC, tmp_path, prebuilt=False)
    with RawFmu(path) as raw:
        assert attempt(raw.initialise, {"gain": 0.2}) == ERROR
        assert 'a "gain" of %% must exceed 1/4 */ ä' in raw.messages


def test_calls_out_of_order_are_refused(native_fmus: Path) -> None:
    """The life cycle is FMI's; after termination values stay readable and steps are refused."""
    with RawFmu(native_fmus / "DelayedPlant.fmu") as raw:
        assert attempt(raw.step, 0.0, 0.1) == ERROR
        assert "doStep is not allowed while instantiated" in raw.messages
    with RawFmu(native_fmus / "DelayedPlant.fmu") as raw:
        assert attempt(raw.fmu.terminate) == ERROR
        assert "terminate is not allowed while instantiated" in raw.messages
    with fresh(native_fmus) as raw:
        raw.step(0.0, 0.1)
        raw.fmu.terminate()
        assert raw.get("x[1]") == pytest.approx([5.275960814032278], rel=1e-9)
        assert attempt(raw.put, {"u[1]": 1.0}) == ERROR
        assert attempt(raw.step, 0.1, 0.1) == ERROR
        assert "writing a variable is not allowed while terminated" in raw.messages
        assert attempt(raw.fmu.terminate) == ERROR


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"A[1,1]": 5000.0}, "the state is no longer finite after t ="),
        ({"delay.d": 1e-12}, "use a shorter communication step"),
        ({"delay.d": 1e-312}, "use a shorter communication step"),
        ({"solver.step": 1e-6, "delay.d": 0.5}, "sub-steps in one communication step"),
        ({"D[1,1]": 1e308}, "z[1] is not finite"),
    ],
)
def test_step_that_cannot_be_computed_is_discarded_and_undone(
    native_fmus: Path, parameters: dict[str, float], message: str
) -> None:
    """Discard, not garbage: the state is that before the step, and the run can go on."""
    with RawFmu(native_fmus / "DelayedPlant.fmu") as raw:
        own = {"initial.x[1]": 0.5, "initial.x[2]": 0.5, **parameters}
        raw.initialise(own)
        saved = raw.saved()
        raw.put({"u[1]": 50.0})
        changed = raw.saved()
        assert attempt(raw.step, 0.0, 1.0) == DISCARD
        assert message in raw.messages
        assert raw.logged[-1][0] == DISCARD
        assert raw.saved() == changed
        value = ctypes.c_double()
        kind = fmi2.fmi2LastSuccessfulTime
        assert raw.fmu.fmi2GetRealStatus(raw.fmu.component, kind, ctypes.byref(value)) == 0
        assert value.value == 0.0
        raw.resume(saved)
        assert raw.saved() == saved


def test_discarded_step_may_be_tried_again_shorter(native_fmus: Path) -> None:
    """As if the long step had never been asked for, whatever it left half-done."""
    own = {"solver.step": 1e-5, "delay.d": 0.31}
    with fresh(native_fmus, **own) as raw, fresh(native_fmus, **own) as other:
        raw.put({"u[1]": 1.0})
        other.put({"u[1]": 1.0})
        for k in range(8):
            if k % 3 == 1:
                assert attempt(raw.step, k * 0.1, 3.0) == DISCARD
            for each in (raw, other):
                each.put({"u[1]": float(k % 2)})
                each.step(k * 0.1, 0.1)
            assert raw.saved() == other.saved()


def test_forged_state_is_refused(native_fmus: Path) -> None:
    """Even with a right checksum, numbers that no instance could hold do not get in."""
    with fresh(native_fmus) as raw:
        raw.step(0.0, 0.5)
        data = raw.saved()
        count = (len(data) - HEADER) // 8
        for place in range(count):
            for wrong in (math.nan, -7.5, 1e300):
                forged = bytearray(data)
                struct.pack_into("<d", forged, HEADER + 8 * place, wrong)
                struct.pack_into("<Q", forged, 24, fnv1a(bytes(forged[HEADER:])))
                if attempt(raw.resume, bytes(forged)) is None:
                    # a number that an instance may hold: it goes on or says why not
                    attempt(raw.step, 0.5, 0.5)
        raw.resume(data)
        assert raw.saved() == data
        assert "does not fit this component" in raw.messages


HEADER = 72


def fnv1a(data: bytes) -> int:
    """Give the checksum of saved states."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return value


def test_state_of_another_component_is_refused(native_fmus: Path) -> None:
    """It carries the GUID of its own."""
    with fresh(native_fmus) as raw, fresh(native_fmus, "WaveField") as other:
        assert attempt(raw.resume, other.saved()) == ERROR
        assert "its GUID differs" in raw.messages


@pytest.mark.parametrize("wrong", ["guid", "type", "name"])
def test_instance_of_something_else_is_refused(native_fmus: Path, wrong: str) -> None:
    """A GUID that is not the binary's, model exchange, no name: no instance, and the reason."""
    with fresh(native_fmus) as raw:
        made = raw.fmu.fmi2Instantiate(
            b"" if wrong == "name" else b"it",
            0 if wrong == "type" else 1,
            b"{other}" if wrong == "guid" else raw.model.guid.encode(),
            b"",
            ctypes.byref(raw._callbacks),
            0,
            0,
        )
        assert not made
        reason = {"guid": "belong to different builds", "type": "co-simulation", "name": "a name"}
        assert reason[wrong] in raw.messages


def test_log_categories_choose_what_is_logged(native_fmus: Path) -> None:
    """All, one, none; switched by name."""
    with fresh(native_fmus) as raw:
        for on, categories, heard in (
            (True, [], True),
            (True, ["logStatusDiscard"], True),
            (True, ["logStatusError"], False),
            (True, ["logStatusError", "logAll"], True),
            (False, [], False),
        ):
            raw.fmu.setDebugLogging(on, categories)
            raw.logged.clear()
            assert attempt(raw.fmu.fmi2GetStatus, raw.fmu.component, 0, None) == DISCARD
            assert bool(raw.logged) is heard, (on, categories)


def test_negative_zero_and_denormal_are_numbers(native_fmus: Path) -> None:
    """What is finite is taken, to the bit."""
    with fresh(native_fmus) as raw:
        raw.put({"u[1]": -0.0, "w[1]": 5e-324})
        assert json.dumps(raw.get("u[1]", "w[1]")) == "[-0.0, 5e-324]"
        raw.step(0.0, 0.1)
        assert raw.messages == ""
