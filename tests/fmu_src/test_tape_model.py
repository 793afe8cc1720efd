"""A binary that reads its model computes what the C made of the same component computes."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import two_delays
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from raw_fmu import RawFmu
from shared import sampled
from wheel import prebuilt_fmu, tape_fmu

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, ComponentSpec, component_module, deterministic_zip
from cosim.models import Delay, DelaySystem
from cosim.network import Jitter, LossChain, PacketLink, TransportLink
from cosim.scenario import formula

LINK = component_module("link_channel.variables")
PLANT = component_module("delayed_plant.variables").delayed_plant_spec


def spec_of(name: str) -> ComponentSpec:  # noqa: PLR0911 - one per kind
    """A component of each kind, none of them the one that the binary was compiled with."""
    signals = [LINK.LinkSignal(initial=0.5), LINK.LinkSignal()]
    if name == "packet":
        moves = ((0.9, 0.08, 0.02), (0.3, 0.6, 0.1), (0.0, 0.2, 0.8))
        loss = LossChain(moves, (0.05, 0.6, 1.0))
        jitter = Jitter("exponential", mean_ns=40_000_000)
        link = PacketLink(
            "of its own", 70_000_000, 0, 120_000_000, jitter=jitter, loss=loss, seed=5
        )
        return LINK.packet_spec("Packet", link, signals)
    if name == "transport":
        return LINK.transport_spec("Transport", TransportLink("t", 130_000_000), signals)
    if name == "table":
        table = component_module("signal_table.variables").table_spec
        outputs = [("a", "m"), ("b", None)]
        return table("Table", outputs, [0, 300_000_000, 10**9], [[0.0, 1], [2, 0.3], [-1, 7]], 0.1)
    if name == "sensor":
        sensor_spec = component_module("sensor.variables").sensor_spec
        return sensor_spec("Log", [("a", "m"), ("b", None)], noise=(0.5, 0.0), sample_time=0.15)
    if name == "sensor at once":
        sensor_spec = component_module("sensor.variables").sensor_at_once_spec
        settings = {"noise": 0.5, "resolution": 0.125, "greatest": 1.0}
        return sensor_spec("gps", [("a", "m"), ("b.x", None)], settings, sample_time=0.15)
    if name == "computed":
        return computed_spec()
    if name == "TwoDelays":
        return two_delays.SPEC
    return CATALOGUE[name]


def computed_spec() -> ComponentSpec:
    """What a formula of u and w records, as a component."""
    operations = formula(_EXPRESSION, "u", "w").tape.operations
    nodes: list[list[Any]] = [
        [one.name, one.text]
        if one.name == "symbol"
        else [one.name, float(one.text)]
        if one.name == "constant"
        else [one.name, *one.operands]
        for one in operations
    ]
    spec: ComponentSpec = component_module("computed.variables").computed_spec(
        "c",
        [(name, None, f"signal {name}") for name in ("u", "w")],
        [("y", None, _EXPRESSION)],
        nodes,
        [len(nodes) - 1],
        [["u", "w"]],
        0.1,
    )
    return spec


_EXPRESSION = (
    "min(u, w) * hypot(u, 2) + floor(3 * u) - round(u) + atan2(u, w) / 1 rad + tan(u) * exp(w)"
    " + (asin(sin(u)) + acos(cos(w)) + atan(u)) / 1 rad + u ** 3 / (1 + w ** 2) + abs(w) ** 0.5"
    " + log(2 + u)"
)


MODEL = "resources/model.bin"
KINDS = {
    "AuvPlant": "plant",
    "DelayedPlant": "plant",
    "TwoDelays": "plant",
    "HinfController": "sampled",
    "PaperController": "sampled",
    "packet": "packet_link",
    "transport": "transport_link",
    "sensor at once": "sensor",
}
"""Component -> the kind of its binary, where it has another name."""
FLAVOURS = {"2.0": "native", "3.0": "native-fmi3"}


MEMBERS = sampled(
    [
        *(("HinfController", "2.0"), ("TwoDelays", "2.0"), ("packet", "3.0"), ("transport", "2.0")),
        *(("table", "2.0"), ("AuvPlant", "2.0"), ("DelayedPlant", "3.0"), ("packet", "2.0")),
        *(("PaperController", "3.0"), ("transport", "3.0"), ("table", "3.0"), ("TwoDelays", "3.0")),
        ("sensor", "2.0"),
        ("sensor at once", "2.0"),
        ("computed", "3.0"),
    ],
    2,
)


@pytest.mark.parametrize(("name", "version"), MEMBERS)
def test_the_bits_are_those_of_compiled_equations(name: str, version: str, tmp_path: Path) -> None:
    """Every output at every point, with inputs that move; and the archive is a valid FMU."""
    spec = spec_of(name)
    runs = []
    for path in (
        tape_fmu(spec, KINDS.get(name, name), tmp_path / "tape", version),
        build_fmu(spec, tmp_path / "compiled", FLAVOURS[version], prebuilt=False),
    ):
        assert validate_fmu(str(path)) == []
        runs.append(simulate_fmu(str(path), stop_time=8.0, input=moving(spec), output_interval=0.1))
    assert runs[0].dtype == runs[1].dtype
    assert runs[0].tobytes() == runs[1].tobytes()
    assert all(np.ptp(runs[0][n]) > 0 for n in outputs_that_move(spec, runs[0]))


def moving(spec: ComponentSpec) -> Any:
    inputs = [v.name for v in spec.variables if v.causality == "input"]
    if not inputs:
        return None
    signals = np.zeros(81, dtype=[("time", "f8"), *((name, "f8") for name in inputs)])
    signals["time"] = np.arange(81) / 10
    for i, name in enumerate(inputs, 1):
        signals[name] = np.sin(i * signals["time"]) + 0.1 * i
    return signals


def outputs_that_move(spec: ComponentSpec, run: Any) -> list[str]:
    outputs = [v.name for v in spec.variables if v.causality == "output"]
    found = [name for name in outputs if name in run.dtype.names]
    assert found
    return [name for name in found if name not in {"age", "dropped"}][:1]


def test_states_derivatives_and_refusals_are_the_same(tmp_path: Path) -> None:
    """A saved history is resumed bit for bit; a message names variable and bound."""
    spec = spec_of("TwoDelays")
    tape = tape_fmu(spec, "plant", tmp_path / "tape")
    compiled = build_fmu(spec, tmp_path / "compiled", prebuilt=False)
    seen = []
    for path in (tape, compiled):
        with RawFmu(path) as raw, RawFmu(path, "again", raw) as other:
            raw.initialise({"delay.first": 0.25})
            for k in range(20):
                raw.put({"push[1]": 0.1 * k})
                raw.step(k * 0.05, 0.05)
            kept = raw.saved()
            other.resume(kept)
            for one in (raw, other):
                one.step(1.0, 0.05)
            known, unknown = [raw.reference["push[1]"]], [raw.reference["power"]]
            slope = raw.fmu.getDirectionalDerivative(unknown, known, [1.0])
            assert raw.get(*raw.outputs()) == other.get(*raw.outputs())
            with pytest.raises(FMICallException):
                raw.put({"delay.first": 0.1})
            with RawFmu(path, "refused", raw) as third, pytest.raises(FMICallException):
                third.initialise({"gain": 0.1})
            seen.append(
                (raw.get(*raw.outputs()), list(slope), raw.messages, third.messages, len(kept))
            )
    assert seen[0] == seen[1]
    assert "delay.first" in seen[0][2]
    assert 'a "gain" of %' in seen[0][3]


def test_a_model_that_is_damaged_is_refused(tmp_path: Path) -> None:
    """Cut, empty, missing, of another build, or with any word changed: words, and no crash."""
    spec = spec_of("TwoDelays")
    with zipfile.ZipFile(tape_fmu(spec, "plant", tmp_path)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    good = files.pop(MODEL)
    words = np.frombuffer(good, "<i8")
    rng = np.random.default_rng(7)
    hurt = [b"", good[:-8], good + bytes(8), good[:37], None]
    for place in [0, 1, 2, *rng.integers(3, words.size, 25)]:
        other = words.copy()
        other[place] = rng.choice([-1, 2**40, 2**62, -(2**63), 4097])
        hurt.append(other.tobytes())
    refused = 0
    for content in hurt:
        deterministic_zip(
            {**files, **({} if content is None else {MODEL: content})}, tmp_path / "x.fmu"
        )
        try:
            with RawFmu(tmp_path / "x.fmu") as raw:
                raw.initialise()
                raw.step(0.0, 0.05)
        except Exception:  # noqa: BLE001 - fmpy has no class of its own for these
            refused += 1
    assert refused >= 8


def test_what_is_too_large_says_so(tmp_path: Path) -> None:
    """Sizes of the binary are fixed: more delays than it has room for need a compiler."""
    system = DelaySystem(A=[[-1.0]], delays=[Delay(A=[[0.1]], d=0.1 * k) for k in range(1, 10)])
    done = prebuilt_fmu(PLANT(system, name="Large"), "plant", tmp_path)
    assert done.returncode == 2
    assert re.search(r"Large[\s\S]*at most[\s\S]*`platforms` host", done.stderr.decode())
    assert not [*tmp_path.glob("*.fmu")]
