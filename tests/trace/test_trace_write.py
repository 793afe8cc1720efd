"""What is written, as the official MCAP reader and protobuf decoder see it."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader
from mcap_files import payloads_of, type_of
from mcap_protobuf.decoder import DecoderFactory
from network.fates import entries

from cosim.core import InputError
from cosim.network import Jitter, PacketLink, deliver
from cosim.trace import Attachment, Signal, Trace, TraceWriter
from cosim.trace.rows import DROPPED_SIGNALS, dropped_topic, link_topic

ETA = [
    Signal("eta.x", 1, "m", hold="continuous", description="north"),
    Signal("eta.psi", 4, "rad"),
]


def decoded(path: Path) -> list[tuple[Any, ...]]:
    """Every message by the official tools: schema, channel, message, protobuf message."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (m.schema, m.channel, m.message, m.decoded_message)
            for m in reader.iter_decoded_messages(log_time_order=False)
        ]


def test_official_reader_sees_what_was_written(tmp_path: Path) -> None:
    """Doubles, ints, bools, strings and absent values come back without our code."""
    mixed = [
        Signal("gain", 7, "N"),
        Signal("count", 8, kind="int"),
        Signal("on", 9, kind="bool"),
        Signal("mode", 10, kind="string"),
    ]
    rows = [
        [1.5, -3, True, "Fahrt"],
        [0.0, 0, False, ""],
        [None, 2**63 - 1, None, "x"],
        [np.float64("nan"), np.int32(4), np.bool_(1), None],
        [None, None, None, None],
    ]
    with TraceWriter(tmp_path / "a.mcap", run={"seed": "1"}) as writer:
        eta = writer.add_topic("/plant/output", ETA, schema_name="cosim.plant.Output")
        other = writer.add_topic(
            "/controller/input", mixed, schema_name="cosim.controller.Input", metadata={"k": "v"}
        )
        for k, row in enumerate(rows):
            writer.write(eta, 10 * k, [0.1 * k, -0.0], sequence=k)
            writer.write(other, 10 * k, row, publish_time_ns=max(0, 10 * k - 5), sequence=100 + k)
        assert writer.finish({"state": "done"}) == tmp_path / "a.mcap"
    assert not (tmp_path / "a.mcap.partial").exists()

    messages = decoded(tmp_path / "a.mcap")
    ours = [m for m in messages if m[1].topic == "/plant/output"]
    assert [m[3].eta_x for m in ours] == [0.1 * k for k in range(5)]
    assert all(math.copysign(1, m[3].eta_psi) == -1 for m in ours)
    assert [(m[2].log_time, m[2].publish_time, m[2].sequence) for m in ours] == [
        (10 * k, 10 * k, k) for k in range(5)
    ]
    theirs = [m for m in messages if m[1].topic == "/controller/input"]
    for (schema, channel, message, row), expected, k in zip(theirs, rows, range(5), strict=True):
        assert (schema.name, schema.encoding) == ("cosim.controller.Input", "protobuf")
        assert (channel.message_encoding, channel.metadata["k"]) == ("protobuf", "v")
        assert (message.publish_time, message.sequence) == (max(0, 10 * k - 5), 100 + k)
        for signal, value in zip(mixed, expected, strict=True):
            assert row.HasField(signal.name) == (value is not None)
            if value is not None and value == value:  # noqa: PLR0124 - NaN is not itself
                assert getattr(row, signal.name) == value
    assert math.isnan(theirs[3][3].gain)


def test_layout_of_the_file(tmp_path: Path) -> None:
    """Metadata and attachments are where the design says, channel metadata as it says."""
    scenario = Attachment("scenario.toml", "application/toml", b"end = 1\n")
    writer = TraceWriter(tmp_path / "a.mcap", run={"b": "2", "a": "1"}, attachments=[scenario])
    topic = writer.add_topic("/plant/output", ETA, schema_name="cosim.plant.Output")
    writer.write(topic, 0, [1.0, 2.0])
    writer.finish({"link.sc.sent": "3"})
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        metadata = list(reader.iter_metadata())
        (attachment,) = reader.iter_attachments()
        summary = reader.get_summary()
    assert [(m.name, m.metadata) for m in metadata] == [
        ("cosim.run", {"a": "1", "b": "2", "row_format": "2"}),
        ("cosim.result", {"link.sc.sent": "3"}),
    ]
    assert (attachment.name, attachment.media_type, attachment.data) == (
        "scenario.toml",
        "application/toml",
        b"end = 1\n",
    )
    assert summary is not None
    starts = {index.name: index.offset for index in summary.metadata_indexes}
    chunks = [index.chunk_start_offset for index in summary.chunk_indexes]
    assert starts["cosim.run"] < min(chunks)
    assert starts["cosim.result"] > max(chunks)
    assert all(index.compression == "zstd" for index in summary.chunk_indexes)
    (channel,) = summary.channels.values()
    assert channel.metadata == {
        "eta_x.name": "eta.x",
        "eta_x.vr": "1",
        "eta_x.unit": "m",
        "eta_x.hold": "continuous",
        "eta_x.description": "north",
        "eta_psi.name": "eta.psi",
        "eta_psi.vr": "4",
        "eta_psi.unit": "rad",
        "eta_psi.hold": "discrete",
    }


