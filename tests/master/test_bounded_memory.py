"""Runs whose rows are not kept: the same rows, bit for bit, in memory that does not grow."""

from __future__ import annotations

import gc
import hashlib
import random
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import psutil
import pytest
from benchmarks._tiny import tiny_fmu
from benchmarks.loop import system_of
from mixed import mixed_fmu
from scalar import end, ns, scalar_fmu, scalars
from shared import sampled
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
)
from cosim.network import DelaySignal, PacketLink, TransportLink
from cosim.trace import TraceWriter, content_hash

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cosim.fmu import FmuDescription
    from cosim.master import System

SHORT_STEPS = (2e-5, 5e-5)
"""With these a message is under way for longer than rows are kept for everybody [s]."""
LASTING: dict[EngineName, tuple[int, ...]] = {"kernel": (5, 8, 11, 13, 18), "python": (5, 8)}
"""Random systems that reach their end, with links, wires and steps of their own among them."""


class Rows(Observer):
    """Keeps what an observer receives: a digest of each component's rows, and the log."""

    def __init__(self) -> None:
        self.digests: dict[str, Any] = defaultdict(hashlib.sha256)
        self.lines: list[Any] = []

    def begin(self, instances: Sequence[Any]) -> None:
        self._instances = instances

    def rows_complete(self, first: int, last: int) -> None:
        for one in self._instances:
            own = one.own_points.own_between(first, last)
            seen = ("points", one.comm_points.points_ns), ("out", one.outputs), ("in", one.inputs)
            for what, rows in seen:
                self.digests[f"{one.name} {what}"].update(rows[own].tobytes())

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        self.lines.append((time_ns, level, name, message))

    @property
    def found(self) -> Any:
        """All of it, to be compared."""
        return {name: one.hexdigest() for name, one in self.digests.items()}, self.lines


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> tuple[FmuDescription, FmuDescription]:
    folder = tmp_path_factory.mktemp("fmus")
    return describe_fmu(scalar_fmu(folder)), describe_fmu(mixed_fmu(folder))


def everything(
    system: System, trace: Path, engine: EngineName, *, keep: bool
) -> tuple[Any, Any, Run]:
    """All that a run gives to observers, and the hash of its trace."""
    seen = Rows()
    with TraceWriter(trace, run={}) as writer:
        recorder = TraceRecorder(writer, system)
        with Session(system, [seen, recorder], engine=engine, keep=keep) as session:
            session.go_on()
            run = session.result()
        writer.finish({})
    found = (run.status, run.reason, run.cause, run.count, run.end_ns, run.statistics)
    return (*found, content_hash(trace)), seen.found, run


@pytest.mark.parametrize(("engine", "seed"), [(e, seed) for e in LASTING for seed in LASTING[e]])
def test_random_systems_give_the_same_rows_whether_they_are_kept(
    fmus: tuple[FmuDescription, FmuDescription], tmp_path: Path, engine: EngineName, seed: int
) -> None:
    """Runs of several blocks of rows, and what lies behind them given back as soon as it may be."""
    r = random.Random(seed)  # noqa: S311 - reproducible choices
    system = random_system(r, fmus, steps=SHORT_STEPS, count=(40_000, 70_000))
    whole, all_rows, _ = everything(system, tmp_path / "a.mcap", engine, keep=True)
    parts, rows, run = everything(system, tmp_path / "b.mcap", engine, keep=False)
    assert run.instances[0].comm_points.oldest > 20_000
    assert parts == whole
    assert rows == all_rows


@pytest.mark.parametrize("events", sampled(["align", "grid"], 1))
def test_delays_that_follow_signals_give_the_same_rows(
    fmus: tuple[FmuDescription, FmuDescription], tmp_path: Path, events: str
) -> None:
    """Live links beside known ones, of transports and packets, older messages in use again."""
    scalar, _ = fmus
    live = PacketLink("live", ns(7e-4), 0, delay=DelaySignal(0.9, ns(0.02)), order="as-arrived")
    late = PacketLink("late", ns(5e-4), 0, ns(0.33), loss=0.3, seed=2)
    system = scalars(
        scalar.path,
        {"p": {"a": -0.3, "b": 1.0, "x0": 1.0}, "q": {"a": 0.1}, "r": {}, "s": {}},
        (("p.x", "q.u", "live"), ("q.x", "r.u", "late"), ("r.x", "s.u", "t"), ("s.x", "p.u")),
        step=5e-5,
        stop=1.2,
        links=[live, late, TransportLink("t", ns(0.55))],
        delays={"live": DelaySource((end("p.x"),), (0.0,))},
        events=events,
    )
    whole, all_rows, _ = everything(system, tmp_path / "a.mcap", "kernel", keep=True)
    parts, rows, run = everything(system, tmp_path / "b.mcap", "kernel", keep=False)
    assert run.instances[0].comm_points.oldest > 7_000
    assert parts == whole
    assert rows == all_rows


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
