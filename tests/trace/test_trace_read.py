"""Reading: content, interruption, other tools' files."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, Writer
from mcap_files import write_protobuf
from rich.console import Console
from written import ETA, write

from cosim.core import InputError, LossError
from cosim.trace import (
    Attachment,
    Poses,
    Rows,
    Signal,
    Trace,
    TraceWriter,
    content_hash,
    describe,
    render,
)
from cosim.trace.rows import result_of_link


def test_read_back(tmp_path: Path) -> None:
    """Run, result, attachments, topics and columns are what was written."""
    path = write(
        tmp_path / "a.mcap", attachments=[Attachment("s.toml", "application/toml", b"\x00\xff")]
    )
    trace = Trace(path)
    assert trace.run == {"seed": "1"}
    assert trace.result == {"state": "done"}
    assert (trace.finished, trace.complete, trace.damage) == (True, True, None)
    assert trace.attachments == {"s.toml": b"\x00\xff"}
    info = trace.topics["/plant/output"]
    assert (info.count, info.start_ns, info.end_ns) == (2000, 0, 19_990)
    assert list(info.signals) == ETA
    table = trace.read("/plant/output")
    assert table["eta.x"].tolist() == [0.5 * k for k in range(2000)]
    assert table["eta.psi"].tolist() == [-k for k in range(2000)]
    assert (
        table.log_time_ns.tolist() == table.publish_time_ns.tolist() == list(range(0, 20_000, 10))
    )
    assert table.sequence.tolist() == list(range(2000))
    assert all(column.all() for column in table.present.values())
    with pytest.raises(InputError, match=r"eta\.y"):
        table["eta.y"]
    with pytest.raises(InputError, match="/plant/input"):
        trace.read("/plant/input")


def test_kinds_and_absent_values(tmp_path: Path) -> None:
    """Columns have their kind; an absent value is marked and reads NaN, 0, False or nothing."""
    signals = [Signal(kind, kind=kind) for kind in ("float", "int", "bool", "string")]
    values = [[0.0, -(2**63), True, "é"], [None] * 4, [1.0, 5, False, ""]]
    path = write(
        tmp_path / "a.mcap", signals=signals, rows=[(k, k, k, v) for k, v in enumerate(values)]
    )
    table = Trace(path).read("/plant/output")
    assert all(present.tolist() == [True, False, True] for present in table.present.values())
    assert np.array_equal(table["float"], [0.0, np.nan, 1.0], equal_nan=True)
    assert table["int"].tolist() == [-(2**63), 0, 5]
    assert table["bool"].tolist() == [True, False, False]
    assert table["string"].tolist() == ["é", "", ""]
    assert [s.kind for s in Trace(path).topics["/plant/output"].signals] == [
        s.kind for s in signals
    ]


def test_content_hash_ignores_storage_and_host(tmp_path: Path) -> None:
    """Compression, chunk size, flushing, attachments and metadata leave the hash alone."""
    hashes = {
        content_hash(path)
        for path in (
            write(tmp_path / "a.mcap"),
            write(tmp_path / "b.mcap", compression="lz4", chunk_bytes=1000),
            write(tmp_path / "c.mcap", compression="none", flush_interval_s=0.0),
            write(tmp_path / "d.mcap", run={"seed": "1", "host.name": "x", "host.time": "now"}),
            write(tmp_path / "e.mcap", result={"state": "done", "host.wall_s": "3.5"}),
            write(tmp_path / "f.mcap", attachments=[Attachment("a", "text/plain", b"a")]),
            write(tmp_path / "g.mcap", run={"seed": "2", "step": "2"}),
            write(tmp_path / "h.mcap", result={"state": "diverged"}),
        )
    }
    assert len(hashes) == 1
    assert len(hashes.pop()) == 64


def test_content_hash_ignores_ids(tmp_path: Path) -> None:
    """Channel and schema ids do not matter: an unused topic before the used one shifts both."""
    hashes = set()
    for name, extra in (("a", 0), ("b", 3)):
        with TraceWriter(tmp_path / f"{name}.mcap", run={}) as writer:
            for k in range(extra):
                writer.add_topic(f"/unused/{k}", ETA, schema_name="cosim.U")
            topic = writer.add_topic("/eta", ETA, schema_name="cosim.E")
            writer.write(topic, 5, [1.0, 2.0])
            hashes.add(content_hash(writer.finish({})))
    assert len(hashes) == 1


def test_content_hash_leaves_out_what_is_computed_from_the_run(tmp_path: Path) -> None:
    """Log lines and poses between the rows do not matter, nor comments of a schema."""
    hashes = set()
    for name in ("a", "b"):
        with TraceWriter(tmp_path / f"{name}.mcap", run={}) as writer:
            topic = writer.add_topic("/eta", ETA, schema_name="cosim.E")
            writer.write(topic, 5, [1.0, 2.0])
            if name == "b":
                writer.log(6, "info", "plant", "said in between")
                poses = Poses(np.array([7]), np.array([[1.0, 2.0, 3.0, 0.5]]), rank=(0,))
                writer.write_rows([poses])
            writer.write(topic, 8, [1.0, 2.0])
            hashes.add(content_hash(writer.finish({})))
    assert len(hashes) == 1
    described = FileDescriptorSet()
    described.file.add(name="e.proto", package="e").message_type.add(name="E")
    plain = described.SerializeToString()
    described.file[0].source_code_info.location.add(leading_comments="what e is")
    commented = described.SerializeToString()
    described.file[0].message_type.add(name="F")
    one, two, other = (
        content_hash(write_protobuf(tmp_path / "e.mcap", "/e", schema, "e.E", [b""]))
        for schema in (plain, commented, described.SerializeToString())
    )
    assert one == two != other


def test_content_hash_sees_every_change(tmp_path: Path) -> None:
    """Any change of a value, time, order, topic or unit changes the hash."""
    row = (10, 5, 1, [1.0, 2.0])
    changes: list[dict[str, Any]] = [
        {},
        {"rows": [(10, 5, 1, [1.0, np.nextafter(2.0, 3.0)])]},
        {"rows": [(10, 5, 1, [1.0, None])]},
        {"rows": [(11, 5, 1, [1.0, 2.0])]},
        {"rows": [(10, 6, 1, [1.0, 2.0])]},
        {"rows": [(10, 5, 2, [1.0, 2.0])]},
        {"rows": [row, row]},
        {"rows": []},
        {"rows": [row, (20, 5, 1, [0.0, 0.0])]},
        {"rows": [(20, 5, 1, [0.0, 0.0]), row]},
        {"topic": "/plant/input"},
        {"signals": [Signal("eta.x", 1, "km"), ETA[1]]},
        {"signals": [Signal("eta.x", 1, "m"), Signal("eta.y", 4, "rad")]},
    ]
    hashes = [
        content_hash(write(tmp_path / f"{k}.mcap", **({"rows": [row]} | change)))
        for k, change in enumerate(changes)
    ]
    assert len(set(hashes)) == len(changes)


def test_partial_after_an_exception(tmp_path: Path) -> None:
    """An exception leaves a whole `.partial` file with all rows and no result."""

    def run() -> None:
        with TraceWriter(tmp_path / "a.mcap", run={"seed": "1"}) as writer:
            topic = writer.add_topic("/eta", ETA, schema_name="cosim.E")
            for k in range(10):
                writer.write(topic, k, [k, 1 / (5 - k)])

    with pytest.raises(ZeroDivisionError):
        run()
    assert not (tmp_path / "a.mcap").exists()
    trace = Trace(tmp_path / "a.mcap.partial")
    assert (trace.finished, trace.complete, trace.result) == (False, True, None)
    assert trace.run == {"seed": "1"}
    assert trace.read("/eta")["eta.x"].tolist() == [0, 1, 2, 3, 4]


KILLED = """
import os, signal, sys
from cosim.trace import Signal, TraceWriter
writer = TraceWriter(sys.argv[1], run={"seed": "1"}, flush_interval_s=1e9)
topic = writer.add_topic("/eta", [Signal("x")], schema_name="cosim.E")
for k in range(1000):
    writer.write(topic, k, [k])
    if k == 699:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_killed_process(tmp_path: Path) -> None:
    """After kill -9 the `.partial` file is readable up to the last flush."""
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-c", KILLED, str(path)]
    done = subprocess.run(command, check=False, env=_here())  # noqa: S603 - our own script
    assert done.returncode == -signal.SIGKILL
    partial = tmp_path / "a.mcap.partial"
    trace = Trace(partial)
    assert (trace.finished, trace.complete) == (False, False)
    assert trace.damage
    assert trace.read("/eta")["x"].tolist() == list(range(700))
    summary = describe(partial)
    assert (summary["finished"], summary["message_count"]) == (False, 700)
    with pytest.raises(LossError, match="cut short"):
        Trace(partial, incomplete=False)


