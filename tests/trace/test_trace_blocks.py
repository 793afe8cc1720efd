"""Rows written thousands at a time: the same file as one by one, and every reader takes it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cosim.core import InputError
from cosim.trace import Poses, Rows, Signal, TraceWriter
from cosim.trace.file.stream import McapStream
from cosim.trace.rows.encode import RowEncoder
from cosim.trace.rows.foxglove import encoded, message_type
from cosim.trace.rows.layout import file_descriptor, message_class
from cosim.trace.rows.poses import pose_messages, transform_messages

MIXED = [
    Signal("n", kind="int"),
    Signal("on", kind="bool"),
    Signal("x"),
    Signal("s", kind="string"),
]


def messages(path: Path) -> list[tuple[Any, ...]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [
            (channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
            for _, channel, m in reader.iter_messages(log_time_order=False)
        ]


def two_topics(writer: TraceWriter) -> tuple[int, int]:
    a = writer.add_topic("/a", [Signal(f"x[{i}]") for i in range(20)], schema_name="t.A")
    return a, writer.add_topic("/b", MIXED, schema_name="t.B")


@pytest.mark.parametrize("chunk", [64, 3000, 262144])
@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_blocks_write_the_file_that_single_rows_write(
    tmp_path: Path, chunk: int, compression: str
) -> None:
    draw = np.random.default_rng(1)
    times = np.sort(draw.integers(0, 10**10, 500))
    values = draw.normal(size=(500, 20))
    values[3, 4] = np.nan
    late = times[::3] + 5
    mixed = [
        [int(i), bool(i % 2), None if i % 5 == 0 else i / 7, "x" * (i % 9)]
        for i in range(late.size)
    ]
    one, many = tmp_path / "one.mcap", tmp_path / "many.mcap"
    by_size_alone: Any = {"chunk_bytes": chunk, "compression": compression, "flush_interval_s": 1e6}
    with TraceWriter(one, run={}, **by_size_alone) as writer:
        a, b = two_topics(writer)
        events = [(t, 1, i) for i, t in enumerate(times.tolist())]
        events += [(t, 0, i) for i, t in enumerate(late.tolist())]
        for t, kind, i in sorted(events):
            if kind == 1:
                writer.write(a, t, values[i].tolist())
            else:
                writer.write(b, t, mixed[i], publish_time_ns=t - 5, sequence=i)
        writer.finish({})
    with TraceWriter(many, run={}, **by_size_alone) as writer:
        a, b = two_topics(writer)
        writer.write_rows(
            [
                Rows(a, times, values, rank=(1,)),
                Rows(b, late, mixed, late - 5, np.arange(late.size), rank=(0,)),
            ]
        )
        writer.finish({})
    assert messages(one) == messages(many)
    assert one.read_bytes() == many.read_bytes()


def test_stream_is_the_package_writers_byte_for_byte(tmp_path: Path) -> None:
    """The mcap package's own writer, given the same, is the reference; zstd is not asked."""
    draw = np.random.default_rng(2)
    sizes = draw.integers(0, 400, 300).tolist()
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    with ours.open("wb") as file:
        stream = McapStream(file, 4096, "none")
        stream.start("library")
        stream.metadata("first", {"k": "v"})
        stream.attachment("a.txt", "text/plain", b"text")
        channels = [
            stream.channel(f"/{i}", "raw", stream.schema(f"s{i}", "", b""), {}) for i in range(3)
        ]
        for i, size in enumerate(sizes):
            stream.message(channels[i % 3], i, i + 1, i, bytes(size))
        stream.flush()
        stream.metadata("last", {})
        stream.finish()
    with theirs.open("wb") as file:
        writer = Writer(file, 4096, CompressionType.NONE, enable_data_crcs=True)
        writer.start("", "library")
        writer.add_metadata("first", {"k": "v"})
        writer.add_attachment(0, 0, "a.txt", "text/plain", b"text")
        channels = []
        for i in range(3):
            schema = writer.register_schema(f"s{i}", "", b"")
            channels.append(writer.register_channel(f"/{i}", "raw", schema, {}))
        for i, size in enumerate(sizes):
            writer.add_message(channels[i % 3], i, bytes(size), i + 1, i)
        writer.flush()
        writer.add_metadata("last", {})
        writer.finish()
    assert ours.read_bytes() == theirs.read_bytes()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 2**62),
            *[st.one_of(st.just(0.0), st.just(-0.0), st.floats(-1e9, 1e9))] * 4,
        ),
        min_size=1,
        max_size=20,
    )
)
def test_poses_are_byte_for_byte_what_protobuf_writes(rows: list[tuple[Any, ...]]) -> None:
    times = np.array([row[0] for row in rows], np.int64)
    values = np.array([row[1:] for row in rows])
    made: dict[int, bytes] = {}
    for mine, data in pose_messages("ned", times, values[:, :3], values[:, 3]):
        made |= {i: line.tobytes() for i, line in zip(mine.tolist(), data, strict=True)}
    for i, (t, x, y, z, psi) in enumerate(rows):
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(psi / 2), "w": math.cos(psi / 2)}
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": turn}
        fields = {"frame_id": "ned", "pose": pose}
        assert made[i] == encoded("foxglove.PoseInFrame", t, fields)
        assert message_type("foxglove.PoseInFrame").FromString(made[i]).pose.position.x == x


