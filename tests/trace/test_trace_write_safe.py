"""What is on the disk when a run is slow, killed, told to go, forked, or out of room."""

from __future__ import annotations

import contextlib
import errno
import gc
import multiprocessing
import os
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader

from cosim.core import InputError, LossError
from cosim.trace import Rows, Signal, Trace, TraceWriter

X = [Signal("x")]
ROOT = str(Path(__file__).resolve().parents[2])


def started(script: str, *arguments: str | Path) -> subprocess.Popen[str]:
    """A script of our own; its first line of output is its sign that it is ready."""
    process = subprocess.Popen(  # noqa: S603 - our own script
        [sys.executable, "-c", script, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": ROOT},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n", process.communicate()
    return process


def rows_of(path: Path) -> list[float]:
    """Values of the one topic, by the official streaming reader, as far as it gets."""
    found = []
    with path.open("rb") as stream, contextlib.suppress(Exception):  # cut short, it ends there
        for record in StreamReader(stream, validate_crcs=True).records:
            found += [record.data] if isinstance(record, Message) else []
    return [float(np.frombuffer(data, "<f8", offset=1)[0]) for data in found]


def fill(writer: TraceWriter) -> None:
    """Write a thousand rows, unless interrupted."""
    topic = writer.add_topic("/x", X, schema_name="t.X")
    for k in range(1000):
        writer.write(topic, k, [k])


def test_row_is_flushed_without_a_later_row(tmp_path: Path) -> None:
    """Rows before a long step are flushed during the step."""
    with TraceWriter(tmp_path / "a.mcap", run={}, flush_interval_s=0.2) as writer:
        topic = writer.add_topic("/x", X, schema_name="t.X")
        for k in range(3):
            writer.write(topic, k, [k])
            while len(rows_of(writer.partial_path)) <= k:
                time.sleep(0.01)
        writer.finish({})
    assert rows_of(tmp_path / "a.mcap") == [0.0, 1.0, 2.0]


def test_flushing_changes_no_message(tmp_path: Path) -> None:
    """Rows from one thread while the clock flushes from another: all there, once, in order."""
    with TraceWriter(tmp_path / "a.mcap", run={}, flush_interval_s=1e-4) as writer:
        topic = writer.add_topic("/x", X, schema_name="t.X")
        for k in range(3000):
            if k % 3:
                writer.write(topic, k, [k])
            else:
                writer.write_rows([Rows(topic, np.array([k]), np.array([[float(k)]]))])
        writer.finish({})
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [m.log_time for _, _, m in reader.iter_messages(log_time_order=False)]
        summary = reader.get_summary()
    assert found == list(range(3000))
    assert summary is not None
    assert len(summary.chunk_indexes) > 3


def test_closed_writer_leaves_no_thread(tmp_path: Path) -> None:
    before = set(threading.enumerate())
    writer = TraceWriter(tmp_path / "a.mcap", run={})
    writer.write(writer.add_topic("/x", X, schema_name="t.X"), 0, [0.0])
    assert len(set(threading.enumerate()) - before) == 1
    writer.finish({})
    assert not set(threading.enumerate()) - before


def test_unreferenced_writer_is_closed(tmp_path: Path) -> None:
    """Its rows are on the disk, its file and thread are given back."""
    before = set(threading.enumerate())
    writer = TraceWriter(tmp_path / "a.mcap", run={}, flush_interval_s=1e9)
    fill(writer)
    del writer
    gc.collect()
    assert not set(threading.enumerate()) - before
    assert rows_of(tmp_path / "a.mcap.partial") == list(range(1000))
    TraceWriter(tmp_path / "a.mcap", run={}).close()


WRITES = """
import sys, time
from cosim.trace import Signal, TraceWriter
writer = TraceWriter(sys.argv[1], run={"seed": "1"}, flush_interval_s=1e9)
topic = writer.add_topic("/x", [Signal("x")], schema_name="t.X")
for k in range(1000):
    writer.write(topic, k, [k])
print("ready", flush=True)
"""


DEFAULTS = {
    signal.SIGTERM: "signal.SIG_DFL",
    signal.SIGHUP: "signal.SIG_DFL",
    signal.SIGINT: "signal.default_int_handler",
}


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGINT, None)],
    ids=["terminated", "hung up", "Ctrl-C"],
)
def test_sigterm_closes_the_trace(tmp_path: Path, number: signal.Signals, code: int | None) -> None:
    """Nothing that was handed over is lost, and the file is well-formed, without a result."""
    # whoever started the tests may have had them ignore the signal, and what they start
    default = f"import signal; signal.signal({int(number)}, {DEFAULTS[number]})\n"
    with started(default + WRITES + "sys.stdin.read()", tmp_path / "a.mcap") as process:
        process.send_signal(number)
        process.wait()
        assert process.returncode == (-number if code is None else code)
    trace = Trace(tmp_path / "a.mcap.partial")
    assert (trace.complete, trace.finished) == (True, False)
    assert rows_of(trace.path) == list(range(1000))


