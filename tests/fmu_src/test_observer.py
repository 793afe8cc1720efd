"""Observer and output feedback: every flavour the same bits, packets, watchdog, assumptions."""

from __future__ import annotations

import json
import math
import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pairs
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from hypothesis import given, settings, strategies as st
from raw_fmu import RawFmu
from shared import made_once
from wheel import tape_fmu

from cosim.core import InputError
from cosim.fmu import build_fmu
from cosim.fmu.inspect import inspect_fmu

SPEC = pairs.spec_of()


@pytest.fixture(scope="module")
def native() -> Path:
    return made_once("pair", lambda folder: build_fmu(SPEC, folder, prebuilt=False)) / "Pair.fmu"


def flight(seed: int, count: int = 60, step: float = 0.05) -> tuple[list[float], list[Any]]:
    """Points and inputs: late, lost, overtaken and repeated packets, and a set point that moves."""
    seeded = random.Random(seed)  # noqa: S311 - no secret
    points, inputs = [k * step for k in range(count + 1)], []
    for t in points[:-1]:
        values = {"reference[1]": 0.3 * (t > 1.0)}
        if seeded.random() < 0.25:
            values |= {"stamp.fix": t - seeded.uniform(0, 1.7), "fix[1]": seeded.gauss(0, 1)}
        if seeded.random() < 0.5:
            values |= {"stamp.dvl": t - seeded.uniform(0, 0.2), "dvl[1]": seeded.gauss(0, 0.3)}
        inputs.append(values)
    return points, inputs


STEPS = st.lists(st.sampled_from([0.05, 0.1, 0.013, 0.37, 1 / 3]), min_size=4, max_size=40)
PACKET = st.tuples(
    st.sampled_from(["fix", "dvl"]), st.floats(0.0, 2.0), st.floats(-3.0, 3.0), st.booleans()
)


@pytest.mark.slow
@settings(max_examples=25)
@given(sizes=STEPS, packets=st.lists(st.none() | PACKET, min_size=40, max_size=40))
def test_c_and_python_agree_to_the_last_bit(native: Path, sizes: Any, packets: Any) -> None:
    """Whatever arrives in whatever order, or nothing; and again from a state saved half-way."""
    points, inputs, stamp = [0.0], [], {"fix": -1.0, "dvl": -1.0}
    for h, packet in zip(sizes, packets, strict=False):
        values = {}
        if packet is not None:
            name, age, y, again = packet
            stamp[name] = stamp[name] if again else max(points[-1] - age, -1.0)
            values = {f"stamp.{name}": stamp[name], f"{name}[1]": y}
        inputs.append(values)
        points.append(points[-1] + h)
    half = len(sizes) // 2
    own, expected = pairs.Equations(SPEC), []
    with RawFmu(native) as raw, RawFmu(native, "other", raw) as other:
        raw.initialise()
        other.initialise()
        assert pairs.row_of(raw, SPEC) == own.row()
        for k, values in enumerate(inputs):
            if k == half:
                data = raw.saved()
                kept = json.loads(json.dumps(own.behaviour.snapshot())), dict(own.v)
            own.step(points[k + 1], values)
            expected.append(own.row())
            assert pairs.drive(raw, SPEC, points[k : k + 2], [values]) == expected[-1:]
        assert raw.messages == "\n".join(own.notices)
        other.resume(data)
        assert pairs.drive(other, SPEC, points[half:], inputs[half:]) == expected[half:]
    own.v = dict(kept[1])
    own.behaviour.initialise(own.v, 0.0)
    own.behaviour.restore(kept[0])
    own.v = dict(kept[1])
    for k, values in enumerate(inputs[half:], half):
        own.step(points[k + 1], values)
        assert own.row() == expected[k]