VALUES = {
    "int": st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(0, 300)),
    "bool": st.booleans(),
    "float": st.floats(width=64),
    "string": st.sampled_from(["", "lost", "overtaken", "ä" * 70]),
}


@given(
    rows=st.lists(st.tuples(*[VALUES[signal.kind] for signal in MIXED]), min_size=1, max_size=30),
    absent=st.booleans(),
)
def test_rows_of_every_kind_are_byte_for_byte_what_protobuf_writes(
    rows: list[tuple[Any, ...]], *, absent: bool
) -> None:
    """Integers, booleans and strings, laid out many at a time; also with a value absent."""
    files = FileDescriptorSet(file=[file_descriptor("t.M", MIXED)])
    message = message_class(files, "t.M")
    if absent:
        rows = [*rows, (None, True, None, "x")]
    made: dict[int, bytes] = {}
    for mine, lines in RowEncoder("/m", MIXED, message).many(rows, room=31):
        which = np.arange(len(rows))[mine]
        made |= {i: line[31:].tobytes() for i, line in zip(which.tolist(), lines, strict=True)}
    names = [signal.name for signal in MIXED]
    for i, row in enumerate(rows):
        filled = {n: v for n, v in zip(names, row, strict=True) if v is not None}
        assert made[i] == message(**filled).SerializeToString(deterministic=True)


def test_doubles_stand_for_integers_and_booleans(tmp_path: Path) -> None:
    """The master keeps all values as doubles; what is no integer or boolean is refused."""
    signals = [Signal("n", kind="int"), Signal("on", kind="bool"), Signal("x")]
    rows = np.array([[-5.0, 255.0, 0.1], [2.0**40, 0.0, -0.0], [0.0, 1.0, math.inf]])
    times = np.arange(3)
    one, many = tmp_path / "one.mcap", tmp_path / "many.mcap"
    with TraceWriter(one, run={}) as writer:
        topic = writer.add_topic("/m", signals, schema_name="t.M")
        for t, (n, on, x) in enumerate(rows.tolist()):
            writer.write(topic, t, [int(n), bool(on), x])
        writer.finish({})
    with TraceWriter(many, run={}) as writer:
        topic = writer.add_topic("/m", signals, schema_name="t.M")
        writer.write_rows([Rows(topic, times, rows)])
        for wrong in ([0.5, 1.0, 0.0], [1e300, 1.0, 0.0], [math.nan, 1.0, 0.0], [1.0, math.nan, 0]):
            with pytest.raises(InputError, match="wrong kind"):
                writer.write_rows([Rows(topic, times[:1], np.array([wrong]))])
        text = writer.add_topic("/s", [Signal("s", kind="string")], schema_name="t.S")
        with pytest.raises(InputError, match="string"):
            writer.write_rows([Rows(text, times, rows[:, :1])])
        writer.finish({})
    assert messages(one) == messages(many)


