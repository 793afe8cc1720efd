"""What is read in parts is what is read at once, however small the parts are."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_client import PAUSE, PLAY, client
from mcap.writer import CompressionType, Writer
from recorded_runs import write_run, write_topics

from cosim.trace import (
    Rows,
    Signal,
    Table,
    Trace,
    TraceWriter,
    content_hash,
    describe,
    diff,
    export,
    verify,
)
from cosim.trace.comparison import diff_json
from cosim.trace.live import Player

STEP = 10_000_000


@contextmanager
def parts_of(monkeypatch: pytest.MonkeyPatch, size: int) -> Iterator[None]:
    """Read so many bytes at once, whoever asks for how many."""
    parts, borders = Trace.parts, Trace.borders

    def small_parts(self: Trace, *args: Any, **more: Any) -> Iterator[dict[str, Table]]:
        return parts(self, *args, **{**more, "part_bytes": size})

    with monkeypatch.context() as patch:
        patch.setattr(Trace, "parts", small_parts)
        patch.setattr(Trace, "borders", lambda self, *_: borders(self, size))
        yield


@pytest.fixture
def runs(tmp_path: Path) -> tuple[Path, Path]:
    """Two runs of small chunks, of which one value differs."""
    a = write_run(tmp_path / "a.mcap", 300, chunk_bytes=2000)
    return a, write_run(tmp_path / "b.mcap", 300, changed_at=180, chunk_bytes=3000)


def test_a_run_is_verified_in_parts(runs: tuple[Path, Path], monkeypatch: Any) -> None:
    """Good, and with a value that is not its sender's, and a number that comes twice."""
    with parts_of(monkeypatch, 1000):
        assert verify(runs[0]).verdict == "ok"
        assert len(list(Trace(runs[0]).parts())) > 20
    for change, check in (("value", "link values"), ("number", "link fates")):
        path = write_run(runs[0].with_name("c.mcap"), 300, chunk_bytes=2000, wrong=change)
        with parts_of(monkeypatch, 1000):
            found = verify(path)
        assert found.to_json() == verify(path).to_json()
        assert check in {c.name for c in found.checks if c.verdict == "failed"}


