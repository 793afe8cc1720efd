"""A slave fails: the message, the trace, and that the other slaves are terminated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from scalar import end, ns
from shared import sampled

from cosim.core import ComponentError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Observer,
    Session,
    System,
    TraceRecorder,
    make_schedule,
    simulate,
)
from cosim.trace import Trace, TraceWriter

if TYPE_CHECKING:
    from pathlib import Path

    from cosim.master import Run

STEP, LAST, FAIL_AT = 0.1, 0.8, 0.3
DISCARD, ERROR, FATAL, UNKNOWN = 2, 3, 4, 77
WORDS = {DISCARD: "Discard", ERROR: "Error", FATAL: "Fatal"}
MESSAGE = "the <pump> has lost its prime"
ORDER = ("first", "middle", "last")
ENGINES, ALGORITHMS, VERSIONS = ("python", "kernel"), ("jacobi", "gauss-seidel"), ("2.0", "3.0")


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The FMU that fails, of each version, and another one of the same code that does not."""
    folder = tmp_path_factory.mktemp("faulty")
    found = {version: hostile_fmu(folder, version, f"pump{version[0]}") for version in VERSIONS}
    return found | {"sound": hostile_fmu(folder, "2.0", "sound")}


def ring(fmus: dict[str, Path], version: str, algorithm: Any, **fault: float) -> System:
    """first -> middle -> last -> first; the middle one is set to fail."""
    sound = describe_fmu(fmus["sound"])
    parts = {
        "first": Component(sound, {"u": 1.0}),
        "middle": Component(describe_fmu(fmus[version]), fault),
        "last": Component(sound, {}),
    }
    pairs = (("first", "middle"), ("middle", "last"), ("last", "first"))
    connections = [Connection(end(f"{a}.x"), end(f"{b}.u")) for a, b in pairs]
    comm_schedule = make_schedule({}, ns(STEP), ns(LAST), "grid")
    more = {"order": ORDER} if algorithm == "gauss-seidel" else {}
    return System(parts, connections, {}, {}, comm_schedule, 1e6, algorithm=algorithm, **more)


def fault(what: str, status: int, at: float = FAIL_AT) -> dict[str, float]:
    return misbehaviour(WORDS.get(status, "unknown").lower(), what, at)


def recorded(system: System, path: Path, engine: Any) -> Run:
    with TraceWriter(path, run={}) as writer:
        run = simulate(system, [TraceRecorder(writer, system)], engine=engine)
        writer.finish({"status": run.status})
    return run


def lines(trace: Trace) -> list[tuple[str, str]]:
    """(component, text) of every line of the log."""
    table = trace.read("/log")
    return list(zip(table["name"], table["message"], strict=True))


@pytest.mark.parametrize("status", WORDS)
@pytest.mark.parametrize("what", ["step", "get", "set"])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("version", sampled(VERSIONS, 1))
@pytest.mark.parametrize("engine", ENGINES)
def test_failure_is_named_recorded_and_the_others_are_ended(
    faulty: dict[str, Path],
    tmp_path: Path,
    engine: str,
    version: str,
    algorithm: str,
    what: str,
    status: int,
) -> None:
    """The message names component, call, time, status and FMU log; the others are terminated."""
    system = ring(faulty, version, algorithm, **fault(what, status))
    run = recorded(system, tmp_path / "a.mcap", engine)
    assert run.status == "failed"
    assert run.reason is not None
    # under Gauss-Seidel an output is read when its step is done, into the row of the next point
    early = algorithm == "gauss-seidel" and what == "get"
    time = FAIL_AT - STEP if early else FAIL_AT
    at = "from" if what == "step" else "at"
    for part in ("'middle'", f"{what} {at} t = {time:g} s", WORDS[status], MESSAGE):
        assert part in run.reason
    trace = Trace(tmp_path / "a.mcap")
    assert trace.finished
    log = lines(trace)
    assert ("middle", MESSAGE) in log
    assert any(name == "master" and MESSAGE in text for name, text in log)
    for name in ("first", "last"):
        assert log.index((name, "terminated")) < log.index((name, "freed"))
        assert log.count((name, "freed")) == 1
    # what has failed is not terminated, only freed; after Fatal it is left alone
    assert ("middle", "terminated") not in log
    assert log.count(("middle", "freed")) == (status != FATAL)