def _here() -> dict[str, str]:
    root = str(Path(__file__).resolve().parents[2])
    return os.environ | {"PYTHONPATH": root}


def test_flushed_by_the_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row never waits longer than the interval while rows keep coming."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    writer = TraceWriter(tmp_path / "a.mcap", run={}, flush_interval_s=1.0)
    topic = writer.add_topic("/eta", ETA, schema_name="cosim.E")
    counts = []
    for k in range(30):
        now[0] = k / 10
        writer.write(topic, k, [k, k])
        info = Trace(writer.partial_path).topics.get("/eta")
        counts.append(info.count if info else 0)
    writer.close()
    assert all(k + 1 - count <= 10 for k, count in enumerate(counts))
    assert len(set(counts)) < 8  # and not a chunk for every row


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunking", [True, False])
def test_foreign_file(tmp_path: Path, compression: CompressionType, *, chunking: bool) -> None:
    """A file by another writer, JSON, two channels on a topic, is described as it is."""
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunking)
        writer.start(profile="ros2", library="other 1.0")
        schema = writer.register_schema("Thing", "jsonschema", b"{}")
        ids = [writer.register_channel("/thing", "json", schema) for _ in range(2)]
        raw = writer.register_channel("/raw", "", 0)
        for k in range(10):
            writer.add_message(ids[k % 2], 10**9 * (10 - k), b"{}", 5, k)
        writer.add_message(raw, 2**63 + 5, b"\x00", 0)
        writer.add_metadata("theirs", {"a": "b"})
        writer.finish()
    summary = describe(path, incomplete=False)
    json.dumps(summary, allow_nan=False)
    assert (summary["library"], summary["finished"], summary["run"]) == ("other 1.0", False, {})
    thing, other = summary["topics"]
    assert (thing["topic"], thing["schema"], thing["count"]) == ("/thing", "Thing", 10)
    assert (thing["start_ns"], thing["end_ns"], thing["rate_hz"]) == (10**9, 10**10, 1.0)
    assert (other["topic"], other["count"], other["rate_hz"]) == ("/raw", 1, None)
    assert len(Trace(path).read("/thing")) == 10
    with pytest.raises(InputError, match="protobuf"):
        Trace(path).read("/raw")


