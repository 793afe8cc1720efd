"""The trace of a run: its contents, their order, and that they are reproducible."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from coupled import ns, section_5, system

from cosim.master import TraceRecorder, simulate
from cosim.network import Jitter, PacketLink, draws
from cosim.trace import Trace, TraceWriter, content_hash

if TYPE_CHECKING:
    from pathlib import Path

    from cosim.master import Run, System

LINK = PacketLink(
    "sc",
    ns(0.1),
    delay_ns=ns(0.07),
    jitter=Jitter("uniform", width_ns=ns(0.25)),
    loss=0.3,
    seed=11,
    quantization=0.5,
)


def recorded(given: System, path: Path) -> Run:
    with TraceWriter(path, run={"scenario": "test"}) as writer:
        run = simulate(given, [TraceRecorder(writer, given)])
        writer.finish({"status": run.status})
    return run


def test_rows_of_the_trace_are_the_rows_of_the_run(fmus: Path, tmp_path: Path) -> None:
    """Every output and connected input, at every point, to the bit, under its FMI name."""
    run = recorded(section_5(fmus, step=0.05, stop=2.0, links=[LINK]), tmp_path / "a.mcap")
    trace = Trace(tmp_path / "a.mcap")
    assert trace.finished
    assert set(trace.topics) == {
        "/plant/output",
        "/plant/input",
        "/controller/output",
        "/controller/input",
        "/sea/output",
        "/link/sc",
        "/link/sc/dropped",
        "/link/sc/state",
        "/log",
    }
    for component, direction, names in (
        ("plant", "output", ("x[1]", "x[2]", "z[1]", "z[2]")),
        ("plant", "input", ("u[1]", "w[1]")),
        ("controller", "output", ("u[1]",)),
        ("controller", "input", ("x[1]", "x[2]")),
        ("sea", "output", ("disturbance.u", "disturbance.r")),
    ):
        table = trace.read(f"/{component}/{direction}")
        assert np.array_equal(table.log_time_ns, run.points_ns)
        for name in names:
            assert np.array_equal(table[name], run.signal(component, name))


def test_messages_of_a_link_are_those_that_were_drawn(fmus: Path, tmp_path: Path) -> None:
    """Sent and delivered times, sequence numbers, values as sent (quantized), drops."""
    run = recorded(section_5(fmus, step=0.05, stop=3.0, links=[LINK]), tmp_path / "a.mcap")
    trace = Trace(tmp_path / "a.mcap")
    sent_ns = np.arange(LINK.offset_ns, ns(3.0) + 1, LINK.sample_time_ns)
    lost_ones = draws.lost(LINK.loss, LINK.seed, LINK.name, sent_ns.size)
    jitter = draws.jitter_ns(LINK.jitter, LINK.seed, LINK.name, sent_ns.size)
    arrival = sent_ns + LINK.delay_ns + jitter
    newest, expected, dropped = -1, [], []
    for i in sorted(range(sent_ns.size), key=lambda i: (arrival[i], i)):
        if arrival[i] > ns(3.0):
            continue
        if lost_ones[i] or i < newest:
            dropped.append((int(arrival[i]), "lost" if lost_ones[i] else "overtaken"))
            continue
        newest = i
        expected.append((int(sent_ns[i]), int(arrival[i]), i))
    table = trace.read("/link/sc")
    got = zip(table.publish_time_ns, table.log_time_ns, table.sequence, strict=True)
    assert [tuple(int(v) for v in row) for row in got] == expected
    assert np.all(table.publish_time_ns + LINK.delay_ns <= table.log_time_ns)
    points = run.points_ns.tolist()
    sent = run.signal("plant", "x[1]")[[points.index(s) for s, _, _ in expected]]
    assert table["plant.x[1]"].tolist() == (np.round(sent / 0.5) * 0.5).tolist()
    lost = trace.read("/link/sc/dropped")
    assert list(zip(lost.log_time_ns.tolist(), lost["reason"], strict=True)) == dropped
    assert {reason for _, reason in dropped} == {"lost", "overtaken"}


def test_file_is_in_order_of_time_and_receivers_follow_deliveries(
    fmus: Path, tmp_path: Path
) -> None:
    """Log times never go back; at one instant: outputs, deliveries, inputs, states of links."""
    recorded(section_5(fmus, step=0.05, stop=2.0, links=[LINK]), tmp_path / "a.mcap")
    messages = Trace(tmp_path / "a.mcap").messages()
    seen = [(log, c.topic) for c, _, log, _, _ in messages if c.topic != "/log"]
    rank = {"output": 0, "sc": 1, "dropped": 1, "input": 2, "state": 3}
    for (t0, a), (t1, b) in pairwise(seen):
        assert t0 <= t1
        if t0 == t1 and "dropped" not in a + b:
            assert rank[a.rsplit("/", 1)[1]] <= rank[b.rsplit("/", 1)[1]], (t0, a, b)


def test_each_of_two_vehicles_has_its_own_frame(fmus: Path, tmp_path: Path) -> None:
    """A single one is called auv; of several each has the name of its component."""
    two = {name: ("AuvPlant", {"initial.eta.x": x}) for name, x in (("left", 1.0), ("right", 2.0))}
    for given, vehicles in ((two, ["left", "right"]), ({"left": two["left"]}, ["auv"])):
        recorded(system(fmus, given, [], step=0.1, stop=0.5), tmp_path / "a.mcap")
        trace = Trace(tmp_path / "a.mcap")
        for vehicle, x in zip(vehicles, (1.0, 2.0), strict=False):
            assert trace.read(f"/{vehicle}/pose")["pose.position.x"][0] == x
            assert {f"/{vehicle}/{kind}" for kind in ("hull", "path")} <= set(trace.topics)
        assert set(trace.read("/tf")["child_frame_id"]) == {*vehicles}


def test_channel_metadata_is_that_of_the_model_description(fmus: Path, tmp_path: Path) -> None:
    """FMI name, value reference, unit and hold of each signal; component of each topic."""
    given = system(
        fmus,
        {"auv": ("AuvPlant", {"initial.nu.u": 0.3}), "sea": ("WaveField", {})},
        [("sea.disturbance.u", "auv.disturbance.u")],
        step=0.1,
        stop=0.5,
    )
    run = recorded(given, tmp_path / "a.mcap")
    trace = Trace(tmp_path / "a.mcap")
    info = trace.topics["/auv/output"]
    assert info.metadata["component"] == "auv"
    signals = {s.name: s for s in info.signals}
    assert signals["eta.psi"].unit == "rad"
    assert signals["nu.u"].unit == "m/s"
    assert signals["eta.x"].value_reference == 9
    assert signals["eta.x"].hold == "continuous"
    pose = trace.topics["/auv/pose"]
    assert pose.count == run.points_ns.size


def content(given: System, path: Path) -> str:
    recorded(given, path)
    return content_hash(path)


def test_same_seed_same_content(fmus: Path, tmp_path: Path) -> None:
    """Two runs of one system have one content hash; another seed or step has another."""
    first = content(section_5(fmus, step=0.05, stop=1.0, links=[LINK]), tmp_path / "a.mcap")
    again = content(section_5(fmus, step=0.05, stop=1.0, links=[LINK]), tmp_path / "b.mcap")
    other = dataclasses.replace(LINK, seed=12)
    seed = content(section_5(fmus, step=0.05, stop=1.0, links=[other]), tmp_path / "c.mcap")
    step = content(section_5(fmus, step=0.025, stop=1.0, links=[LINK]), tmp_path / "d.mcap")
    assert first == again  # not the bytes: what is flushed when is up to the clock on the wall
    assert len({first, seed, step}) == 3


@pytest.mark.parametrize(
    ("plant", "status", "rows"),
    [
        ({"delay.d": 1e-12}, "failed", 1),
        ({"A[1,1]": 30.0}, "diverged", None),
        ({"A[1,1]": 5000.0}, "diverged", 2),
    ],
)
def test_trace_of_a_run_that_ended_early_is_readable(
    fmus: Path, tmp_path: Path, plant: dict[str, float], status: str, rows: int | None
) -> None:
    """What was reached is there, and the log's last line says why it ended."""
    given = section_5(fmus, step=0.1, stop=5.0, links=[LINK], plant=plant)
    run = recorded(given, tmp_path / "a.mcap")
    assert run.status == status
    trace = Trace(tmp_path / "a.mcap")
    assert trace.result == {"status": status}
    table = trace.read("/plant/output")
    assert len(table) == run.points_ns.size == (rows or run.points_ns.size) < 50
    assert np.array_equal(table["x[1]"], run.signal("plant", "x[1]"))
    assert trace.topics["/log"].count >= 1


