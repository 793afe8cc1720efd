"""Whatever speaks in a run, and when: every line of its trace has its place among the rows."""

from __future__ import annotations

import dataclasses
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled import compile_fmu
from conduct import ToItsEnd
from coupled import ns
from events import event_fmu
from shared import slow_share_of

from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    LogLevel,
    Observer,
    Session,
    Supervisor,
    System,
    TraceRecorder,
    make_schedule,
)
from cosim.network import PacketLink
from cosim.trace import Trace, TraceWriter, verify
from cosim.trace.outcome import RunEvent

_VARIABLES = "".join(
    f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
    f'variability="{variability}"><Integer {start}/></ScalarVariable>'
    for i, (name, causality, variability, start) in enumerate(
        (
            ("steps", "output", "discrete", ""),
            ("count", "parameter", "fixed", 'start="0"'),
            ("lines", "parameter", "fixed", 'start="0"'),
            ("last", "parameter", "fixed", 'start="0"'),
            ("heard", "input", "discrete", 'start="0"'),
        )
    )
)
_CHATTER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<fmiModelDescription fmiVersion="2.0" modelName="chatter" guid="chatter">'
    '<CoSimulation modelIdentifier="chatter" canHandleVariableCommunicationStepSize="true"/>'
    '<LogCategories><Category name="logAll"/></LogCategories>'
    f"<ModelVariables>{_VARIABLES}</ModelVariables><ModelStructure><Outputs>"
    '<Unknown index="1"/></Outputs></ModelStructure></fmiModelDescription>\n'
)


def chatter(folder: Path, points: int, level: LogLevel = "debug", **parameters: int) -> System:
    """Two slaves that speak in so many steps of 1 ms; their own messages from a level on."""
    source = Path(__file__).with_name("chatter.c")
    fmu = describe_fmu(compile_fmu(source, _CHATTER, folder / "chatter.fmu", "-pthread"))
    one = Component(fmu, parameters, log_level=level)
    two = Component(fmu, {**parameters, "last": 0}, log_level=level)
    schedule = make_schedule({}, ns(0.001), ns(0.001 * points), "grid")
    return System({"a": one, "b": two}, [], {}, {}, schedule)


def lines_of(path: Path) -> tuple[int, list[tuple[int, str, str]]]:
    """Check that a trace is as it must be; return its latest row, and its log."""
    found = verify(path)
    failed = {check.name: check.detail for check in found.checks if check.verdict == "failed"}
    failed.pop("link counts", None)  # the results here have no figures of links
    assert failed == {}
    trace = Trace(path)
    log = trace.read("/log")
    columns = log.log_time_ns.tolist(), log["name"], log["message"]
    return int(trace.read("/a/output").log_time_ns[-1]), list(zip(*columns, strict=True))


def supervised(system: System, path: Path, *observers: Observer, keep: bool = False) -> None:
    """Run a system in a child process, up to its end or to where it breaks off."""
    with TraceWriter(path, run={}) as writer, Supervisor() as supervisor, ExitStack() as living:
        recorder = TraceRecorder(writer, system)
        watching = [*observers, recorder]
        run = supervisor.run(system, watching, ToItsEnd(), living=living, keep=keep).run
        recorder.run_ended = True
        living.close()
        recorder.conclude(run.end_ns, [("info", "master", run.status)])
        writer.finish({"status": run.status})


@pytest.mark.parametrize(
    ("points", "parameters"),
    [
        (60, {"lines": 40, "last": 30}),
        (60, {"lines": 10, "last": 30, "count": 2}),
        *slow_share_of([(3000, {"lines": 40, "count": 4, "last": n}) for n in (0, 2000)]),
    ],
)
def test_streams_of_a_child_have_their_place_also_as_it_dies(
    tmp_path: Path, points: int, parameters: dict[str, int]
) -> None:
    """With lines left out, lines that are read when the child is gone, and lines from threads."""
    path = tmp_path / "t.mcap"
    supervised(chatter(tmp_path, points, "warning", **parameters), path)
    latest, lines = lines_of(path)
    names = {name for _, name, _ in lines}
    assert {"stdout", "stderr", *(["a", "b"] if "count" in parameters else [])} <= names
    assert lines[-1][0] >= latest
    many = parameters["lines"] * points > 2000
    assert many == any("were left out of the log" in message for _, _, message in lines)


