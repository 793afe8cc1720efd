"""Runs whose rows are not kept: the same rows, bit for bit, in memory that does not grow."""

from __future__ import annotations

import gc
import random
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil
import pytest
from benchmarks._tiny import tiny_fmu
from benchmarks.loop import system_of
from mixed import mixed_fmu
from scalar import end, ns, scalar_fmu, scalars
from test_kernel_agrees import random_system

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.master import (
    DelaySource,
    EngineName,
    Observer,
    Run,
    Session,
    TraceRecorder,
    divergence,
    wire as laid_out,
    wiring,
)
from cosim.master.reserved import Reserved
from cosim.network import DelaySignal, PacketLink, TransportLink
from cosim.trace import TraceWriter, content_hash

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cosim.fmu import FmuDescription
    from cosim.master import System

SYSTEMS = 40
HISTORY = 8


class Rows(Observer):
    """Keeps what an observer receives, block by block."""

    def __init__(self) -> None:
        self.parts: list[Any] = []
        self.lines: list[Any] = []

    def begin(self, instances: Sequence[Any]) -> None:
        self._instances = instances

    def rows_complete(self, first: int, last: int) -> None:
        for k in range(first, last):
            for one in self._instances:
                own = one.own_points.own_between(k, k + 1)
                values = [one.outputs[own].tobytes(), one.inputs[own].tobytes()]
                self.parts.append((int(one.comm_points.points_ns[k]), values))

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        self.lines.append((time_ns, level, name, message))


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> tuple[FmuDescription, FmuDescription]:
    folder = tmp_path_factory.mktemp("fmus")
    return describe_fmu(scalar_fmu(folder)), describe_fmu(mixed_fmu(folder))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Leaves few rows; what is given back reads as NaN and 0."""

    def spoil(reserved: Reserved, before: int) -> None:
        reserved.array[:before] = np.nan if reserved.array.dtype.kind == "f" else 0

    monkeypatch.setattr(Reserved, "give_back", spoil)
    for module in (wiring, divergence):
        monkeypatch.setattr(module, "HISTORY", HISTORY)
    return monkeypatch


def everything(
    system: System, trace: Path, engine: EngineName, *, keep: bool
) -> tuple[Any, Rows, Run]:
    """All that a run gives to observers, and the hash of its trace."""
    seen = Rows()
    with TraceWriter(trace, run={}) as writer:
        recorder = TraceRecorder(writer, system)
        with Session(system, [seen, recorder], engine=engine, keep=keep) as session:
            session.go_on()
            run = session.result()
        writer.finish({})
    found = (run.status, run.reason, run.cause, run.count, run.end_ns, run.statistics)
    return (*found, content_hash(trace)), seen, run


@pytest.mark.parametrize("engine", ["kernel", "python"])
def test_random_systems_give_the_same_rows_in_small_blocks(
    fmus: tuple[FmuDescription, FmuDescription],
    tmp_path: Path,
    small: pytest.MonkeyPatch,
    engine: EngineName,
) -> None:
    """Blocks of a few points, with everything behind them given back as soon as it may be."""
    given_back = 0
    for seed in range(SYSTEMS):
        r = random.Random(seed)  # noqa: S311 - reproducible choices
        try:
            system = random_system(r, fmus)
            whole, all_rows, _ = everything(system, tmp_path / "a.mcap", engine, keep=True)
        except InputError:
            continue
        small.setattr(laid_out, "BLOCK", r.choice([1, 2, 5]))
        small.setattr(laid_out, "_LEAST_BLOCK", 1)
        parts, rows, run = everything(system, tmp_path / "b.mcap", engine, keep=False)
        given_back += run.instances[0].comm_points.oldest > 0
        small.setattr(laid_out, "BLOCK", 1 << 15)
        assert parts == whole, f"seed {seed}"
        assert (rows.parts, rows.lines) == (all_rows.parts, all_rows.lines), f"seed {seed}"
    assert given_back > SYSTEMS / 5


@pytest.mark.parametrize("events", ["align", "grid"])
def test_delays_that_follow_signals_give_the_same_rows(
    fmus: tuple[FmuDescription, FmuDescription],
    tmp_path: Path,
    small: pytest.MonkeyPatch,
    events: str,
) -> None:
    """Live links beside known ones, of transports and packets, older messages in use again."""
    scalar, _ = fmus
    live = PacketLink("live", ns(0.07), 0, delay=DelaySignal(0.9, ns(0.02)), order="as-arrived")
    late = PacketLink("late", ns(0.05), 0, ns(0.33), loss=0.3, seed=2)
    system = scalars(
        scalar.path,
        {"p": {"a": -0.3, "b": 1.0, "x0": 1.0}, "q": {"a": 0.1}, "r": {}, "s": {}},
        (("p.x", "q.u", "live"), ("q.x", "r.u", "late"), ("r.x", "s.u", "t"), ("s.x", "p.u")),
        step=0.1,
        stop=12.0,
        links=[live, late, TransportLink("t", ns(0.55))],
        delays={"live": DelaySource((end("p.x"),), (0.0,))},
        events=events,
    )
    whole, all_rows, _ = everything(system, tmp_path / "a.mcap", "kernel", keep=True)
    small.setattr(laid_out, "BLOCK", 2)
    small.setattr(laid_out, "_LEAST_BLOCK", 1)
    parts, rows, run = everything(system, tmp_path / "b.mcap", "kernel", keep=False)
    assert run.instances[0].comm_points.oldest > 50
    assert parts == whole
    assert rows.parts == all_rows.parts


def test_rows_that_are_not_kept_are_refused(fmus: tuple[FmuDescription, FmuDescription]) -> None:
    system = scalars(fmus[0].path, {"p": {}}, (), step=0.1, stop=1.0)
    with Session(system, keep=False) as session:
        session.go_on()
        run = session.result()
        for ask in (
            lambda: run.points_ns,
            lambda: run.signal("p", "x"),
            session.snapshot,
        ):
            with pytest.raises(InputError, match="not kept"):
                ask()


def test_memory_of_a_run_that_is_not_kept_does_not_grow(tmp_path: Path) -> None:
    """Four times as long takes the same memory; the rows alone would be 58 MB and 230 MB."""
    system = system_of(tiny_fmu(6, tmp_path), 6, steps=300_000, links=True)
    longer = system_of(tiny_fmu(6, tmp_path), 6, steps=1_200_000, links=True)
    process = psutil.Process()
    grown = []
    for one in (system, longer):
        gc.collect()
        before, most = process.memory_info().rss, 0
        with Session(one, engine="kernel", keep=False) as session:
            while not session.ended:
                session.run_until(session.time_s + 500.0)
                most = max(most, process.memory_info().rss - before)
        grown.append(most)
    assert max(grown) < 40 << 20
