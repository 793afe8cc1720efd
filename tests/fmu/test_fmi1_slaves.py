"""Slaves of FMI 1.0, alone and in runs: every type, messages, ends, and what they cannot do."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from foreign.c_fmu import c_fmu, old, source_of
from isolated import isolated_slave
from master.events import event_fmu
from packed import FMI1, pack

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuDescription, FmuSlave, describe_fmu
from cosim.fmu.inspect import inspect_fmu, run_findings
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    EngineName,
    Session,
    System,
    make_schedule,
)

Making = Callable[[FmuDescription, Any], AbstractContextManager[FmuSlave]]


def _here(described: FmuDescription, log: Any) -> FmuSlave:
    return FmuSlave(described, "it", log)


PLACES: dict[str, Making] = {"here": _here, "isolated": isolated_slave}


@pytest.fixture(scope="module")
def fmi1(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The slave of FMI 1.0 with variables of every type."""
    return describe_fmu(c_fmu("old_fmi1.c", old(), tmp_path_factory.mktemp("old")))


@pytest.mark.parametrize("place", PLACES)
def test_every_type_is_set_read_and_stepped(fmi1: FmuDescription, place: str) -> None:
    """The values are those that the model's equations give, in this process and in another one."""
    lines: list[tuple[str, str, str]] = []
    with PLACES[place](fmi1, lambda *line: lines.append(line)) as slave:
        slave.initialise({"gain": 3.0, "u": 2.0, "s": "größer", "n": -7}, 1.0, 9.0)
        assert slave.read(["x", "m", "c", "t", "tasks"]) == {
            "x": 0.0,
            "m": -7,
            "c": False,
            "t": "größer",
            "tasks": 1,
        }
        slave.write({"b": True, "n": 5, "s": "neu"})
        slave.step(1.0, 0.5)
        slave.step(1.5, 0.25)
        assert slave.read(["x", "m", "c", "t", "gap", "repeated"]) == {
            "x": 4.5,
            "m": 5,
            "c": True,
            "t": "neu",
            "gap": 0.0,
            "repeated": 0,
        }
        slave.reset()
        slave.initialise({"u": 1.0}, 0.0, None)
        assert slave.read(["x", "t"]) == {"x": 0.0, "t": "old"}
    # a message is a format with arguments, and the reference in it has the name of the variable
    assert [text for _, text, _ in lines] == ["it, gain: URI 7 0.5", "terminated after 0 steps"]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (2, "step from t = 0.75 s returned fmi1Discard, having computed until t = 0.875 s"),
        (3, "step from t = 0.75 s returned fmi1Error"),
        (4, "step from t = 0.75 s returned fmi1Fatal"),
        (5, "step from t = 0.75 s returned fmi1Pending"),
    ],
)
def test_failed_step_is_reported(
    fmi1: FmuDescription, mode: int, expected: str, place: str
) -> None:
    """Status, time and the slave's own words."""
    with PLACES[place](fmi1, lambda *_: None) as slave:
        slave.initialise({"mode": mode}, 0.0, 2.0)
        for k in range(3):
            slave.step(0.25 * k, 0.25)
        with pytest.raises(ComponentError) as caught:
            slave.step(0.75, 0.25)
    assert caught.value.what == expected
    assert caught.value.got == f"mode {mode}"


@pytest.mark.parametrize(("mode", "ends"), [(1, True), (6, False)])
def test_discard_at_the_end_and_a_warning_are_no_failures(
    fmi1: FmuDescription, *, mode: int, ends: bool
) -> None:
    """A slave that discards its last step has reached the end of the run."""
    with FmuSlave(fmi1, "it", lambda *_: None) as slave:
        slave.initialise({"mode": mode}, 0.0, 1.0)
        for k in range(4):
            slave.step(0.25 * k, 0.25)
        assert slave.asked_to_end() is ends


def test_refused_initialisation_is_reported(fmi1: FmuDescription) -> None:
    """Its message has the values of its arguments."""
    with FmuSlave(fmi1, "it", lambda *_: None) as slave:
        slave.set_start({"mode": 9})
        with pytest.raises(ComponentError, match="returned fmi1Error") as caught:
            slave.enter_initialisation(0.0, 1.0)
    assert caught.value.got == "mode 9 is not allowed"


