"""Foreign slaves: FMI 2.0 and 3.0 together, every type, early stops and failures."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign.c_fmu import c_fmu, every, talker

from cosim.core import InputError
from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import (
    Component,
    ComponentInstance,
    Connection,
    Endpoint,
    LogLevel,
    Session,
    System,
    TraceRecorder,
    make_schedule,
    simulate,
)
from cosim.network import PacketLink, TransportLink
from cosim.trace import Trace, TraceWriter

STEP_S, END_S = 0.25, 2.0


class Diary:
    """Records log lines."""

    def __init__(self) -> None:
        self.lines: list[tuple[int, str, str, str]] = []

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Before the first point."""

    def rows_complete(self, first: int, last: int) -> None:
        """Rows are complete."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        self.lines.append((time_ns, level, name, message))


@pytest.fixture(scope="module")
def fmi2(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The FMI 2.0 slave that logs many messages."""
    return describe_fmu(c_fmu("talker_fmi2.c", talker(), tmp_path_factory.mktemp("talker")))


@pytest.fixture(scope="module")
def fmi3(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The FMI 3.0 slave with variables of every type."""
    return describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path_factory.mktemp("every")))


def system_of(
    components: Mapping[str, tuple[FmuDescription, Mapping[str, Any]]], *wires: str
) -> System:
    """Components with parameters; wires as `a.y b.u`."""
    ends = [
        [Endpoint(*end.split(".", 1)) for end in wire.split()]  # variables may have a point
        for wire in wires
    ]
    return System(
        {name: Component(*given) for name, given in components.items()},
        [Connection(source, target) for source, target in ends],
        {},
        {},
        make_schedule({}, round(STEP_S * 1e9), round(END_S * 1e9), "grid"),
        1e12,
    )


def test_values_of_every_type_are_exchanged_between_fmi_versions(
    fmi2: FmuDescription, fmi3: FmuDescription
) -> None:
    """Reals, truth values and texts into FMI 3.0 and on, arrays and integers within it."""
    small = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Float32")
    system = system_of(
        {
            "two": (fmi2, {"u": 0.5, "b": True, "greeting": "größer"}),
            "three": (
                fmi3,
                {
                    "n": 3,
                    "Float64.row": np.arange(9.0),
                    "String.row": ["a", "b"],
                    **{f"{kind}.in": 7 for kind in small},
                },
            ),
            "last": (fmi3, {"n": 3}),
        },
        "two.y three.Float64.in",
        "two.c three.Boolean.in",
        "two.reply three.String.in",
        "three.Float64.reversed last.Float64.row",
        "three.String.reversed last.String.row",
        *(f"three.{kind}.out last.{kind}.in" for kind in (*small, "Boolean", "String")),
    )
    with Session(system) as session:
        session.run_until()
        read = {
            name: session.read("last", name)
            for name in ("Boolean.out", "String.out", "String.reversed", "Float64.reversed")
        }
        numbers = [session.read("last", f"{kind}.out") for kind in small]
        run = session.result()
    assert run.status == "finished"
    assert run.engine == ("kernel", "Strings and Binary by Python")
    assert read == {
        "Boolean.out": True,
        "String.out": "größer",
        "String.reversed": ["a", "b"],
        "Float64.reversed": np.arange(9.0).reshape(3, 3).tolist(),
    }
    assert numbers == [7] * 7
    assert run.signal("three", "Float64.out").tolist() == [0.5] * 9
    assert run.signal("last", "Float64.row[1,2]").tolist() == [3.0] * 9


@pytest.mark.parametrize("engine", ["python", "kernel"])
def test_integers_of_64_bits_pass_bit_for_bit(
    fmi3: FmuDescription, tmp_path: Path, engine: Any
) -> None:
    """Those that no double is as well, over connections and into the trace; neighbours differ."""
    given = {"Int64.in": -(2**63) + 1, "UInt64.in": 2**64 - 1, "Int64.row": [2**53 + 1, 2**53]}
    described = describe_without_texts(fmi3)
    wires = ("Int64.out {0}.Int64.in", "UInt64.out {0}.UInt64.in", "Int64.reversed {0}.Int64.row")
    system = system_of(
        {"a": (described, given), "b": (described, {}), "c": (described, {})},
        *(f"a.{wire.format('b')}" for wire in wires),
        *(f"b.{wire.format('c')}" for wire in wires),
    )
    system = dataclasses.replace(system, divergence=None)
    path = tmp_path / "wide.mcap"
    with TraceWriter(path, run={}) as writer:
        with Session(system, [TraceRecorder(writer, system)], engine=engine) as session:
            session.run_until()
            assert session.read("c", "Int64.out") == given["Int64.in"]
            assert session.read("c", "UInt64.out") == given["UInt64.in"]
            assert session.read("c", "Int64.reversed") == [2**53, 2**53 + 1]
            assert session.result(complete=True).status == "finished"
        writer.finish({"status": "finished"})
    table = Trace(path).read("/c/output")
    assert table["Int64.out"].tolist()[-1] == given["Int64.in"]
    assert table["UInt64.out"].tolist()[-1] == given["UInt64.in"]
    assert table["Int64.reversed[2]"].tolist()[-1] == 2**53 + 1


@pytest.mark.parametrize("engine", ["python", "kernel"])
def test_slave_of_fmi3_ends_the_run(fmi3: FmuDescription, engine: Any) -> None:
    """At the end of the step in which it asks; the other one is ended in order."""
    bare = describe_without_texts(fmi3)
    diary = Diary()
    system = system_of({"one": (bare, {"end_at": 1.0}), "two": (bare, {})}, "one.x two.Float64.in")
    run = simulate(system, [diary], engine=engine)
    assert run.status == "stopped"
    assert "component 'one' asked for the end in the step from t = 0.75 s" in str(run.reason)
    assert run.signal("one", "x").tolist() == [5.0, 5.25, 5.5, 5.75]
    assert [name for _, _, name, log_text in diary.lines if log_text == "terminated"] == [
        "two",
        "one",
    ]


def describe_without_texts(fmi3: FmuDescription) -> FmuDescription:
    """The FMU without its String variables, for the engine that has none."""
    folder = fmi3.path.parent / "bare"
    if not folder.exists():
        folder.mkdir()
        c_fmu("every_fmi3.c", every(strings=False), folder)
    return describe_fmu(folder / fmi3.path.name)


def test_slave_of_fmi2_ends_the_run_by_discard(fmi2: FmuDescription) -> None:
    """In its fourth step, and what it logs without meaning is no failure."""
    for mode in (1, 5):
        run = simulate(system_of({"it": (fmi2, {"mode": mode})}))
        assert run.status == "stopped"
        assert "asked for the end in the step from t = 0.75 s" in str(run.reason)
        assert run.points_ns.size == 4


@pytest.mark.parametrize(("mode", "word"), [(2, "Discard"), (3, "Fatal"), (4, "Discard")])
def test_failure_names_component_time_and_log_messages(
    fmi2: FmuDescription, fmi3: FmuDescription, mode: int, word: str
) -> None:
    """The other slaves are terminated and freed; after Fatal none of the FMU is called."""
    diary = Diary()
    system = system_of(
        {"bad": (fmi2, {"mode": mode}), "same": (fmi2, {}), "other": (fmi3, {})},
        "bad.y other.Float64.in",
    )
    run = simulate(system, [diary])
    assert run.status == "failed"
    reason = str(run.reason)
    assert f"component 'bad' (talker_fmi2.fmu): step from t = 0.75 s returned fmi2{word}" in reason
    assert ("everything is lost" in reason) == (mode == 3)
    assert ("it broke" in reason) == (mode == 4)
    assert run.points_ns.size == 4
    log_text = {(name, message) for _, _, name, message in diary.lines}
    assert ("other", "terminated") in log_text
    assert (("same", "terminated") in log_text) == (mode != 3)
    assert (("bad", "freed") in log_text) == (mode != 3)
    assert ("bad", "terminated") not in log_text


def test_invalid_array_lengths_are_refused(fmi3: FmuDescription) -> None:
    """Refused when the component is made."""
    with pytest.raises(ValueError, match="n is no length of an array"):
        Component(fmi3, {"n": -1})


LINKS = (
    TransportLink("line", round(0.5 * 1e9)),
    PacketLink("held", round(0.5 * 1e9)),
    PacketLink("zeroed", round(0.5 * 1e9), on_loss="zero"),
    PacketLink("rounded", round(0.5 * 1e9), quantization=1.0),
)


@pytest.mark.parametrize(
    ("source", "target", "link", "message"),
    [
        ("Int32.out", "Int8.in", None, "too small"),
        ("UInt8.out", "Int8.in", None, "too small"),  # the greatest does not fit
        ("Int8.out", "UInt8.in", None, "too small"),  # the least does not fit
        ("Int8.out", "Int16.in", None, None),
        ("UInt8.out", "Int16.in", None, None),
        ("Float64.reversed", "Float64.row", None, "differ in shape"),
        ("Boolean.out", "Float64.in", None, "types of the two ends"),
        ("String.out", "String.in", "held", None),
        ("String.out", "String.in", "zeroed", "transmits real numbers only"),
        ("String.out", "String.in", "line", "transmits real numbers only"),
        ("Int8.out", "Int8.in", "zeroed", None),
        ("Int8.out", "Int8.in", "rounded", "transmits real numbers only"),
        ("Boolean.out", "Boolean.in", "line", "transmits real numbers only"),
        ("Float32.out", "Float32.in", "rounded", None),
    ],
)
def test_connection_types_must_match_ends_and_link(
    fmi3: FmuDescription, source: str, target: str, link: str | None, message: str | None
) -> None:
    """Range, shape and type must match; links interpolate real numbers only."""
    links = {one.name: one for one in LINKS}
    comm_schedule = make_schedule(links, round(STEP_S * 1e9), round(END_S * 1e9), "grid")
    connection = Connection(Endpoint("one", source), Endpoint("two", target), link)
    parts = {"one": Component(fmi3), "two": Component(fmi3)}
    refused = nullcontext() if message is None else pytest.raises(InputError, match=message)
    with refused:
        System(parts, [connection], links, {}, comm_schedule, 1e12)


@pytest.mark.parametrize(
    ("level", "kept"),
    [
        ("debug", {"info", "warning"}),
        ("info", {"info", "warning"}),
        ("warning", {"warning"}),
        ("error", set()),
    ],
)
def test_log_level_keeps_what_is_logged_at_it(
    fmi2: FmuDescription, level: LogLevel, kept: set[str]
) -> None:
    """What is below the level is left out; what is at the level is not."""
    system = system_of({"it": (fmi2, {})})
    parts = {"it": Component(fmi2, log_level=level)}
    diary = Diary()
    simulate(dataclasses.replace(system, components=parts), [diary])
    assert {line[1] for line in diary.lines if line[2] == "it"} == kept
