"""Injection: recorded outputs reproduced, signals over new links, any FMU."""

from __future__ import annotations

import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli.shell import Result, cosim, trace_of
from master.mixed import mixed_fmu
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from shared import copied, fmu_store, sampled

from cosim.trace import Rows, Signal, Table, Trace, TraceWriter, content_hash

S = 10**9


def injected(source: Path, *arguments: str | Path, cwd: Path) -> Result:
    """`cosim trace inject SOURCE ... --json` with the FMUs of the shared flights."""
    words = ("trace", "inject", source, *arguments, "--fmus", fmu_store(), "--json")
    return cosim(*words, cwd=cwd)


def same_bits(a: Table, b: Table) -> bool:
    """Same instants, same columns, bit for bit."""
    return (
        a.log_time_ns.tolist() == b.log_time_ns.tolist()
        and list(a.columns) == list(b.columns)
        and all(a[name].tobytes() == b[name].tobytes() for name in a.columns)
    )


@pytest.mark.parametrize(
    ("scenario", "fmu", "component"),
    [
        ("auv-acoustic", "HinfController", "controller"),
        ("auv-acoustic", "AuvPlant", "plant"),
        ("paper-example", "PaperController", "controller"),
        ("paper-example", "DelayedPlant", "plant"),
    ],
)
def test_delivered_inputs_give_the_recorded_outputs(
    tmp_path: Path, scenario: str, fmu: str, component: str
) -> None:
    """Each component of a run, at its irregular instants, fed what it received."""
    source = trace_of(scenario)
    result = injected(source, "--into", fmu, "--compare", component, "-o", "n.mcap", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["identical"] is True
    assert result.json["not_mapped"] == result.json["not_used"] == []
    for topic in (f"/{component}/output", f"/{component}/input"):
        then, now = Trace(source).read(topic), Trace(tmp_path / "n.mcap").read(topic)
        assert len(then) > 100
        assert set(then.columns) == set(now.columns)
        for name in then.columns:
            assert then[name].tobytes() == now[name].tobytes()


@pytest.mark.skipif(sys.platform != "linux", reason="Python and the FMU must call one C library")
@pytest.mark.parametrize("flavour", sampled(["native_fmus_of_fmi3", "fmus"], 1))
def test_another_flavour_gives_the_recorded_outputs(
    flavour: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Another FMU of the same component, with the parameters and gain of the recorded one."""
    fmu = request.getfixturevalue(flavour) / "HinfController.fmu"
    arguments = ("--into", fmu, "--compare", "controller")
    source = trace_of("auv-acoustic")
    own = injected(source, *arguments, "-o", "own.mcap", cwd=tmp_path)
    assert own.code in {0, 1}
    assert own.json["parameters"] == {}
    result = injected(
        source, *arguments, "--as-component", "controller", "-o", "n.mcap", cwd=tmp_path
    )
    assert result.code == 0, result.err
    assert result.json["identical"] is True
    assert len(result.json["parameters"]) == 38


def test_the_recorded_link_again_delivers_the_same(tmp_path: Path) -> None:
    """What was sent, over the recorded link's own delays and losses: nothing differs."""
    source = trace_of("auv-acoustic")
    arguments = ("--into", "HinfController", "--as", "sent", "--link", "uplink")
    result = injected(source, *arguments, "--compare", "controller", "-o", "n.mcap", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["identical"] is True
    assert result.json["mapped"]["eta.x"] == "/plant/output:eta.x"
    assert result.json["mapped"]["reference.x"] == "/controller/input:reference.x"
    then = Trace(source).read("/controller/input")
    now = Trace(tmp_path / "n.mcap").read("/controller/input")
    assert all(then[name].tobytes() == now[name].tobytes() for name in then.columns)


def test_sent_inputs_without_the_link_give_other_outputs(tmp_path: Path) -> None:
    """Sent and received at once: the first answer that differs is named, exit code 1."""
    arguments = ("--into", "HinfController", "--as", "sent", "--compare", "controller")
    result = injected(trace_of("auv-acoustic"), *arguments, "-o", "n.mcap", cwd=tmp_path)
    assert result.code == 1
    first = result.json["compare"]["first"]
    assert first["signal"].startswith("controller.")
    sent = Trace(trace_of("auv-acoustic")).read("/plant/output")
    now = Trace(tmp_path / "n.mcap").read("/controller/input")
    assert now["eta.x"].tobytes() == sent["eta.x"].tobytes()
    allowed = ("--abs", "1e9")
    again = injected(trace_of("auv-acoustic"), *arguments, *allowed, "-o", "m.mcap", cwd=tmp_path)
    assert again.code == 0


def made(path: Path, times_s: list[float], shift_ns: int = 0) -> Path:
    """A trace of another program: a real, an integer and a truth value."""
    with TraceWriter(path, run={}) as writer:
        topic = writer.add_topic(
            "/pilot/output",
            [
                Signal("u"),
                Signal("j", kind="int"),
                Signal("c", kind="bool"),
                Signal("v.x"),
                Signal("v.y"),
            ],
            schema_name="t.P",
        )
        for k, t in enumerate(times_s):
            row = [0.5 * k, 10 * k, k % 2 == 0, float(k), -float(k)]
            writer.write(topic, round(t * S) + shift_ns, row)
        writer.finish({})
    return path


def test_a_foreign_fmu_with_every_kind_of_variable(tmp_path: Path) -> None:
    """y = 2 u at once, n = steps + j, f = not c: against the closed form, irregular instants."""
    source = made(tmp_path / "s.mcap", [0.0, 0.1, 0.35, 0.4, 1.0])
    arguments = ("--map", "pilot.u=u", "--map", "pilot.j=j", "--map", "pilot.c=c")
    result = injected(
        source, "--into", mixed_fmu(tmp_path), *arguments, "-o", "n.mcap", cwd=tmp_path
    )
    assert result.code == 0, result.err
    trace = Trace(tmp_path / "n.mcap")
    out = trace.read("/mixed/output")
    assert out.delivered.tolist() == [0.0, 0.1, 0.35, 0.4, 1.0]
    assert out["y"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert out["n"].tolist() == [0, 1, 12, 23, 34]  # sent before what is received at the instant
    assert out["f"].tolist() == [False, False, True, False, True]
    assert trace.run["injected.content_hash"] == content_hash(source)
    assert trace.run["injected.map.u"] == "/pilot/output:u"
    assert trace.run["fmu.mixed.sha256"] == result.json["fmu_sha256"]
    assert trace.finished
    with (tmp_path / "n.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        rows = [m.y for _, _, _, m in reader.iter_decoded_messages(topics=["/mixed/output"])]
    assert rows == out["y"].tolist()


def test_names_that_agree_are_mapped_and_the_rest_is_reported(tmp_path: Path) -> None:
    """The recorded component with the same inputs is found; what is left over is listed."""
    with TraceWriter(tmp_path / "s.mcap", run={}) as writer:
        for name, signals in (("a", ["u", "more"]), ("b", ["other"])):
            topic = writer.add_topic(
                f"/{name}/input", [Signal(s) for s in signals], schema_name=f"t.{name}"
            )
            times = np.arange(3) * S
            writer.write_rows([Rows(topic, times, np.ones((3, len(signals))))])
        writer.finish({})
    fmu = mixed_fmu(tmp_path)
    result = injected(tmp_path / "s.mcap", "--into", fmu, "-o", "n.mcap", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["as_component"] == "a"
    assert result.json["mapped"] == {"u": "/a/input:u"}
    assert result.json["not_mapped"] == ["j", "c"]
    assert result.json["not_used"] == ["more"]


def fixed_step(fmu: Path) -> Path:
    """The same FMU, but for steps of one size only."""
    target = fmu.with_name("fixed.fmu")
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        for item in old.namelist():
            data = old.read(item)
            if item == "modelDescription.xml":
                data = data.replace(b' canHandleVariableCommunicationStepSize="true"', b"")
            new.writestr(item, data)
    return target


def test_steps_of_one_size(tmp_path: Path) -> None:
    """An FMU that needs them says so; with --step it gets what was in force at each point."""
    source = made(tmp_path / "s.mcap", [0.0, 0.1, 0.35, 0.4, 1.0])
    fmu = fixed_step(mixed_fmu(tmp_path))
    refused = injected(source, "--into", fmu, "--map", "pilot.u=u", cwd=tmp_path)
    assert refused.code == 2
    assert "--step" in refused.error["hint"]
    result = injected(
        source, "--into", fmu, "--map", "pilot.u=u", "--step", "0.25", "-o", "n.mcap", cwd=tmp_path
    )
    assert result.code == 0, result.err
    out = Trace(tmp_path / "n.mcap").read("/mixed/output")
    assert out.delivered.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert out["y"].tolist() == [0.0, 1.0, 3.0, 3.0, 4.0]


def test_a_new_packet_link(tmp_path: Path) -> None:
    """Each second a message, half a second late: received from then on, the start value before."""
    source = made(tmp_path / "s.mcap", [0.25 * k for k in range(17)])
    result = injected(
        source, "--into", mixed_fmu(tmp_path), "--map", "pilot.u=u", "--as", "sent",
        "--sample-time", "1", "--delay", "0.6", "--set", "u=-3", "-o", "n.mcap", cwd=tmp_path,
    )  # fmt: skip
    assert result.code == 0, result.err
    given = Trace(tmp_path / "n.mcap").read("/mixed/input")
    assert {0.6, 1.6, 2.6, 3.6} <= set(given.delivered.tolist())
    for t, u in zip(given.delivered.tolist(), given["u"].tolist(), strict=True):
        sent = np.floor(t - 0.6 + 1e-9)
        assert u == (-3.0 if sent < 0 else 0.5 * 4 * sent)


def test_a_new_transport_link(tmp_path: Path) -> None:
    """A delay alone: the signal between its samples, later."""
    source = made(tmp_path / "s.mcap", [0.25 * k for k in range(17)])
    result = injected(
        source, "--into", mixed_fmu(tmp_path), "--map", "pilot.u=u", "--as", "sent",
        "--delay", "0.6", "-o", "n.mcap", cwd=tmp_path,
    )  # fmt: skip
    assert result.code == 0, result.err
    given = Trace(tmp_path / "n.mcap").read("/mixed/input")
    expected = np.interp(given.delivered - 0.6, [0.0, 4.0], [0.0, 8.0])
    assert given["u"] == pytest.approx(expected, abs=1e-12)


def test_a_link_of_a_scenario_file(tmp_path: Path) -> None:
    """[links.NAME] of any scenario; without loss and order it is the schedule's own delays."""
    from cosim.scenario import load  # noqa: PLC0415

    text = load("auv-acoustic").text.replace("loss = 0.05", "loss = 1.0")
    (tmp_path / "deaf.toml").write_text(text)
    result = injected(
        trace_of("auv-acoustic"), "--into", "HinfController", "--as", "sent",
        "--link", "deaf.toml:uplink", "-o", "n.mcap", cwd=tmp_path,
    )  # fmt: skip
    assert result.code == 0, result.err
    given = Trace(tmp_path / "n.mcap").read("/controller/input")
    assert set(given["eta.x"].tolist()) == {3.0}  # nothing ever arrives


def test_mapped_output_is_taken_as_its_link_delivered_it(tmp_path: Path) -> None:
    """plant.eta mapped by hand, as delivered: the deliveries of the link that carried it."""
    source = trace_of("auv-acoustic")
    groups = ("--map-group", "plant.eta=eta", "--map-group", "plant.nu=nu")
    result = injected(source, "--into", "HinfController", *groups, "-o", "n.mcap", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["mapped"]["eta.x"] == "/link/uplink:plant.eta.x"
    assert result.json["not_mapped"] == [f"reference.{axis}" for axis in ("x", "y", "z", "psi")]
    then = Trace(source).read("/controller/input")
    now = Trace(tmp_path / "n.mcap").read("/controller/input")
    assert then["nu.r"].tobytes() == now["nu.r"].tobytes()


def test_stamps_of_a_wall_clock_begin_at_zero(tmp_path: Path) -> None:
    """A recording of another tool, JSON, stamped with the time of day."""
    now = 1_790_000_000 * S
    with (tmp_path / "j.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "other")
        channel = writer.register_channel("/imu", "json", 0)
        for k in range(4):
            data = json.dumps({"acc": {"x": k / 2}}).encode()
            writer.add_message(channel, now + k * S // 10, data, now)
        writer.finish()
    result = injected(
        tmp_path / "j.mcap", "--into", mixed_fmu(tmp_path), "--map", "/imu:acc.x=u", "-o", "n.mcap",
        cwd=tmp_path,
    )  # fmt: skip
    assert result.code == 0, result.err
    assert result.json["shift_s"] == 1_790_000_000.0
    out = Trace(tmp_path / "n.mcap").read("/mixed/output")
    assert out.delivered.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert out["y"].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_a_component_that_fails_leaves_what_it_did(tmp_path: Path) -> None:
    source = made(tmp_path / "s.mcap", [0.1 * k for k in range(20)])
    result = injected(
        source, "--into", mixed_fmu(tmp_path), "--map", "pilot.u=u", "--set", "fail_at=0.95",
        "-o", "n.mcap", cwd=tmp_path,
    )  # fmt: skip
    assert result.code == 4
    assert result.json["status"] == "failed"
    assert "it broke" in result.json["reason"]
    assert len(Trace(tmp_path / "n.mcap").read("/mixed/output")) == 11


WRONG = {
    "no such FMU": (("--into", "None"), "there is no FMU"),
    "no such signal": (("--map", "pilot.w=u"), "there is no signal"),
    "no such input": (("--map", "pilot.u=w"), "there is no input"),
    "no such group": (("--map-group", "pilot.w=v"), "no members"),
    "nothing in common": ((), "no recorded signal fits"),
    "no pair": (("--map", "pilot.u"), "not a pair"),
    "no such component": (("--as-component", "captain"), "there is no recorded component"),
    "nothing to compare with": (("--compare", "captain"), "there is no recorded component"),
    "no such parameter": (("--map", "pilot.u=u", "--set", "zeta=1"), "zeta"),
    "no number": (("--map", "pilot.u=u", "--set", "u=x"), "not a number"),
    "a link for what was delivered": (
        ("--map", "pilot.u=u", "--delay", "1"),
        "signals as they were sent",
    ),
    "a link that was not recorded": (
        ("--map", "pilot.u=u", "--as", "sent", "--link", "up"),
        "there is no recorded link",
    ),
    "jitter without messages": (
        ("--map", "pilot.u=u", "--as", "sent", "--jitter", "1"),
        "need a packet link",
    ),
    "a negative delay": (("--map", "pilot.u=u", "--as", "sent", "--delay", "-1"), "not a time"),
    "a loss of two": (
        ("--map", "pilot.u=u", "--as", "sent", "--sample-time", "1", "--loss", "2"),
        "probability",
    ),
    "no step": (("--map", "pilot.u=u", "--step", "0"), "not a step"),
    "a step beyond the end": (("--map", "pilot.u=u", "--step", "99"), "step does not fit"),
    "onto itself": (("--map", "pilot.u=u", "-o", "s.mcap"), "overwrite"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_orders_are_refused(tmp_path: Path, what: str) -> None:
    arguments, message = WRONG[what]
    source = made(tmp_path / "s.mcap", [0.0, 0.5, 1.0])
    before = source.read_bytes()
    into = () if "--into" in arguments else ("--into", str(mixed_fmu(tmp_path)))
    result = injected(source, *into, *arguments, cwd=tmp_path)
    assert result.code == 2, result.out
    assert message in f"{result.error['what']} {result.error['where']}"
    assert source.read_bytes() == before


def test_the_view_names_source_and_input(tmp_path: Path) -> None:
    copied(trace_of("paper-example"), tmp_path / "p.mcap")
    words = ("trace", "inject", "p.mcap", "--into", "PaperController", "--compare", "controller")
    result = cosim(*words, "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 0, result.err
    assert "bit for bit" in result.out
    assert "/controller/input x[1]" in result.out
    assert (tmp_path / "traces" / "p-into-PaperController.mcap").exists()