HANDLERS = """
import signal, sys
from pathlib import Path
from cosim.trace import TraceWriter

def own(number, frame):
    pass

folder = Path(sys.argv[1])
signal.signal(signal.SIGTERM, own)
with TraceWriter(folder / "a.mcap", run={}):
    assert signal.getsignal(signal.SIGTERM) is own
signal.signal(signal.SIGTERM, signal.SIG_DFL)
with TraceWriter(folder / "b.mcap", run={}), TraceWriter(folder / "c.mcap", run={}):
    assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
"""


def test_signal_handlers_are_kept_and_restored(tmp_path: Path) -> None:
    """A handler of the program's own stays, and the default comes back after the last trace."""
    # in a process of its own: in this one other tests may have left a trace open
    line = [sys.executable, "-c", HANDLERS, str(tmp_path)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    assert done.returncode == 0, done.stderr


def test_trace_is_closed_at_the_end_of_the_program(tmp_path: Path) -> None:
    """The end of the program, also by an exception, closes the trace."""
    for end in ("", "raise ValueError('no')", "sys.exit(3)"):
        with started(WRITES + end, tmp_path / "a.mcap") as process:
            process.wait()
        assert Trace(tmp_path / "a.mcap.partial").complete
        assert rows_of(tmp_path / "a.mcap.partial") == list(range(1000))


def test_forked_child_leaves_the_trace_alone(tmp_path: Path) -> None:
    """A forked process that ends, or writes, does not change the parent's file."""
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/x", X, schema_name="t.X")
        times = np.arange(20_000)
        writer.write_rows([Rows(topic, times, times[:, None] * 1.0)])

        def child() -> None:
            try:
                writer.write(topic, 0, [0.0])
            except InputError:
                writer.close()
                other = tmp_path / "b.mcap"
                with TraceWriter(other, run={}) as own:
                    place = own.add_topic("/x", X, schema_name="t.X")
                    own.write_rows([Rows(place, times, times[:, None] * 1.0)])
                    own.finish({})

        process = multiprocessing.get_context("fork").Process(target=child)
        process.start()
        process.join()
        assert process.exitcode == 0
        writer.write(topic, 20_000, [20_000.0])
        writer.finish({})
    assert rows_of(tmp_path / "a.mcap") == list(range(20_001))
    assert rows_of(tmp_path / "b.mcap") == list(range(20_000))


def test_finished_trace_stays_until_the_new_one_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is replaced by one that is on the disk itself; others are flushed there on request."""
    on_disk: list[bool] = []  # whether it is a folder
    monkeypatch.setattr("os.fsync", lambda n: on_disk.append(stat.S_ISDIR(os.fstat(n).st_mode)))
    path = tmp_path / "a.mcap"
    with TraceWriter(path, run={"n": "1"}) as writer:
        writer.finish({})
    assert on_disk == []
    first = path.read_bytes()
    writer = TraceWriter(path, run={"n": "2"})
    assert path.read_bytes() == first
    writer.close()
    assert path.read_bytes() == first
    assert Trace(writer.partial_path).run == {"n": "2"}
    with TraceWriter(path, run={"n": "3"}, fsync=True) as writer:
        on_disk.clear()
        writer.flush()
        assert on_disk == [False]
        writer.finish({})
    assert on_disk[-2:] == [False, True]
    on_disk.clear()
    with TraceWriter(path, run={"n": "3"}) as writer:
        writer.finish({})
    assert on_disk == [False]
    assert Trace(path).run == {"n": "3"}
    assert not writer.partial_path.exists()


def test_two_runs_do_not_write_one_file(tmp_path: Path) -> None:
    """The second writer is refused without harm; after the first has ended, one is accepted."""
    with TraceWriter(tmp_path / "a.mcap", run={"n": "1"}) as writer:
        topic = writer.add_topic("/x", X, schema_name="t.X")
        writer.write(topic, 0, [1.0])
        with pytest.raises(InputError, match="another run"):
            TraceWriter(tmp_path / "a.mcap", run={"n": "2"})
        writer.finish({})
    assert rows_of(tmp_path / "a.mcap") == [1.0]
    TraceWriter(tmp_path / "a.mcap", run={}).close()
    TraceWriter(tmp_path / "a.mcap", run={}).close()


class Full:
    """A disk with room for so many bytes: the last write gets as far as it goes."""

    def __init__(self, raw: Any, room: int) -> None:
        self._raw, self._room = raw, room

    def __getattr__(self, name: str) -> Any:
        return getattr(self._raw, name)

    def write(self, data: memoryview) -> int:
        """Write what there is room for."""
        if self._room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        done: int = self._raw.write(data[: self._room])
        self._room -= done
        return done


@pytest.mark.parametrize("room", range(0, 6000, 211))
def test_full_disk_leaves_whole_records(tmp_path: Path, room: int) -> None:
    """A clear error, then a file of whole records."""
    writer = TraceWriter(tmp_path / "a.mcap", run={"k": "v"}, chunk_bytes=500, compression="none")
    writer._file._raw = Full(writer._file._raw, room)  # type: ignore[assignment]
    with pytest.raises(LossError, match="No space left") as caught:
        fill(writer)
    assert "recover" in str(caught.value)
    with pytest.raises(InputError, match="closed"):
        writer.flush()
    writer.close()
    trace = Trace(writer.partial_path)
    assert trace.run == {"k": "v"}
    assert trace.damage is not None
    assert "ends after" in trace.damage  # between two records, not within one
    found = rows_of(writer.partial_path)
    assert found == list(range(len(found)))
    assert len(found) * 40 <= room


def test_full_disk_during_a_flush_is_reported_at_the_next_use(tmp_path: Path) -> None:
    """A failure in the background is reported at the next use."""
    writer = TraceWriter(tmp_path / "a.mcap", run={}, flush_interval_s=0.02)
    topic = writer.add_topic("/x", X, schema_name="t.X")
    writer._file._raw = Full(writer._file._raw, 30)  # type: ignore[assignment]
    writer.write(topic, 0, [0.0])
    while writer._guard.open:
        time.sleep(0.01)
    with pytest.raises(LossError, match="No space left"):
        writer.finish({})
    assert writer.partial_path.exists()


class Struck(BaseException):
    """An interruption raised at any write."""


@pytest.mark.parametrize("strike", range(1, 60))
def test_interruption_leaves_a_consistent_file(
    tmp_path: Path, strike: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between any two writes: what is there reads, in order, and no summary says otherwise."""
    writer = TraceWriter(tmp_path / "a.mcap", run={"k": "v"}, chunk_bytes=400)
    left = [strike]
    write = writer._file.write

    def strikes(data: Any) -> int:
        left[0] -= 1
        if left[0] == 0:
            raise Struck
        done = write(data)
        left[0] -= 1
        if left[0] == 0:
            raise Struck
        return done

    monkeypatch.setattr(writer._file, "write", strikes)
    with pytest.raises(Struck), writer:
        fill(writer)
    found = rows_of(writer.partial_path)
    assert found == list(range(len(found)))
    trace = Trace(writer.partial_path)
    assert sum(info.count for info in trace.topics.values()) == len(found)
    if trace.complete:
        with writer.partial_path.open("rb") as stream:
            indexed = make_reader(stream, validate_crcs=True).iter_messages()
            assert len(list(indexed)) == len(found)


def chunks_of(path: Path) -> list[tuple[int, bytes]]:
    """Size before compression, and compressed data, of each chunk."""
    with path.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        return [(r.uncompressed_size, r.data) for r in records if isinstance(r, Chunk)]


def test_level_depends_on_the_chunks_alone(tmp_path: Path) -> None:
    """Whatever comes before it, a chunk has the same bytes."""
    draw = np.random.default_rng(1)
    noise = [draw.normal(size=(200, 20)) for _ in range(30)]
    plain = [(np.arange(4000.0) // 7).reshape(200, 20) for _ in range(30)]
    blocks = [*noise, *plain, *noise]

    def written(name: str, order: list[int]) -> dict[int, tuple[int, bytes]]:
        with TraceWriter(tmp_path / name, run={}, flush_interval_s=1e6) as writer:
            signals = [Signal(f"x[{i}]") for i in range(20)]
            topic = writer.add_topic("/x", signals, schema_name="t.X")
            # the first chunk has what is declared, too
            for block in (np.zeros((1, 20)), *(blocks[k] for k in order)):
                writer.write_rows([Rows(topic, np.arange(len(block)), block)])
                writer.flush()
            path = writer.finish({})
        return dict(zip(order, chunks_of(path)[1:], strict=True))

    single = written("a.mcap", [*range(90)])
    assert single[31][1] == single[32][1] != single[0][1] == single[60][1]
    assert len(single[31][1]) < 0.5 * len(single[0][1])
    for step in (2, 7, 89):
        order = sorted(range(len(blocks)), key=lambda k, step=step: k * step % len(blocks))
        assert written("b.mcap", order) == single