def test_describe_and_render(tmp_path: Path) -> None:
    """The summary has the facts, the links' figures apart, and people see them, brackets too."""
    figures = {"sent": 12, "delivered": 11, "mean_delay_s": 0.25, "max_age_s": None}
    path = write(
        tmp_path / "a.mcap",
        signals=[Signal("K[1,3]", 3, "N"), Signal("[bold]", 4)],
        run={"scenario": "station [red]", "[/red]": "x", "host.time": "\x1b[2J2024"},
        result={"state": "done", **result_of_link("sensor.sc", figures)},
    )
    summary = json.loads(json.dumps(describe(path), allow_nan=False))
    assert summary["links"] == {
        "sensor.sc": {"sent": "12", "delivered": "11", "mean_delay_s": "0.25"}
    }
    assert summary["result"] == {"state": "done"}
    assert summary["content_hash"] == content_hash(path)
    assert summary["topics"][0]["rate_hz"] == pytest.approx(1e8)
    assert summary["topics"][0]["signals"][0]["unit"] == "N"
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(render(summary))
    text = console.export_text()
    for word in ("finished", "K[1,3] [N]", "[bold]", "station [red]", "sensor.sc", "0.25", "2000"):
        assert word in text
    assert "\x1b" not in text


def test_content_hash_while_writing_is_that_of_the_file(tmp_path: Path) -> None:
    """Of topics that begin late, rows in blocks and one by one, chunks with several channels."""
    path = tmp_path / "run.mcap"
    with TraceWriter(path, run={}, chunk_bytes=2000, content_hash=True) as writer:
        first = writer.add_topic("/a", [Signal("x")], schema_name="a", metadata={"unit": "m"})
        for k in range(50):
            writer.write(first, 10 * k, [float(k)])
        second = writer.add_topic("/b", ETA, schema_name="b")
        for k in range(50, 300):
            writer.write(first, 10 * k, [float(k)])
            sent = {"publish_time_ns": 9 * k, "sequence": k}
            writer.write(second, 10 * k, [1.0 / k] * len(ETA), **sent)
        writer.log(2990, "info", "a", "not covered")
        times, late = np.arange(3000, 9000, 10), np.arange(3005, 6005, 10)
        values, poses = np.arange(600.0)[:, None], np.ones((600, 4))
        writer.write_rows([Rows(first, times, values)])
        parts = Rows(second, late, np.ones((300, len(ETA))), late - 3, np.arange(300))
        writer.write_rows([Rows(first, times + 6000, values), parts, Poses(times + 6000, poses)])
        writer.finish({})
    assert writer.content_hash == content_hash(path)
    with TraceWriter(tmp_path / "other.mcap", run={}) as other:
        other.finish({})
        with pytest.raises(ValueError, match="content_hash=True"):
            _ = other.content_hash