@pytest.mark.parametrize("threads", [1, 2])
def test_lines_from_threads_have_their_place(tmp_path: Path, threads: int) -> None:
    """In this process, where they come between any two rows."""
    system = dataclasses.replace(chatter(tmp_path, 2000, count=3), threads=threads)
    path = tmp_path / "t.mcap"
    with TraceWriter(path, run={}) as writer:
        with Session(system, [TraceRecorder(writer, system)], keep=False) as session:
            session.go_on()
        writer.finish({"status": "finished"})
    latest, lines = lines_of(path)
    instants = np.array([at for at, _, message in lines if message == "from a thread"])
    assert instants.size
    assert instants.max() <= latest


def test_a_line_of_a_call_that_breaks_off_its_row_is_kept(tmp_path: Path) -> None:
    """What it says last is why: here another component has yet to receive its input."""
    system = dataclasses.replace(
        chatter(tmp_path, 10, last=4),
        algorithm="gauss-seidel",
        connections=[Connection(Endpoint("a", "steps"), Endpoint("b", "heard"))],
    )
    path = tmp_path / "t.mcap"
    supervised(system, path)
    latest, lines = lines_of(path)
    instants = [at for at, name, message in lines if (name, message) == ("a", "a step")]
    assert instants == [ns(0.001 * k) for k in range(4)]
    assert latest == ns(0.002)


class Late(Observer):
    """Finds an event between two rows when the later one comes, and notes lines."""

    def __init__(self) -> None:
        self.waiting: list[RunEvent] = []

    def rows_complete(self, first: int, last: int) -> None:
        at = [ns(0.25 * k) - 1000 for k in range(max(first, 1), last)]
        self.waiting += [RunEvent(t, "warning", "loss", "link", f"missed {t}") for t in at]

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Of no concern."""

    def take(self, until_ns: int) -> list[RunEvent]:
        """As the events of a run are taken."""
        due = [event for event in self.waiting if event.time_ns <= until_ns]
        self.waiting = [event for event in self.waiting if event.time_ns > until_ns]
        return due


@pytest.mark.parametrize(("link", "start"), [(False, 0), (True, 0), (False, 10)])
def test_a_line_at_the_next_point_comes_behind_what_is_due_before(
    tmp_path: Path, *, link: bool, start: int
) -> None:
    """Values within steps, deliveries, and events that are found with the next row."""
    fmu = describe_fmu(event_fmu(tmp_path, ["ramp", "u", "y"]))
    components = {
        "a": Component(fmu, {}, intermediate=["ramp"], event_mode=False),
        "b": Component(fmu, {}, event_mode=False),
    }
    links: dict[str, Any] = {"l": PacketLink("l", ns(0.05), delay_ns=ns(0.07))} if link else {}
    wires = [Connection(Endpoint("a", "y"), Endpoint("b", "u"), "l" if link else None)]
    schedule = make_schedule(links, ns(0.25), ns(1), "grid", start_ns=ns(start))
    system = System(components, wires, links, {}, schedule)
    path, late = tmp_path / "t.mcap", Late()
    with TraceWriter(path, run={}) as writer:
        recorder = TraceRecorder(writer, system, late.take)
        with Session(system, [late, recorder]) as session:
            while not session.ended:
                session.note("info", "scenario", "too early", time_ns=0)
                session.note("info", "scenario", "here")
                session.note("info", "scenario", "an hour late", time_ns=ns(3600))
                session.step(2)
        recorder.conclude(ns(1), [])
        writer.finish({"status": "finished"})
    _, lines = lines_of(path)
    for words, row in (("too early", -1), ("here", 0), ("an hour late", 0)):
        instants = [at - ns(start) for at, _, message in lines if message == words]
        assert instants == [ns(0.25 * max(k + row, 0)) for k in (0, 2, 4)], words
    assert sum("missed" in message for _, _, message in lines) == 4
    assert len(Trace(path).read("/a/intermediate")) == 12