def test_traces_are_compared_in_parts(runs: tuple[Path, Path], monkeypatch: Any) -> None:
    """At the same instants, at others, and the beginning of a run."""
    a, b = runs
    other = write_run(a.with_name("c.mcap"), 250, step_ns=STEP * 6 // 5, chunk_bytes=2000)
    part = write_run(a.with_name("d.mcap"), 200, changed_at=180, chunk_bytes=2000)
    for one, two, options in ((a, b, {}), (a, other, {}), (part, a, {"prefix": True})):
        with parts_of(monkeypatch, 2**40):
            whole = diff_json(diff(one, two, **options))
        with parts_of(monkeypatch, 1500):
            found = diff_json(diff(one, two, **options))
        assert found == whole
        assert not found["equal"]
    first = diff(a, b).parted[0]
    assert (first.first_s, first.differing) == (1.8, 1)


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_tables_are_written_in_parts(
    runs: tuple[Path, Path], tmp_path: Path, monkeypatch: Any, to: Any
) -> None:
    for options in ({}, {"wide": True}, {"wide": True, "start": 0.5, "end": 2.0}):
        found = []
        for size in (2**40, 1500):
            with parts_of(monkeypatch, size):
                out = tmp_path / f"{size}-{len(options)}"
                written = export(runs[0], out, to, **options)
            if to == "csv":
                found.append([(w.rows, w.path.read_bytes()) for w in written])
            else:
                import pyarrow.parquet as pq  # noqa: PLC0415 - of the extra

                found.append([(w.rows, pq.read_table(w.path).to_pydict()) for w in written])
        assert found[0] == found[1]
        assert found[0][0][0] > 100


def test_a_value_stays_in_force_from_part_to_part(tmp_path: Path, monkeypatch: Any) -> None:
    """A topic with a row in a hundred, of which one value is missing."""
    with TraceWriter(tmp_path / "a.mcap", run={}, chunk_bytes=500) as writer:
        fast = writer.add_topic("/f/output", [Signal("x")], schema_name="t.F")
        slow = writer.add_topic("/s/output", [Signal("y"), Signal("z")], schema_name="t.S")
        for k in range(400):
            writer.write(fast, k, [k])
            if k % 100 == 30:
                writer.write(slow, k, [k, None if k == 130 else -k])
        path = writer.finish({})
    with parts_of(monkeypatch, 600):
        (one,) = export(path, tmp_path / "w.csv", "csv", wide=True)
    rows = [line.split(",") for line in one.path.read_text().splitlines()[1:]]
    assert [row[2] for row in rows[:30]] == [""] * 30
    assert [float(row[2]) for row in rows[30:]] == [
        30 + (k - 30) // 100 * 100 for k in range(30, 400)
    ]
    assert float(rows[200][3]) == -30


FULL = """
import resource, sys
from pathlib import Path
from cosim.core import InputError
from cosim.trace import export
resource.setrlimit(resource.RLIMIT_FSIZE, (5000,) * 2)
try:
    export(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
except InputError as error:
    print(error)
"""


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_a_full_disk_leaves_no_file_under_a_final_name(
    runs: tuple[Path, Path], tmp_path: Path, to: str
) -> None:
    """Neither new, nor in the place of an old one, nor half of one beside it."""
    out = tmp_path / "out"
    out.mkdir()
    old = out / f"plant.output.{to}"
    old.write_text("old")
    command = [sys.executable, "-c", FULL, str(runs[0]), str(out), to]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    done = subprocess.run(  # noqa: S603 - our own script
        command, check=True, capture_output=True, text=True, env=environment
    )
    assert "cannot be written" in done.stdout
    assert [*out.iterdir()] == [old]
    assert old.read_text() == "old"


MS = 10**6


@pytest.mark.parametrize("ordered", [True, False])
def test_messages_are_played_in_order_of_time(tmp_path: Path, *, ordered: bool) -> None:
    """From any instant on, with the state there, of files in any order."""
    choose = random.Random(1)  # noqa: S311 - to be repeatable
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=300, compression=CompressionType.ZSTD)
        writer.start("", "test")
        channels = [writer.register_channel(f"/{i}", "json", 0) for i in range(3)]
        every = []
        for k in range(400):
            at = MS * (k // 2 if ordered else choose.randrange(200))
            number = 2 if k == 17 else choose.randrange(2)
            every.append((f"/{number}", at, b"%d" % k))
            writer.add_message(channels[number], at, b"%d" % k, at, k)
        writer.finish()
    every.sort(key=lambda message: message[1])
    with Player(path, port=0, rate=1) as player, client(player.url) as seen:
        assert seen.info["dataStartTime"] == {"sec": 0, "nsec": every[0][1]}
        assert seen.info["dataEndTime"] == {"sec": 0, "nsec": every[-1][1]}
        seen.subscribe(*seen.channels)
        assert seen.messages(400) == every
        for at in (0, 5 * MS, 50 * MS + 1, 100 * MS, 199 * MS):
            true = {topic: time for topic, time, _ in every if time <= at}
            seen.control(PAUSE, 4, seek_ns=at)
            state = seen.messages(len(true))
            assert {topic: time for topic, time, _ in state} == true
            assert [time for _, time, _ in state] == sorted(true.values())
            assert all(message in every for message in state)
            seen.control(PLAY, 4)
            later = [message for message in every if message[1] > at]
            assert seen.messages(len(later)) == later
        assert player.damage == []


def test_the_first_message_is_there_before_the_last_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few chunks are opened for it, though all are due at once; and for the state at an instant.

    Chunks beyond are given out only when the test has seen what it waits for.
    """
    path = write_run(tmp_path / "a.mcap", 300, chunk_bytes=2000)
    count = len(Trace(path).segments)
    opened: list[int] = []
    seen_enough = threading.Event()
    real = Trace.read_segment

    def slow(self: Trace, segment: Any) -> Any:
        opened.append(segment.position)
        if len(opened) > 3:
            seen_enough.wait(5)  # for ever, unless the test fails
            seen_enough.set()
        return real(self, segment)

    monkeypatch.setattr(Trace, "read_segment", slow)
    with Player(path, port=0, rate=1e6) as player, client(player.url) as seen:
        seen.control(PAUSE, 1e6, seek_ns=299 * STEP)
        seen.until("state")
        seen.subscribe(*seen.channels)
        seen.control(PAUSE, 1e6, seek_ns=299 * STEP)
        assert {at for _, at, _ in seen.messages(4)} == {299 * STEP}
        assert len(opened) <= 3 < count / 5
        seen.control(PAUSE, 1e6, seek_ns=0)
        seen.messages(2)
        opened.clear()
        seen.control(PLAY, 1e6)
        assert seen.messages(1)[0][1] == STEP
        assert len(opened) <= 4
        assert not seen_enough.is_set()
        seen_enough.set()
        last: set[str] = set()
        while last != {*seen.channels}:
            topic, at, _ = seen.messages(1)[0]
            last |= {topic} if at == 299 * STEP else set()
        assert len(opened) >= count - 4


def test_many_topics_cost_no_more_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each message is looked at once, whatever the number of topics."""
    looked = []
    real = np.argsort

    def counting(array: Any, *args: Any, **more: Any) -> Any:
        looked.append(np.size(array))
        return real(array, *args, **more)

    monkeypatch.setattr(np, "argsort", counting)
    per_message = []
    for topics in (10, 100):
        path = write_topics(tmp_path / f"{topics}.mcap", topics, rows=20)
        looked.clear()
        tables = Trace(path).read_all()
        assert {len(table) for table in tables.values()} == {20}
        per_message.append(sum(looked) / (20 * topics))
    assert per_message[1] <= 1.5 * per_message[0]


def test_info_of_a_large_file_is_from_its_summary(tmp_path: Path) -> None:
    """No data are read, and no hash is made up; with --hash it is there."""
    whole = {}
    for name, rows in (("small", 10), ("large", 8000)):
        path = tmp_path / f"{name}.mcap"
        with TraceWriter(path, run={}, compression="none") as writer:
            signals = [Signal(f"x[{i}]") for i in range(1000)]
            topic = writer.add_topic("/a/output", signals, schema_name="t.A")
            writer.write_rows([Rows(topic, np.arange(rows), np.zeros((rows, 1000)))])
            writer.finish({"status": "finished"})
        whole[name] = {
            "content_hash": content_hash(path),
            "verified": {"verdict": "ok", "failed": []},
        }
    small, large = describe(tmp_path / "small.mcap"), describe(path)
    assert small == {**small, **whole["small"]}
    assert path.stat().st_size > 2**26
    assert (large["content_hash"], large["verified"]) == (None, None)
    assert describe(path, hashed=True) == {**large, **whole["large"]}
    with path.open("r+b") as stream:  # which is noticed where data are read
        stream.seek(2**25)
        stream.write(b"damage")
    assert describe(path) == large
    assert describe(path, hashed=True) != {**large, **whole["large"]}