@pytest.mark.parametrize("what", ["step", "get", "set"])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("engine", ENGINES)
def test_trace_contains_everything_up_to_the_failure(
    faulty: dict[str, Path], tmp_path: Path, engine: str, algorithm: str, what: str
) -> None:
    """Every complete row, with the values of a run that does not fail, and nothing after it.

    Under Gauss-Seidel the last row has all outputs, and where a turn did not come, the inputs
    that were there to be received.
    """
    whole = simulate(seeded(ring(faulty, "2.0", algorithm)), engine="python")
    failing = seeded(ring(faulty, "2.0", algorithm, **fault(what, ERROR)))
    run = recorded(failing, tmp_path / "a.mcap", engine)
    k = round(FAIL_AT / STEP)
    complete = what != "get" if algorithm == "gauss-seidel" else what == "step"
    rows = k + complete
    assert run.points_ns.size == rows
    trace = Trace(tmp_path / "a.mcap")
    for name in ORDER:
        outputs, inputs = trace.read(f"/{name}/output")["x"], trace.read(f"/{name}/input")["u"]
        assert len(outputs) == len(inputs) == rows
        assert np.array_equal(outputs, whole.signal(name, "x")[:rows])
        assert np.array_equal(inputs[: rows - 1], whole.signal(name, "u")[: rows - 1])
        assert np.array_equal(run.signal(name, "u"), inputs)
    last = {name: trace.read(f"/{name}/input")["u"][-1] for name in ORDER}
    known = {name: whole.signal(name, "x") for name in ORDER}
    if algorithm == "jacobi":
        assert last == {n: whole.signal(n, "u")[rows - 1] for n in ORDER}
    else:
        # first has stepped, so that middle has its new value; middle has not: last has the old one
        assert last["first"] == whole.signal("first", "u")[rows - 1]
        assert last["middle"] == known["first"][rows]
        assert last["last"] == known["middle"][rows - 1]


@pytest.mark.parametrize("engine", ENGINES)
def test_bias_acts_on_inputs_not_received_before_the_failure(
    faulty: dict[str, Path], engine: Any
) -> None:
    """The last row has the value that would have been received, biased once."""
    system = ring(faulty, "2.0", "gauss-seidel", **fault("step", ERROR))
    with Session(seeded(system), engine=engine) as session:
        session.bias("last", "u", 10.0)
        session.go_on()
        run = session.result()
    assert run.signal("middle", "x")[-1] > 0
    assert run.signal("last", "u")[-1] == run.signal("middle", "x")[-1] + 10.0


def seeded(system: System) -> System:
    """The ring with a changing value: the first input is driven, not connected."""
    return System(
        system.components,
        system.connections[:-1],
        {},
        {end("first.u"): 1.0 + np.arange(system.comm_schedule.points_ns.size)},
        system.comm_schedule,
        system.divergence,
        algorithm=system.algorithm,
        order=system.order,
    )


@pytest.mark.parametrize("status", [ERROR, FATAL])
@pytest.mark.parametrize("what", ["enter", "exit"])
@pytest.mark.parametrize("version", VERSIONS)
def test_failure_in_initialisation_is_named_logged_and_the_others_are_freed(
    faulty: dict[str, Path], tmp_path: Path, version: str, what: str, status: int
) -> None:
    """There is no row; the trace has the log of the FMU and of the master."""
    system = ring(faulty, version, "jacobi", **fault(what, status, at=0.0))
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        with pytest.raises(ComponentError, match=MESSAGE) as caught:
            simulate(system, [TraceRecorder(writer, system)])
        writer.finish({"status": "failed"})
    assert "'middle'" in caught.value.text()
    assert "initialisation" in caught.value.text()
    log = lines(Trace(tmp_path / "a.mcap"))
    assert ("middle", MESSAGE) in log
    assert any(name == "master" and MESSAGE in text for name, text in log)
    for name in ("first", "last"):
        assert log.count((name, "freed")) == 1
    assert log.count(("middle", "freed")) == (status != FATAL)


def test_after_fatal_no_instance_of_that_fmu_is_called(faulty: dict[str, Path]) -> None:
    """Its twin is neither terminated nor freed; an instance of another FMU is."""
    ear = Ear()
    system = ring(faulty, "2.0", "jacobi", **fault("step", FATAL))
    twin = Component(system.components["middle"].description, {})
    parts = {**system.components, "first": twin}
    given = System(parts, system.connections, {}, {}, system.comm_schedule, 1e6)
    with Session(given, [ear]) as session:
        session.go_on()
    assert ("last", "freed") in ear.heard
    assert not any(name in ("first", "middle") and text == "freed" for name, text in ear.heard)


@pytest.mark.parametrize("status", [ERROR, FATAL, UNKNOWN])
@pytest.mark.parametrize("version", VERSIONS)
def test_failure_of_terminate_is_logged(faulty: dict[str, Path], version: str, status: int) -> None:
    """The run is finished; the instance is freed unless the failure is fatal."""
    ear = Ear()
    run = simulate(ring(faulty, version, "jacobi", **fault("terminate", status)), [ear])
    assert run.status == "finished"
    assert ("middle", f"terminating the slave: status {status}") in ear.heard
    assert (("middle", "freed") in ear.heard) == (status != FATAL)
    assert ("last", "freed") in ear.heard


class Ear(Observer):
    """Records log lines."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, str]] = []

    def begin(self, instances: Any) -> None:
        """Look on."""

    def rows_complete(self, first: int, last: int) -> None:
        """Look on."""

    def log(self, _time_ns: int, _level: str, name: str, message: str) -> None:
        """Listen."""
        self.heard.append((name, message))
