"""Many runs in one process leak nothing, and a long run needs no more memory than its rows."""

from __future__ import annotations

import gc
import tempfile
import weakref
from typing import TYPE_CHECKING, Any

import psutil
import pytest
from benchmarks._tiny import tiny_fmu
from benchmarks.endurance import kinds, state
from benchmarks.loop import system_of

from cosim.master import Session, TraceRecorder
from cosim.trace import TraceWriter

if TYPE_CHECKING:
    from pathlib import Path


KEPT_SLAVES = 1000
"""Of so many slaves that were freed last the callbacks are kept, for libraries that stay."""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_fmu(6, tmp_path_factory.mktemp("tiny"))


@pytest.mark.parametrize("engine", ["python", "kernel"])
def test_run_is_freed_without_garbage_collection(tiny: Path, tmp_path: Path, engine: Any) -> None:
    """Rows, slaves, engine and recorder are freed when the last reference is dropped."""
    system = system_of(tiny, 6, steps=100, links=True)
    gc.collect()
    gc.disable()
    try:
        with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
            recorder = TraceRecorder(writer, system)
            with Session(system, [recorder], engine=engine) as session:
                session.bias("a", "x[1]", 0.5)
                session.run_until()
                run = session.result()
            writer.finish({})
        instance = session.instances[0]
        objects = [
            session,
            recorder,
            run,
            instance,
            instance.rows,
            instance.slave,
            session._loop._engine,
        ]
        left = {type(one).__name__: weakref.ref(one) for one in objects}
        del session, recorder, run, instance, objects, writer
        assert [name for name, found in left.items() if found() is not None] == []
    finally:
        gc.enable()


@pytest.mark.slow
def test_three_hundred_runs_leak_no_resources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No object, open file, thread, mapping, folder or memory is left of any of them."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    warm_up = KEPT_SLAVES // 2 + 8  # of two slaves a run; once
    for name, run in kinds(tmp_path).items():
        for _ in range(warm_up):
            run()
        warm_up = 8
        gc.collect()
        objects, before = len(gc.get_objects()), state()
        for _ in range(30):
            run()
        gc.collect()
        after = state()
        assert abs(len(gc.get_objects()) - objects) < 30, name
        assert after[1:] == before[1:], name
        assert after.rss - before.rss < 8 << 20, name


def test_memory_of_a_long_run_is_that_of_its_rows_and_tables(tiny: Path) -> None:
    """300 000 points: what they need beside the rows is less than the rows themselves."""
    process = psutil.Process()
    system = system_of(tiny, 6, steps=300_000, links=True)
    gc.collect()
    before = process.memory_info().rss
    with Session(system, engine="kernel") as session:
        session.run_until()
        grown = process.memory_info().rss - before
        rows = session.result().instances[0].rows.nbytes
    assert rows == 300_001 * 24 * 8
    assert grown < 2 * rows