@pytest.mark.parametrize(
    "flavour", ["tape", "python", pytest.param("native-fmi3", marks=pytest.mark.slow)]
)
def test_every_flavour_is_valid_and_the_same(flavour: str, native: Path, tmp_path: Path) -> None:
    """Compiled or read by a prebuilt binary, FMI 2 or 3, in C or in Python: FMPy runs them all."""
    if flavour == "tape":
        path = tape_fmu(SPEC, "observer", tmp_path)
    else:
        path = build_fmu(SPEC, tmp_path, flavour, prebuilt=False)
    assert validate_fmu(str(path)) == []
    assert inspect_fmu(path).valid
    points, inputs = flight(3)
    names = ["time", *sorted({name for values in inputs for name in values})]
    signals = np.zeros(len(inputs), [(name, float) for name in names])
    latest = {"stamp.fix": -1.0, "stamp.dvl": -1.0}
    for k, values in enumerate(inputs):
        latest |= values
        signals[k] = (points[k], *(latest.get(name, 0.0) for name in names[1:]))
    runs = [
        simulate_fmu(str(one), stop_time=3.0, input=signals, output_interval=0.05)
        for one in (native, path)
    ]
    assert runs[0].tobytes() == runs[1].tobytes()
    assert np.ptp(runs[0]["estimate[1]"]) > 0.1


def test_an_observer_alone_is_given_what_acts(tmp_path: Path) -> None:
    """Given what the other one takes to act, it has the same estimate, in C and in Python."""
    spec = pairs.VARIABLES.observer_spec("Alone", pairs.content(), envelope={1: 0.5})
    whole = pairs.spec_of(allocation=(), outputs=(), trim=(), safe=(), limits=(0.1,))
    path = tape_fmu(spec, "observer", tmp_path)
    both, alone = pairs.Equations(whole), pairs.Equations(spec)
    points, inputs = flight(5)
    with RawFmu(path) as raw:
        raw.initialise()
        for k, values in enumerate(inputs):
            own = {n: x for n, x in values.items() if not n.startswith("reference")}
            # play-out of 0.13 s between points 0.05 s apart: given here only when it is over
            own["u[1]"] = both.v["applied[1]"]
            both.v["command.delay"] = 0.1
            both.step(points[k + 1], values)
            alone.step(points[k + 1], own)
            assert pairs.drive(raw, spec, points[k : k + 2], [own]) == [alone.row()]
            assert alone.v["estimate[1]"] == pytest.approx(both.v["estimate[1]"], abs=1e-12)
    assert alone.v["assumption.envelope"] > 0.1
    assert "watchdog" not in alone.v


def test_a_watchdog_commands_safe_values_and_returns() -> None:
    """At once when a measurement is too old, with one message; until a fresh one has come."""
    own = pairs.Equations(pairs.spec_of(sample_time=1.0), {"age.command": 0.0})
    seen = []
    for k in range(80):
        t = k * 0.05
        values = {"stamp.dvl": t}
        if t < 0.5 or t >= 3.0:
            values |= {"stamp.fix": t, "fix[1]": 1.0}
        values["reference[1]"] = 50.0 if 1.9 < t < 2.99 else 0.0  # nobody follows it
        own.step(t + 0.05, values)
        v = own.v
        seen.append((v["watchdog"], v["thruster.a"], v["thruster.b"], v["message_age.fix"]))
    late = [k for k, row in enumerate(seen) if row[0]]
    # 1.5 s after the last fix, taken at 0.45 s; that of 3.0 s is in use from 3.0 s on
    assert late == [*range(39, 60)]
    assert all(seen[k][1:3] == (0.05, -0.02) for k in late)
    assert seen[60][1:3] != (0.05, -0.02)
    assert len(own.notices) == 2
    assert "fix is 1.55" in own.notices[0]
    assert "age.fix is 1.5 s: safe values" in own.notices[0]
    assert own.v["assumption.age"] == pytest.approx(2.55 / 1.5)
    assert own.v["assumption.met"] == 0
    assert own.v["present.age"] < 1
    assert 0 < own.v["assumption.saturation"] < 10


def test_packets_are_taken_by_their_stamps() -> None:
    """Overtaken ones, too old ones and none at all; a repeated one changes nothing."""
    own = pairs.Equations(pairs.spec_of())
    own.step(1.0, {})
    assert own.v["message_age.fix"] == 1.0  # as old as the run
    own.step(1.1, {"stamp.fix": 0.8, "fix[1]": 0.7})
    first = own.v["innovation.fix[1]"]
    assert first == 0.7  # the estimate was zero
    assert own.v["message_age.fix"] == pytest.approx(0.3)
    own.step(1.2, {"fix[1]": 9.0})  # the same packet: what its input shows beside does not count
    own.step(1.3, {"stamp.fix": 0.7, "fix[1]": 5.0})
    own.step(1.4, {})
    assert own.v["ignored.fix"] == 1
    own.step(3.0, {"stamp.fix": 0.75, "fix[1]": 5.0})
    assert own.v["ignored.fix"] == 2
    own.step(3.1, {"stamp.fix": 1.4, "fix[1]": 5.0})  # newer, but 1.6 s old
    assert own.v["ignored.fix"] == 3
    assert own.v["innovation.fix[1]"] == first
    own.step(3.2, {"stamp.fix": 1.6, "fix[1]": 5.0})  # just as old as is allowed
    assert own.v["ignored.fix"] == 3
    assert own.v["innovation.fix[1]"] != first


