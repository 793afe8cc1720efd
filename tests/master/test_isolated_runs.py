"""Runs with isolated slaves: the same rows, log lines and snapshots, and how such a run fails."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import test_kernel_agrees
from foreign.c_fmu import c_fmu, every, talker
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from isolated import children
from mixed import mixed_fmu
from scalar import scalar_fmu
from shared import sampled
from test_engines import Diary
from test_foreign_slaves import system_of
from test_kernel_agrees import random_system, run_random

from cosim.core import ComponentError
from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    EngineName,
    Session,
    System,
    make_schedule,
    simulate,
)
from cosim.trace.outcome import Cause


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """No process is left behind."""
    before = children()
    yield
    assert children() <= before


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> tuple[FmuDescription, FmuDescription]:
    folder = tmp_path_factory.mktemp("fmus")
    return describe_fmu(scalar_fmu(folder)), describe_fmu(mixed_fmu(folder))


def isolated(system: System, *names: str) -> System:
    """The system with these components isolated; all of them without names."""
    chosen = names or tuple(system.components)
    components = {
        name: replace(component, isolate=name in chosen)
        for name, component in system.components.items()
    }
    return replace(system, components=components)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "threads"), sampled([("kernel", 1), ("kernel", 3), ("python", 1)], 1)
)
def test_random_systems_give_the_same_bits(
    fmus: tuple[FmuDescription, FmuDescription],
    monkeypatch: pytest.MonkeyPatch,
    engine: EngineName,
    threads: int,
) -> None:
    """Rows and log lines; with links, own steps, overrides, Integers, and slaves that fail."""
    statuses = set()
    for seed in range(25):
        here = run_random(seed, fmus, engine, threads=threads)
        with monkeypatch.context() as patched:
            patched.setattr(
                test_kernel_agrees, "random_system", lambda r, f: isolated(random_system(r, f))
            )
            there = run_random(seed, fmus, engine, threads=threads)
        if "fmi2Fatal" in str(here[1]):  # of slaves in one process none is called after it
            here, there = (found[:-1] for found in (here, there))
        assert here == there, f"seed {seed}"
        statuses.add(here[0] if isinstance(here, tuple) else "refused")
    assert statuses >= {"finished", "failed"}


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> tuple[FmuDescription, FmuDescription]:
    folder = tmp_path_factory.mktemp("foreign")
    once = 'canBeInstantiatedOnlyOncePerProcess="true"'
    return (
        describe_fmu(c_fmu("talker_fmi2.c", talker(flags=once), folder)),
        describe_fmu(c_fmu("every_fmi3.c", every(), folder)),
    )


def test_every_type_of_both_versions_gives_the_same_bits(
    foreign: tuple[FmuDescription, FmuDescription],
) -> None:
    """Strings and arrays too, over the loop in Python; log lines in the same order."""
    fmi2, fmi3 = foreign
    kinds = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Float32", "Boolean", "String")
    system = system_of(
        {
            "two": (fmi2, {"u": 0.5, "b": True, "greeting": "größer"}),
            "three": (fmi3, {"n": 3, "Float64.row": np.arange(9.0), "String.row": ["a", "ä"]}),
            "last": (fmi3, {"n": 3}),
        },
        "two.y three.Float64.in",
        "two.reply three.String.in",
        "three.Float64.reversed last.Float64.row",
        "three.String.reversed last.String.row",
        *(f"three.{kind}.out last.{kind}.in" for kind in kinds),
    )
    found = []
    for one in (system, isolated(system), isolated(system, "three")):
        diary = Diary()
        run = simulate(one, [diary])
        texts = [
            i.values(i.rows[:, i.input_column : i.input_column + len(i.input_columns)],
                     i.input_columns)
            for i in run.instances
        ]  # fmt: skip
        found.append((run.status, diary.lines, texts))
    assert found[0] == found[1] == found[2]
    assert "ä" in str(found[0])


def test_fmu_of_one_instance_is_there_several_times(
    foreign: tuple[FmuDescription, FmuDescription],
) -> None:
    """One run, two components of it."""
    fmi2, _ = foreign
    system = system_of({"a": (fmi2, {"u": 0.5}), "b": (fmi2, {})}, "a.y b.u")
    with pytest.raises(ValueError, match=r"only once in a process[\s\S]*isolate = true"):
        simulate(system)
    for one in (isolated(system), isolated(system, "a"), isolated(system, "b")):
        run = simulate(one)
        assert run.status == "finished"
        assert run.signal("b", "u")[-1] != 0.0


@pytest.mark.parametrize("engine", ["kernel", "python"])
def test_sessions_do_what_they_do_in_one_process(
    fmus: tuple[FmuDescription, FmuDescription], engine: EngineName
) -> None:
    """Snapshot, restore, set, override; a portable snapshot goes to the other one."""
    schedule = make_schedule({}, 10**8, 2 * 10**9, "grid")
    parts = {"a": Component(fmus[0], {"x0": 1.0}), "b": Component(fmus[0], {"b": -2.0})}
    wires = [
        Connection(Endpoint("a", "x"), Endpoint("b", "u")),
        Connection(Endpoint("b", "x"), Endpoint("a", "u")),
    ]
    system = System(parts, wires, {}, {}, schedule)
    found: list[list[bytes]] = []
    elsewhere = None
    for one in (system, isolated(system)):
        found.append([])

        def note(run: Any, into: list[bytes] = found[-1]) -> None:
            into += [run.signal(c, v).tobytes() for c in ("a", "b") for v in ("x", "y", "u")]

        with Session(one, engine=engine) as session:
            session.run_until(0.5)
            before = session.snapshot()
            session.set("a", "a", -0.3)
            session.override("b", "u", 0.25)
            session.run_until()
            note(session.result())
            session.restore(before)
            portable = session.snapshot(portable=True)
            session.run_until()
            note(session.result())
            if elsewhere is not None:
                session.restore(elsewhere)
                session.run_until()
                note(session.result())
                found[-1][-6:] = []
                assert found[-1] == found[0]
            elsewhere = portable
    assert found[0] == found[1]


def pair(folder: Path, version: str, fault: str, call: str, **more: float) -> System:
    """`h` misbehaves in an isolated slave; `s` gets its output, and is here."""
    fmu = describe_fmu(hostile_fmu(folder, version))
    bad = {**misbehaviour(fault, call, **more), "x0": 1.0}
    components = {"h": Component(fmu, bad, isolate=True), "s": Component(fmu, {"x0": 0.5})}
    wires = [
        Connection(Endpoint("h", "x"), Endpoint("s", "u")),
        Connection(Endpoint("s", "x"), Endpoint("h", "u")),
    ]
    return System(components, wires, {}, {}, make_schedule({}, 10**8, 10**9, "grid"))


CALLS = {
    "get": ("GetReal", "GetFloat64"),
    "set": ("SetReal", "SetFloat64"),
    "step": ("DoStep",) * 2,
}


DEATHS = [
    (fault, kind, call, engine)
    for call in CALLS
    for fault, kind, engine in (
        ("segfault", "crashed", "kernel"),
        ("exit-0", "exited", "python"),
        ("exit-0", "exited", "kernel"),
        ("segfault", "crashed", "python"),
    )
]


@pytest.mark.parametrize(("fault", "kind", "call", "engine"), sampled(DEATHS, 6))
def test_death_in_the_loop_fails_the_run(
    tmp_path: Path, fault: str, kind: str, call: str, engine: EngineName
) -> None:
    """Not the process: component, call, time and cause are named; complete rows are kept."""
    for version, function in zip(("2.0", "3.0"), CALLS[call], strict=True):
        folder = tmp_path / version
        folder.mkdir()
        with Session(pair(folder, version, fault, call, at=0.5), engine=engine) as session:
            session.go_on()
            run = session.result()
            assert session.instances[1].slave.phase == "stepping"
        name = f"fmi{version[0]}{function}"
        assert run.status == "failed"
        how = "crashed (SIGSEGV)" if kind == "crashed" else "left with exit code 0"
        assert run.cause == Cause(kind, "h", name, 0.5, f"the process of the component {how}")
        assert f"in {name} ({call}" in str(run.reason)
        assert "t = 0.5 s" in str(run.reason)
        assert run.points_ns.size == (6 if call == "step" else 5)


@pytest.mark.parametrize("fault", ["rounding", "flush-to-zero"])
def test_what_a_call_does_to_arithmetic_ends_with_it(tmp_path: Path, fault: str) -> None:
    """As in one process, each call begins with the same modes."""
    system = pair(tmp_path, "2.0", fault, "get", decay=0.7)
    tiny = {**system.components["h"].parameters, "x0": 1.0 if fault == "rounding" else 3e-310}
    parts = {**system.components, "h": replace(system.components["h"], parameters=tiny)}
    alone = replace(system, components=parts, connections=())
    runs = [simulate(isolated(alone, name)).signal("h", "x") for name in ("h", "s")]
    assert runs[0].tobytes() == runs[1].tobytes()
    assert runs[0][-1] > 0.0


@pytest.mark.slow
def test_nobody_spins(tmp_path: Path) -> None:
    """Neither process uses a processor while the other one computes or nothing is asked for."""
    others = children()
    with Session(pair(tmp_path, "2.0", "sleep", "step", seconds=0.5)) as session:
        slave = psutil.Process(*(set(children()) - set(others)))
        session.step()
        before = sum(slave.cpu_times()[:2]), time.process_time()
        session.step(2)
        time.sleep(0.5)
        after = sum(slave.cpu_times()[:2]), time.process_time()
    assert after[0] - before[0] < 0.1
    assert after[1] - before[1] < 0.1


def test_death_is_noticed_though_a_child_of_the_slave_lives(tmp_path: Path) -> None:
    """It has the other end of the pipe, which is not closed then."""
    started: list[Any] = []
    system = pair(tmp_path, "2.0", "child", "step")
    with Session(system, process_started=started.append) as session:
        session.run_until(0.5)
        (left,) = psutil.Process(started[0].number).children()
        os.kill(started[0].number, signal.SIGKILL)
        session.go_on()
        run = session.result()
        assert not left.is_running()
    assert run.cause is not None
    assert (run.status, run.cause.kind, run.cause.component) == ("failed", "crashed", "h")


def test_death_between_two_calls_is_that_of_the_next(tmp_path: Path) -> None:
    """A process that somebody else kills."""
    started: list[Any] = []
    system = pair(tmp_path, "2.0", "nothing", "step")
    with Session(system, process_started=started.append) as session:
        session.run_until(0.5)
        os.kill(started[0].number, signal.SIGKILL)
        session.go_on()
        run = session.result()
    assert run.cause is not None
    assert (run.status, run.cause.kind, run.cause.component) == ("failed", "crashed", "h")
    assert "SIGKILL" in str(run.reason)


def test_death_outside_the_loop_is_an_error_of_its_kind(tmp_path: Path) -> None:
    """At the start, and in a call of a session."""
    with (
        pytest.raises(ComponentError, match="SIGSEGV") as caught,
        Session(pair(tmp_path, "3.0", "segfault", "exit")),
    ):
        pass
    assert (caught.value.kind, caught.value.call) == ("crashed", "fmi3ExitInitializationMode")
    with Session(pair(tmp_path, "3.0", "segfault", "state")) as session:
        session.run_until(0.3)
        with pytest.raises(ComponentError, match="SIGSEGV") as caught:
            session.snapshot()
        assert (caught.value.kind, caught.value.call) == ("crashed", "fmi3GetFMUState")


def test_hang_is_ended_at_the_limit_and_names_the_slave(tmp_path: Path) -> None:
    """On threads too, where several slaves are called at once."""
    for threads in (1, 2):
        system = replace(pair(tmp_path, "2.0", "hang-deaf", "step", at=0.5), threads=threads)
        began = time.monotonic()
        with Session(system, call_limit=0.3) as session:
            with pytest.raises(ComponentError, match=r"no answer within 0\.3 s"):
                session.run_until()
            run = session.result()
        assert time.monotonic() - began < 5.0
        assert run.cause == Cause("timed-out", "h", "fmi2DoStep", 0.5, "no answer within 0.3 s")
        assert run.points_ns.size == 6


def test_ctrl_c_ends_a_hang_in_the_loop(tmp_path: Path) -> None:
    """In this process, and without a second one; the other slave can still be ended."""
    with Session(pair(tmp_path, "2.0", "hang-deaf", "step", at=0.5)) as session:
        timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            session.run_until()
        timer.join()
        assert session.instances[1].slave.phase == "stepping"


@pytest.mark.slow
def test_isolated_slaves_step_side_by_side(tmp_path: Path) -> None:
    """Two that take 0.1 s each take so long together on two threads."""
    system = pair(tmp_path, "2.0", "sleep", "step", seconds=0.1)
    slow = replace(system.components["h"], isolate=True)
    system = replace(system, components={"h": slow, "s": slow})
    took = {}
    for threads in (1, 2):
        with Session(replace(system, threads=threads)) as session:
            began = time.monotonic()
            session.run_until()
            took[threads] = time.monotonic() - began
    assert took[1] > 2.0
    assert took[2] < 0.8 * took[1]