def test_null_is_a_refusal(tmp_path: Path) -> None:
    """A slave that does not know the GUID gives no instance."""
    path = c_fmu("old_fmi1.c", old().replace('guid="{old}"', 'guid="{new}"'), tmp_path)
    with pytest.raises(ComponentError, match="refuses to be instantiated"):
        FmuSlave(describe_fmu(path), "it", lambda *_: None)


def test_what_fmi_1_cannot_do_is_refused(fmi1: FmuDescription) -> None:
    """States are not saved, and parameters are set before the initialisation alone."""
    assert not fmi1.can_get_and_set_state
    with FmuSlave(fmi1, "it", lambda *_: None) as slave:
        slave.enter_initialisation(0.0, 1.0)
        slave.write({"u": 1.0})
        with pytest.raises(InputError, match="gain cannot be set during the initialisation"):
            slave.write({"gain": 2.0})
        slave.exit_initialisation()
        with pytest.raises(InputError, match="cannot save and restore its state") as caught:
            slave.snapshot()
    assert caught.value.got == "FMI 1.0, which has no call for it"


def test_model_exchange_is_refused_with_what_to_do(tmp_path: Path) -> None:
    """FMI 1.0 has one kind of use in an FMU."""
    begin, end = FMI1.index(" <Implementation>"), FMI1.index("</fmiModelDescription>")
    path = pack(
        {"modelDescription.xml": (FMI1[:begin] + FMI1[end:]).encode()}, tmp_path / "Old.fmu"
    )
    with pytest.raises(InputError, match="this FMU cannot be run") as caught:
        describe_fmu(path)
    assert caught.value.got == "FMI 1.0, model exchange only"
    assert caught.value.hint == "export it for co-simulation, best of FMI 2.0 or 3.0"


def test_dependencies_are_read(fmi1: FmuDescription) -> None:
    """DirectDependency names inputs; an output without one depends on all of them."""
    outputs = {p.name: p for p in fmi1.ports.values() if p.causality == "output"}
    assert {name for name, port in outputs.items() if port.feedthrough} == {"m", "c", "t"}
    assert {n for n, port in outputs.items() if not port.feedthrough_declared} == {"c", "t"}


def test_check_runs_it_and_reports_a_refusal(fmi1: FmuDescription, tmp_path: Path) -> None:
    """A status that means failure is one, and no address of a text."""
    findings = run_findings(inspect_fmu(fmi1.path), 30.0)
    assert [one.code for one in findings if one.level != "note"] == []
    failing = source_of("old_fmi1.c").replace("m->gap = time - m->time;", "return fmi1Error;")
    path = c_fmu("old_fmi1.c", old(), tmp_path, text=failing)
    found = {one.code: one.what for one in run_findings(inspect_fmu(path), 30.0)}
    assert "fmi1DoStep failed with status 3" in found["run-refused"]


def _pair(fmi1: FmuDescription, *, isolate: bool) -> System:
    names = {"one": {"u": 0.5, "n": 3, "s": "a", "b": True}, "two": {"gain": 2.0}}
    components = {n: Component(fmi1, given, isolate=isolate) for n, given in names.items()}
    wires = [("one", "x", "two", "u"), ("one", "m", "two", "n"), ("one", "c", "two", "b")]
    wires.append(("one", "t", "two", "s"))
    connections = [Connection(Endpoint(a, b), Endpoint(c, d)) for a, b, c, d in wires]
    schedule = make_schedule({}, 250_000_000, 2_000_000_000, "grid")
    return System(components, connections, {}, {}, schedule, 1e12)


@pytest.mark.parametrize("isolate", [False, True])
@pytest.mark.parametrize("engine", ["kernel", "python"])
def test_run_gives_what_the_equations_give(
    fmi1: FmuDescription, engine: EngineName, *, isolate: bool
) -> None:
    """Both loops, in this process and in others, for values of every type."""
    with Session(_pair(fmi1, isolate=isolate), engine=engine) as session:
        session.run_until()
        read = {name: session.read("two", name) for name in ("x", "m", "c", "t")}
        with pytest.raises(InputError, match="cannot save and restore its state"):
            session.snapshot()
    x, y = 0.0, 0.0
    for _ in range(8):
        x, y = x + 0.25 * 0.5, y + 0.25 * 2.0 * x
    assert read == {"x": y, "m": 3, "c": True, "t": "a"}