def test_what_the_limits_take_off_does_not_act() -> None:
    """The observer knows it: allocation times the limited commands, without the trim."""
    own = pairs.Equations(pairs.spec_of(sample_time=0.0, command_delay=0.0))
    own.step(0.1, {"reference[1]": 50.0, "stamp.fix": 0.0, "stamp.dvl": 0.0})
    v = own.v
    assert (v["thruster.a"], v["thruster.b"]) == (0.2, 0.15)
    assert v["applied[1]"] == pytest.approx((0.2 - 0.01) + 0.7 * (0.15 - 0.02))
    assert v["present.saturation"] > 10
    assert v["assumption.met"] == 0
    own.step(0.2, {"reference[1]": 0.1})
    thrust = np.linalg.pinv([[1.0, 0.7]])[:, 0] * v["applied[1]"] + [0.01, 0.02]
    np.testing.assert_allclose([v["thruster.a"], v["thruster.b"]], thrust, rtol=1e-12)
    assert v["present.saturation"] < 1 < v["assumption.saturation"]


def test_commands_start_at_the_trim_within_the_limits(native: Path) -> None:
    """What holds the trim acts from the start; limits are of the whole command."""
    own = pairs.Equations(SPEC)
    assert (own.v["thruster.a"], own.v["thruster.b"], own.v["applied[1]"]) == (0.01, 0.02, 0.0)
    starts = {v.name: v.start for v in SPEC.variables}
    assert (starts["thruster.a"], starts["thruster.b"]) == (0.01, 0.02)
    less = {"limit.thruster.b": 0.015}
    own = pairs.Equations(SPEC, less)
    assert (own.v["thruster.a"], own.v["thruster.b"]) == (0.01, 0.015)
    assert own.v["applied[1]"] == pytest.approx(0.7 * (0.015 - 0.02))
    with RawFmu(native) as raw:
        raw.put(less)
        raw.initialise()
        assert pairs.row_of(raw, SPEC) == own.row()
    with pytest.raises(InputError, match=r"thruster.b: at most 0.015"):
        pairs.spec_of(limits=(0.2, 0.015), trim=(0.01, 0.02))


def test_play_out_and_sampling_are_watched() -> None:
    """The age of the estimate behind a command: sampling, play-out, and what the design allows."""
    for sample_time, met in ((0.2, 1), (0.4, 0)):
        spec = pairs.spec_of(sample_time=sample_time)
        own = pairs.Equations(spec)
        for k in range(40):
            own.step((k + 1) * 0.05, {"stamp.fix": k * 0.05, "stamp.dvl": k * 0.05})
        # 0.13 s until it acts, and until the next one does: 0.33 s are allowed
        assert own.v["assumption.age"] == pytest.approx(1.0 if met else 0.53 / 0.33)
        assert own.v["assumption.met"] == met


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"stamp.fix": 2.0, "fix[1]": 1.0}, "stamp.fix is 2.0 s, in the future of t = 1.32 s"),
        ({"stamp.dvl": 1.32, "dvl[1]": 1e308, "dvl[2]": 1e308}, "is no longer finite|overflows"),
        ({"reference[1]": 1.7e308, "reference[2]": 1.7e308}, "overflows"),
    ],
)
def test_a_step_that_is_refused_changes_nothing(
    native: Path, inputs: dict[str, float], message: str
) -> None:
    """It says why, and the run goes on with better inputs as if it had not been tried."""
    points = [round(0.11 * k, 9) for k in range(13)]  # at 1.32 s a command is on its way
    good = [
        {"stamp.fix": t, "fix[1]": 0.1 * t, "stamp.dvl": t, "dvl[1]": 0.1, "dvl[2]": 0.0}
        for t in points
    ]
    if "reference[1]" in inputs:  # nothing jumps at 1.32 s: the step before is gone on with
        good[-1] = {"reference[1]": 0.0, "reference[2]": 0.0}
    own = pairs.Equations(SPEC)
    for k, values in enumerate(good[:-1]):
        own.step(points[k + 1], values)
    with pytest.raises((ValueError, ArithmeticError), match=message):
        own.step(1.47, inputs)
    rows = []
    for try_it in (True, False):
        with RawFmu(native) as raw:
            raw.initialise()
            pairs.drive(raw, SPEC, points, good)
            before = pairs.row_of(raw, SPEC)
            if try_it:
                raw.put(inputs)
                with pytest.raises(FMICallException):
                    raw.step(1.32, 0.15)
                assert pairs.row_of(raw, SPEC) == before
                assert raw.messages
            rows.append(pairs.drive(raw, SPEC, [1.32, 1.47, 1.5, 1.9, 2.3], [good[-1]] * 4))
    assert rows[0] == rows[1]


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_no_number_is_refused(native: Path, value: float) -> None:
    """By name, when it is written."""
    with RawFmu(native) as raw:
        raw.initialise()
        with pytest.raises(FMICallException):
            raw.put({"stamp.fix": value})
        assert "stamp.fix must be finite" in raw.messages