def test_links_in_the_trace(tmp_path: Path) -> None:
    """On a link publish time is that of sending, before log time; what is dropped says why."""
    link = PacketLink("sc", 10, delay_ns=3, jitter=Jitter("uniform", width_ns=40), loss=0.2)
    d = deliver(link, 1000)
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        data = writer.add_topic(link_topic("sc"), ETA, schema_name="cosim.link.Data")
        dropped = writer.add_dropped_topic("sc")
        for at, sent, k, fate in entries(d):
            times = {"publish_time_ns": sent, "sequence": k}
            if fate == "delivered":
                writer.write(data, at, [float(k), 0.0], **times)
            else:
                writer.write(dropped, at, [fate], **times)
        writer.finish({})
    messages = decoded(tmp_path / "a.mcap")
    assert {m[1].topic for m in messages} == {"/link/sc", "/link/sc/dropped"}
    assert all(m[2].publish_time + 3 <= m[2].log_time for m in messages)
    log = [m[2].log_time for m in messages]
    assert log == sorted(log)
    reasons = [m[3].reason for m in messages if m[1].topic == dropped_topic("sc")]
    figures = d.statistics(1000)
    assert figures["lost"] == reasons.count("lost") > 0
    assert figures["overtaken"] == reasons.count("overtaken") > 0
    assert DROPPED_SIGNALS[0].name == "reason"


def test_log_and_pose(tmp_path: Path) -> None:
    """Log and pose are Foxglove messages; `/tf_static` turns down into down for a z-up view."""
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        writer.log(1_500_000_000, "warning", "link sc", "burst")
        writer.pose(2_000_000_001, 1.0, 2.0, 3.0, 0.5)
        writer.pose(3_000_000_001, 1.0, 2.0, 3.0, 0.5)
        writer.finish({})
    messages = decoded(tmp_path / "a.mcap")
    assert [(m[1].topic, m[0].name) for m in messages] == [
        ("/log", "foxglove.Log"),
        ("/tf_static", "foxglove.FrameTransform"),
        ("/auv/hull", "foxglove.SceneUpdate"),
        ("/auv/pose", "foxglove.PoseInFrame"),
        ("/tf", "foxglove.FrameTransform"),
        ("/auv/pose", "foxglove.PoseInFrame"),
        ("/tf", "foxglove.FrameTransform"),
        ("/auv/path", "foxglove.SceneUpdate"),
    ]
    log, transform, pose = messages[0][3], messages[1][3], messages[3][3]
    assert (log.level, log.name, log.message) == (3, "link sc", "burst")
    assert (log.timestamp.seconds, log.timestamp.nanos) == (1, 500_000_000)
    assert (pose.timestamp.seconds, pose.timestamp.nanos) == (2, 1)
    position = pose.pose.position
    assert (pose.frame_id, position.x, position.y, position.z) == ("ned", 1.0, 2.0, 3.0)
    q = pose.pose.orientation
    assert (q.x, q.y) == (0.0, 0.0)
    assert 2 * math.atan2(q.z, q.w) == pytest.approx(0.5, rel=1e-15)
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "ned")
    r = transform.rotation
    north, east, down = (rotate((r.x, r.y, r.z, r.w), v) for v in np.eye(3))
    assert north == pytest.approx([0, 1, 0], abs=1e-15)
    assert east == pytest.approx([1, 0, 0], abs=1e-15)
    assert down == pytest.approx([0, 0, -1], abs=1e-15)


def rotate(q: tuple[float, float, float, float], v: np.ndarray) -> np.ndarray:
    """Vector v turned by the unit quaternion (x, y, z, w)."""
    axis, w = np.array(q[:3]), q[3]
    return v + 2 * w * np.cross(axis, v) + 2 * np.cross(axis, np.cross(axis, v))


@settings(deadline=None)
@given(
    st.lists(
        st.lists(st.one_of(st.none(), st.floats(width=64)), min_size=20, max_size=20), max_size=8
    )
)
def test_fast_rows_are_protobuf(rows: list[list[float | None]]) -> None:
    """The struct encoding is what protobuf's own serializer gives, and decodes to the bit.

    Twenty fields: tags of one byte and of two.
    """
    signals = [Signal(f"K[1,{i}]") for i in range(20)]
    with TemporaryDirectory() as folder:
        with TraceWriter(Path(folder, "a.mcap"), run={}) as writer:
            topic = writer.add_topic("/t", signals, schema_name="cosim.T")
            for k, row in enumerate(rows):
                writer.write(topic, k, row)
            path = writer.finish({})
        payloads, message = payloads_of(path, "/t"), type_of(path, "/t")
        columns = Trace(path).read("/t")
    for row, payload in zip(rows, payloads, strict=True):
        theirs = message(**{f"K_1_{i}": v for i, v in enumerate(row) if v is not None})
        assert payload == theirs.SerializeToString(deterministic=True)
    for i, signal in enumerate(signals):
        assert columns.present[signal.name].tolist() == [row[i] is not None for row in rows]
        expected = np.array([math.nan if row[i] is None else row[i] for row in rows], np.float64)
        both_nan = np.isnan(expected) & np.isnan(columns[signal.name])
        same = columns[signal.name].view(np.int64) == expected.view(np.int64)
        assert (same | both_nan).all()