def test_caller_may_use_its_arrays_again(tmp_path: Path) -> None:
    times, values = np.arange(5), np.arange(5.0)[:, None]
    path = tmp_path / "run.mcap"
    with TraceWriter(path, run={}) as writer:
        topic = writer.add_topic("/x", [Signal("x")], schema_name="t.X")
        writer.write_rows([Rows(topic, times, values)])
        times += 100
        values[:] = 0
        writer.finish({})
    found = messages(path)
    assert [m[1] for m in found] == list(range(5))
    with path.open("rb") as stream:  # by the index
        (*_, last) = make_reader(stream, validate_crcs=True).iter_messages()
    assert (last[2].log_time, last[2].data[1:]) == (4, np.float64(4.0).tobytes())


def test_transforms_are_byte_for_byte_what_protobuf_writes() -> None:
    times = np.array([0, 7, 10**9, 2 * 10**9 + 5], np.int64)
    values = np.array([[0.0, -0.0, 3.0, 0.0], [1.0, 2.0, 0.0, 0.5], [0] * 4, [1.0, 2.0, 3.0, 4]])
    made: dict[int, bytes] = {}
    for mine, data in transform_messages(("ned", "auv"), times, values[:, :3], values[:, 3]):
        made |= {i: line.tobytes() for i, line in zip(mine.tolist(), data, strict=True)}
    for i, (t, (x, y, z, psi)) in enumerate(zip(times.tolist(), values.tolist(), strict=True)):
        fields = {
            "parent_frame_id": "ned",
            "child_frame_id": "auv",
            "translation": {"x": x, "y": y, "z": z},
            "rotation": {"x": 0.0, "y": 0.0, "z": math.sin(psi / 2), "w": math.cos(psi / 2)},
        }
        assert made[i] == encoded("foxglove.FrameTransform", t, fields)


def test_frame_comes_before_the_first_pose(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with TraceWriter(path, run={}) as writer:
        times = np.array([5, 7], np.int64)
        writer.write_rows([Poses(times, np.zeros((2, 4)), rank=(1,))])
        writer.pose(9, 1.0, 2.0, 3.0, 0.1)
        writer.finish({})
    assert [m[:2] for m in messages(path)] == [
        ("/tf_static", 5),
        ("/auv/hull", 5),
        ("/auv/pose", 5),
        ("/tf", 5),
        ("/auv/pose", 7),
        ("/auv/pose", 9),
        ("/auv/path", 9),
    ]


@pytest.mark.parametrize(
    "part",
    [
        Rows(99, np.array([1]), np.zeros((1, 20))),
        Rows(1, np.array([-1]), np.zeros((1, 20))),
        Rows(1, np.array([1]), np.zeros((1, 20)), np.array([1]), np.array([2**32])),
        Rows(1, np.array([1]), np.zeros((1, 19))),
        Rows(1, np.array([1, 2]), np.zeros((1, 20))),
    ],
    ids=["unknown topic", "negative time", "sequence", "too few signals", "too few rows"],
)
def test_bad_rows_are_refused_and_spoil_nothing(tmp_path: Path, part: Rows) -> None:
    path = tmp_path / "run.mcap"
    with TraceWriter(path, run={}) as writer:
        a, _ = two_topics(writer)
        writer.write(a, 1, [0.0] * 20)
        with pytest.raises(InputError):
            writer.write_rows([part])
        writer.finish({})
    assert len(messages(path)) == 1