def test_unused_link_is_recorded_without_signals(fmus: Path, tmp_path: Path) -> None:
    """A link without connections is recorded without signals."""
    given = system(fmus, {"sea": ("WaveField", {})}, [], step=0.1, stop=0.5, links=[LINK])
    assert recorded(given, tmp_path / "a.mcap").status == "finished"
    assert Trace(tmp_path / "a.mcap").finished


def test_names_that_differ_in_punctuation_have_their_own_schemas(
    fmus: Path, tmp_path: Path
) -> None:
    """a-b and a_b would share a schema's name; their rows do not mix."""
    parts: dict[str, tuple[str, dict[str, Any]]] = {
        "a-b": ("WaveField", {}),
        "a_b": ("DelayedPlant", {}),
        "1": ("PaperController", {}),
    }
    given = system(fmus, parts, [("a_b.x[1]", "1.x[1]")], step=0.1, stop=0.5)
    run = recorded(given, tmp_path / "a.mcap")
    trace = Trace(tmp_path / "a.mcap")
    assert np.array_equal(
        trace.read("/a-b/output")["disturbance.u"], run.signal("a-b", "disturbance.u")
    )
    assert np.array_equal(trace.read("/a_b/output")["x[2]"], run.signal("a_b", "x[2]"))
    assert np.array_equal(trace.read("/1/input")["x[1]"], run.signal("1", "x[1]"))