def test_writer_refuses_invalid_calls(tmp_path: Path) -> None:
    """Wrong counts, kinds, times, topics and late calls are refused with a message."""
    writer = TraceWriter(tmp_path / "a.mcap", run={})
    eta = writer.add_topic("/eta", ETA, schema_name="cosim.E")
    kinds = writer.add_topic(
        "/kinds", [Signal("n", kind="int"), Signal("s", kind="string")], schema_name="cosim.K"
    )
    refused: list[tuple[Any, str]] = [
        (lambda: writer.write(eta, 0, [1.0]), "number of values"),
        (lambda: writer.write(eta, 0, [1.0, "x"]), "eta.psi"),
        (lambda: writer.write(kinds, 0, [2.7, "x"]), "signal 'n'"),
        (lambda: writer.write(kinds, 0, [2**63, "x"]), "signal 'n'"),
        (lambda: writer.write(kinds, 0, [1, 5]), "signal 's'"),
        (lambda: writer.write(eta, -1, [1.0, 2.0]), "out of range"),
        (lambda: writer.write(eta, 0.5, [1.0, 2.0]), "integers"),  # type: ignore[arg-type]
        (lambda: writer.write(eta, 0, [1.0, 2.0], sequence=2**32), "out of range"),
        (lambda: writer.write(99, 0, [1.0, 2.0]), "unknown topic"),
        (lambda: writer.add_topic("/eta", ETA, schema_name="cosim.E"), "twice"),
        (lambda: writer.add_topic("eta", ETA, schema_name="cosim.E"), "not a topic"),
        (lambda: writer.log(0, "loud", "a", "b"), "level"),
        (lambda: writer.finish({"n": 1}), "text"),  # type: ignore[dict-item]
    ]
    for call, word in refused:
        with pytest.raises(InputError, match=word):
            call()
    writer.write(eta, 0, [1, np.float32(2)])
    writer.finish({})
    assert len(Trace(tmp_path / "a.mcap").read("/eta")) == 1
    with pytest.raises(InputError, match="closed"):
        writer.write(eta, 0, [1.0, 2.0])
    with pytest.raises(InputError, match="closed"):
        writer.finish({})
    writer.close()


def test_topic_with_more_signals_than_protobuf_has_room_for_is_refused(tmp_path: Path) -> None:
    """By its name and their number."""
    signals = [Signal(f"x[{i}]") for i in range(9000)]
    with (
        TraceWriter(tmp_path / "a.mcap", run={}) as writer,
        pytest.raises(InputError, match=r"/plant/output: .* no room(.|\n)*got: 9000"),
    ):
        writer.add_topic("/plant/output", signals, schema_name="cosim.plant.Output")


def test_path_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    """A file in place of a folder, a directory and an unknown compression are bad input."""
    (tmp_path / "d.mcap").mkdir()
    (tmp_path / "no").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be created"):
        TraceWriter(tmp_path / "no" / "a.mcap", run={})
    with pytest.raises(InputError, match="a folder"):
        TraceWriter(tmp_path / "d.mcap", run={})
    with pytest.raises(InputError, match="compression"):
        TraceWriter(tmp_path / "a.mcap", run={}, compression="rar")
    with pytest.raises(InputError, match="text"):
        TraceWriter(tmp_path / "a.mcap", run={"step": 3})  # type: ignore[dict-item]


FULL = """
import resource, sys
from cosim.core.errors import LossError
from cosim.trace import Signal, TraceWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
try:
    with TraceWriter(sys.argv[1], run={}, compression="none", chunk_bytes=1000) as writer:
        topic = writer.add_topic("/eta", [Signal("x")], schema_name="cosim.E")
        for k in range(100_000):
            writer.write(topic, k, [k])
except LossError as error:
    print(error)
"""


def on_a_disk_with(room: int, path: Path) -> str:
    """What a run says whose file can grow no further, once."""
    command = [sys.executable, "-c", FULL, str(path), str(room)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    done = subprocess.run(  # noqa: S603 - our own script
        command, check=True, capture_output=True, text=True, env=environment
    )
    assert not done.stderr
    return done.stdout


def test_disk_failure_at_the_first_record_says_so(tmp_path: Path) -> None:
    assert on_a_disk_with(5, tmp_path / "a.mcap").count("File too large") == 1


def test_disk_failure_keeps_the_rows_before(tmp_path: Path) -> None:
    """When the file can grow no further, the error says so and the rows before are readable."""
    assert "File too large" in on_a_disk_with(20_000, tmp_path / "a.mcap")
    x = Trace(tmp_path / "a.mcap.partial").read("/eta")["x"]
    assert x.tolist() == list(range(x.size))
    assert x.size > 200