@pytest.mark.parametrize("isolate", [False, True])
def test_numbers_alone_run_in_the_kernel(fmi1: FmuDescription, *, isolate: bool) -> None:
    """The rows of the kernel are those of the loop in Python, and each step is a new one."""
    system = _pair(fmi1, isolate=isolate)
    system = replace(system, connections=system.connections[:3])
    rows = []
    for engine in ("kernel", "python"):
        with Session(system, engine=engine) as session:
            session.run_until()
            signals = [session.read(n, v) for n in ("one", "two") for v in ("x", "m", "repeated")]
            rows.append(signals)
    assert rows[0] == rows[1]
    assert rows[0][2] == rows[0][5] == 0


def test_messages_go_to_their_components(fmi1: FmuDescription) -> None:
    """Two instances of one FMU that say their names."""
    lines: dict[str, list[str]] = {"a": [], "b": []}
    slaves = [
        FmuSlave(fmi1, name, lambda _level, text, _kind, name=name: lines[name].append(text))
        for name in lines
    ]
    for slave in slaves:
        slave.close()
    assert lines == {name: [f"{name}, gain: URI 7 0.5"] for name in lines}


TWICE = '<ScalarVariable name="h" valueReference="{}" causality="internal"><Real/></ScalarVariable>'
NEGATED = (
    '<ScalarVariable name="minus" valueReference="1" causality="output" alias="negatedAlias">'
    "<Real/></ScalarVariable>"
)


def test_local_variables_of_one_name_are_a_warning(tmp_path: Path) -> None:
    """The FMU runs; who names such a variable is told that it is not one."""
    more = TWICE.format(1) + TWICE.format(2)
    path = c_fmu("old_fmi1.c", old(more=more), tmp_path)
    found = [one for one in inspect_fmu(path).findings if one.code == "name-twice"]
    assert [one.level for one in found] == ["warning"]
    described = describe_fmu(path)
    with FmuSlave(described, "it", lambda *_: None) as slave:
        slave.initialise({}, 0.0, 1.0)
        with pytest.raises(InputError, match="h cannot be used") as caught:
            slave.read(["h"])
    assert caught.value.got == "in old_fmi1.fmu: 2 variables have this name"


@pytest.mark.parametrize("causality", ["input", "output"])
def test_other_variables_of_one_name_are_an_error(tmp_path: Path, causality: str) -> None:
    """Which of them a connection means cannot be told."""
    more = TWICE.format(1).replace('"h"', '"u"' if causality == "input" else '"x"')
    path = c_fmu("old_fmi1.c", old(more=more), tmp_path)
    with pytest.raises(InputError, match="not a valid FMU") as caught:
        describe_fmu(path)
    assert "2 variables are named" in str(caught.value.got)


def test_local_variables_that_are_one_are_used(tmp_path: Path) -> None:
    """The same name for the same value is ambiguous to nobody."""
    described = describe_fmu(c_fmu("old_fmi1.c", old(more=TWICE.format(1) * 2), tmp_path))
    with FmuSlave(described, "it", lambda *_: None) as slave:
        slave.initialise({}, 0.0, 1.0)
        assert slave.read(["h"]) == {"h": 0.0}


def test_negated_alias_is_left_out_with_a_warning(tmp_path: Path) -> None:
    """Its value is that of another variable times -1: nobody gets the other one for it."""
    described = describe_fmu(c_fmu("old_fmi1.c", old(more=NEGATED), tmp_path))
    lines: list[str] = []
    with FmuSlave(described, "it", lambda _l, text, _k: lines.append(text)) as slave:
        slave.initialise({}, 0.0, 1.0)
        with pytest.raises(InputError, match="minus cannot be used"):
            slave.read(["minus"])
    assert "minus is left out: a negated alias of another variable" in lines


@pytest.mark.parametrize("engine", ["kernel", "python"])
def test_each_step_is_new_where_others_are_taken_back(
    fmi1: FmuDescription, tmp_path: Path, engine: EngineName
) -> None:
    """What FMI 2 says of states that may be restored is not what FMI 1 asks at a step."""
    events = describe_fmu(event_fmu(tmp_path, ["y", "ramp", "stop_early"]))
    components = {
        "late": Component(events, {"stop_early": 0.4}),
        "soon": Component(events, {"stop_early": 0.3}),
        "old": Component(fmi1, {"u": 1.0}),
    }
    schedule = make_schedule({}, 250_000_000, 1_000_000_000, "align")
    with Session(System(components, [], {}, {}, schedule, 1e12), engine=engine) as session:
        session.run_until()
        read = {name: session.read("old", name) for name in ("x", "gap", "repeated")}
    assert read == {"x": pytest.approx(1.0), "gap": 0.0, "repeated": 0}
