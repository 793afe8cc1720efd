"""The supervisor: one child for many runs, replaced after a death; rows as in one process."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from conduct import ToItsEnd
from diary import Diary
from foreign.c_fmu import c_fmu, every
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from scalar import end, ns, scalar_fmu, scalars

from cosim.core import ComponentError, InputError, LossError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    DelaySource,
    Endpoint,
    Limits,
    Observer,
    Run,
    Session,
    Supervisor,
    System,
    make_schedule,
    simulate,
)
from cosim.network import DelaySignal, PacketLink


def supervised(supervisor: Supervisor, system: System, *observers: Observer) -> Run:
    """One run to its end, closed."""
    with ExitStack() as living:
        return supervisor.run(system, observers, ToItsEnd(), living=living).run


@pytest.fixture(scope="module")
def supervisor() -> Iterator[Supervisor]:
    with Supervisor() as opened:
        yield opened


def pump(folder: Path, fault: str, call: str = "step", at: float = 0.45) -> System:
    fmu = describe_fmu(hostile_fmu(folder, "2.0", "pump"))
    parameters = {"u": 2.0, **misbehaviour(fault, call, at)}
    return System(
        {"pump": Component(fmu, parameters)},
        [],
        {},
        {},
        make_schedule({}, ns(0.1), ns(1), "grid"),
        9.0,
    )


def children() -> set[int]:
    return {child.pid for child in psutil.Process(os.getpid()).children(recursive=True)}


def test_child_flies_many_runs_and_is_replaced_after_its_death(tmp_path: Path) -> None:
    """Two runs in one process, one that ends it, and one more in another; then none is left."""
    before = children()
    with Supervisor(method="fork") as opened:
        sound, deadly = pump(tmp_path, "nothing"), pump(tmp_path, "segfault")
        assert supervised(opened, sound).status == "finished"
        first = children() - before
        assert supervised(opened, sound).status == "finished"
        assert children() - before == first
        died = supervised(opened, deadly)
        assert (died.status, died.points_ns.size) == ("failed", 6)
        assert supervised(opened, sound).signal("pump", "x")[-1] == pytest.approx(2.0)
        second = children() - before
        assert len(first) == len(second) == 2  # the child and its keeper
        assert second.isdisjoint(first)
    assert children() == before


def test_a_long_run_keeps_all_of_its_rows(supervisor: Supervisor, tmp_path: Path) -> None:
    """The memory that both processes have is given back while it goes."""
    pair = {"a": {"a": -1.0, "b": 1.5, "x0": 1.0}, "b": {"a": -0.5, "b": -0.2, "x0": 0.8}}
    wires = (("a.x", "b.u", None), ("b.x", "a.u", "back"))
    back = PacketLink("back", ns(0.05), 0, ns(0.02))
    system = scalars(
        scalar_fmu(tmp_path), pair, wires, step=0.1, stop=4000.0, links=(back,), events="grid"
    )
    here, there = simulate(system, []), supervised(supervisor, system)
    assert there.count == here.count >= 40_000
    for name in ("a", "b"):
        for variable in ("x", "u"):
            assert np.array_equal(there.signal(name, variable), here.signal(name, variable))


def with_bad(folder: Path, threads: int) -> System:
    """Six pumps, the fifth of which misbehaves in its step."""
    system = pump(folder, "segfault")
    component = system.components["pump"]
    sound = pump(folder, "nothing").components["pump"]
    components = {f"pump {i}": component if i == 4 else sound for i in range(6)}
    return replace(system, components=components, threads=threads)


@pytest.mark.parametrize("threads", [2, 3, 6])
def test_crash_on_one_of_several_threads_names_its_component(tmp_path: Path, threads: int) -> None:
    """Whichever thread steps it, and whatever the others do meanwhile."""
    with Supervisor() as opened:
        for _ in range(5):
            died = supervised(opened, with_bad(tmp_path, threads))
            assert (died.status, died.points_ns.size) == ("failed", 6)
            assert died.cause is not None
            assert (died.cause.kind, died.cause.component) == ("crashed", "pump 4")
            assert died.cause.call == "fmi2DoStep"


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("live", [False, True])
def test_rows_are_those_of_a_run_in_one_process(
    supervisor: Supervisor,
    tmp_path: Path,
    algorithm: Any,
    live: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    """Bit for bit, with points that come about during the run, and in both algorithms."""
    pair = {"a": {"a": -1.0, "b": 1.5, "x0": 1.0}, "b": {"a": -0.5, "b": -2.0, "x0": 0.8}}
    back = PacketLink("back", ns(0.05), 0, ns(0.0207))
    there = PacketLink("there", ns(0.07), ns(0.01), delay=DelaySignal(0.05, ns(0.02)))
    more: dict[str, Any] = {"links": (back,), "algorithm": algorithm}
    if live:
        more |= {"links": (there, back), "delays": {"there": DelaySource((end("a.x"),), (0.0,))}}
    wires = (("a.x", "b.u", "there" if live else None), ("b.x", "a.u", "back"))
    system = scalars(scalar_fmu(tmp_path), pair, wires, step=0.1, stop=2.0, **more)
    diaries = Diary(), Diary()
    here, there_run = simulate(system, [diaries[0]]), supervised(supervisor, system, diaries[1])
    assert there_run.points_ns.tobytes() == here.points_ns.tobytes()
    count = here.points_ns.size
    rows = [run.instances[0].rows[:count].tobytes() for run in (here, there_run)]
    assert rows[0] == rows[1]
    assert diaries[0].lines == diaries[1].lines
    assert diaries[0].rows == diaries[1].rows == count
    assert there_run.statistics == here.statistics
    for name, d in here.deliveries.items():
        assert repr(there_run.deliveries[name].arrivals()) == repr(d.arrivals())
    assert (here.status, here.engine) == (there_run.status, there_run.engine)


def test_texts_arrive_under_their_numbers(supervisor: Supervisor, tmp_path: Path) -> None:
    """Strings are numbers in the rows: parent and child agree on them."""
    fmu = describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path))
    components = {
        "one": Component(fmu, {"n": 2, "String.row": ["first", "größer"]}),
        "two": Component(fmu, {"n": 2}),
    }
    wires = [
        Connection(Endpoint("one", "String.reversed"), Endpoint("two", "String.row")),
        Connection(Endpoint("one", "String.out"), Endpoint("two", "String.in")),
    ]
    schedule = make_schedule({}, ns(0.25), ns(1), "grid")
    system = System(components, wires, {}, {}, schedule, 1e12)
    runs = simulate(system), supervised(supervisor, system)
    texts = []
    for run in runs:
        assert run.status == "finished"
        instance = next(i for i in run.instances if i.name == "two")
        texts.append(instance.values(instance.inputs[:5], instance.input_columns))
    assert texts[0] == texts[1]
    assert any("größer" in row for row in texts[1])


class Full(Diary):
    """An observer whose disk is full after some rows."""

    def rows_complete(self, _first: int, last: int) -> None:
        if last > 3:
            raise LossError("the disk is full")


def test_error_of_an_observer_ends_the_run_in_order(tmp_path: Path) -> None:
    """It is raised here, the child stops and frees its slaves, and can do the next run."""
    system = pump(tmp_path, "nothing")
    with Supervisor() as opened:
        with pytest.raises(LossError, match="the disk is full"):
            supervised(opened, system, Full())
        assert supervised(opened, system).status == "finished"


def test_errors_of_the_session_are_raised_here(supervisor: Supervisor, tmp_path: Path) -> None:
    """With their class and all their parts, as in one process."""
    for fault, kind in (("error", ComponentError), ("nothing", InputError)):
        system = pump(tmp_path, fault, "enter", at=0.0)
        if fault == "nothing":
            system.components["pump"].parameters["u"] = "a text"  # type: ignore[index]
        found = []
        for run in (simulate, lambda s: supervised(supervisor, s)):
            with pytest.raises(kind) as raised:
                run(system)
            error = raised.value
            found.append((error.what, error.where, error.expected, error.got, error.hint))
        assert found[0] == found[1]


def test_crash_between_two_sent_values_keeps_the_rows_before(tmp_path: Path) -> None:
    """Of two components, one of which dies in a get: the row of that point is not complete."""
    fmu = describe_fmu(hostile_fmu(tmp_path, "3.0", "pump"))
    bad = {"u": 1.0, **misbehaviour("abort", "get", 0.45)}
    system = System(
        {"good": Component(fmu, {"u": 1.0}), "bad": Component(fmu, bad)},
        [],
        {},
        {},
        make_schedule({}, ns(0.1), ns(1), "grid"),
        9.0,
    )
    with Supervisor() as opened:
        run = supervised(opened, system)
    assert run.cause is not None
    assert (run.cause.component, run.cause.call) == ("bad", "fmi3GetFloat64")
    np.testing.assert_allclose(run.signal("good", "x"), np.arange(5) * 0.1)


class Slow(Diary):
    """An observer that the child is ahead of, and a Ctrl-C after its first rows."""

    def __init__(self) -> None:
        super().__init__()
        self.requested = self.after = 0

    def rows_complete(self, first: int, last: int) -> None:
        super().rows_complete(first, last)
        self.after += bool(self.requested)
        self.requested = signal.SIGINT
        time.sleep(0.1)


def test_interruption_is_answered_before_the_messages_that_wait(tmp_path: Path) -> None:
    """However far the child is ahead of the observers: what it has told is one piece more."""
    slow = Slow()
    system = replace(pump(tmp_path, "nothing"), comm_schedule=_LONG, divergence=1e12)
    with Supervisor(interruption=slow) as supervisor, ExitStack() as living:
        run = supervisor.run(
            system, [slow], ToItsEnd(), living=living, engine="python", keep=False
        ).run
    assert run.cause is not None
    assert run.cause.kind == "interrupted"
    assert run.status == "stopped"
    assert slow.rows == run.count < _LONG.points_ns.size
    assert slow.after <= 3


_LONG = make_schedule({}, ns(0.1), ns(100_000), "grid")


@pytest.mark.parametrize("fault", ["surroundings", "change-folder", "signals", "delete-folder"])
def test_what_a_run_has_changed_is_not_there_for_the_next(tmp_path: Path, fault: str) -> None:
    """It is put back, or the child is replaced: an FMU that looks finds what there was at first."""
    with Supervisor() as opened:
        assert supervised(opened, pump(tmp_path, fault)).status == "finished"
        parameters = {**misbehaviour("nothing"), "fault": 1.0, "beyond": 1e9, "u": 2.0}
        looks = pump(tmp_path, "nothing")
        watching = replace(looks.components["pump"], parameters=parameters)
        found = supervised(opened, replace(looks, components={"pump": watching}))
        assert (found.status, found.reason) == ("finished", None)


class Idle:
    """Runs half of a session, and then does something else that does not end."""

    result = None

    def __call__(self, session: Session) -> None:
        session.run_until(0.5)
        time.sleep(600.0)


def test_a_limit_of_calls_bounds_the_time_between_two_as_well(tmp_path: Path) -> None:
    """What the child does by itself must not take as long as a call may."""
    with Supervisor(Limits(call=0.5)) as opened, ExitStack() as living:
        system = pump(tmp_path, "nothing")
        run = opened.run(system, [], Idle(), living=living).run
    assert run.cause is not None
    assert (run.status, run.cause.kind, run.cause.call) == ("failed", "timed-out", None)
    assert "no answer within 0.5 s at t = 0.5 s" in str(run.reason)
    assert run.count == 5