def test_a_state_that_was_changed_never_crashes(native: Path) -> None:
    """Any number of it replaced, with the right checksum: refused, or flown on."""
    points, inputs = flight(7, 30)
    seeded = random.Random(1)  # noqa: S311 - no secret
    refused = 0
    with RawFmu(native) as raw, RawFmu(native, "other", raw) as other:
        raw.initialise()
        other.initialise()
        pairs.drive(raw, SPEC, points, inputs)
        good = raw.saved()
        head = len(good) - 8 * struct.unpack_from("<Q", good, 16)[0]
        variables = head + 8 * (4 + len(SPEC.variables))
        for place in range(variables, min(variables + 8 * 60, len(good)), 8):
            hurt = bytearray(good)
            value = seeded.choice([-1.0, 1e300, math.nan, 1e15, 0.5, -1e300, 7.0])
            struct.pack_into("<d", hurt, place, value)
            struct.pack_into("<Q", hurt, 24, _checksum(bytes(hurt[head:])))
            try:
                other.resume(bytes(hurt))
                other.step(points[-1], 0.05)
                pairs.row_of(other, SPEC)
            except FMICallException:
                refused += 1
                other.fmu.reset()
                other.initialise()
    assert refused > 10


def _checksum(content: bytes) -> int:
    found = 0xCBF29CE484222325
    for byte in content:
        found = (found ^ byte) * 0x100000001B3 % 2**64
    return found


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"allocation": ((1.0, 0.7), (0.0, 1.0))}, "allocation does not fit"),
        ({"allocation": ((0.0, 0.0),)}, "do not give the control"),
        ({"allocation": ()}, "need an allocation"),
        ({"limits": (1.0,)}, "limits do not fit"),
        ({"ages": {"fix": 1.6}}, "greatest ages"),
        ({"ages": {"sonar": 1.0}}, "greatest ages"),
        ({"envelope": {4: 1.0}}, "envelope does not fit"),
        ({"initial": (1.0,)}, "initial estimate do not fit"),
        ({"trim_measured": {"dvl": (1.0,)}}, "values of dvl at the trim do not fit"),
    ],
)
def test_what_does_not_fit_is_refused(settings_: dict[str, Any], message: str) -> None:
    """With the name of what it is."""
    with pytest.raises(InputError, match=message):
        pairs.spec_of(**settings_)


def test_measured_values_at_the_trim_are_taken_off() -> None:
    """The system describes deviations: a measurement at the trim has no innovation."""
    spec = pairs.spec_of(trim_measured={"fix": (3.0,)})
    own = pairs.Equations(spec)
    own.step(0.1, {"stamp.fix": 0.0, "fix[1]": 3.0, "stamp.dvl": 0.0, "dvl[1]": 0.5})
    assert own.v["innovation.fix[1]"] == 0.0
    assert own.v["innovation.dvl[1]"] == 0.5
