"""Rows written thousands at a time: the same file as one by one, and every reader takes it."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, McapRecord, Schema
from mcap.writer import CompressionType, Writer
from mcap_files import payloads_of, schemas_of, type_of

from cosim.core import InputError
from cosim.trace import Attachment, Poses, Rows, Signal, TraceWriter

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


class EarlyWriter(Writer):
    """The package's writer, with what is declared in front of the chunks too, as in a trace.

    So a damaged chunk loses no channel that later ones use.
    """

    def early(self, record: McapRecord) -> None:
        """Write a record outside chunks."""
        record.write(self._Writer__record_builder)  # type: ignore[attr-defined]
        self._Writer__flush()  # type: ignore[attr-defined]


@pytest.mark.parametrize("chunk", [64, 4096])
def test_a_trace_is_the_package_writers_byte_for_byte(tmp_path: Path, chunk: int) -> None:
    """The mcap package's own writer, given the same, is the reference; zstd is not asked."""
    sizes = np.random.default_rng(2).integers(0, 400, 300).tolist()
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    by_size_alone: Any = {"chunk_bytes": chunk, "compression": "none", "flush_interval_s": 1e6}
    attached = [Attachment("a.txt", "text/plain", b"text")]
    with TraceWriter(ours, run={"k": "v"}, attachments=attached, **by_size_alone) as tracer:
        topics = [
            tracer.add_topic(f"/{i}", [Signal("s", kind="string")], schema_name=f"t.S{i}")
            for i in range(3)
        ]
        for i, size in enumerate(sizes):
            tracer.write(topics[i % 3], i, ["x" * size], publish_time_ns=i + 1, sequence=i)
        tracer.finish({"l": "w"})
    with ours.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    payloads = [payloads_of(ours, f"/{i}") for i in range(3)]
    with theirs.open("wb") as file:
        writer = EarlyWriter(file, chunk, CompressionType.NONE, enable_data_crcs=True)
        writer.start("", "auv-cosim")
        writer.add_metadata("cosim.run", {"k": "v", "row_format": "2"})
        writer.add_attachment(0, 0, "a.txt", "text/plain", b"text")
        for i in range(3):
            schema, described = schemas_of(ours)[f"/{i}"], summary.channels[i + 1].metadata
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            writer.early(Schema(number, schema.data, schema.encoding, schema.name))
            channel = writer.register_channel(f"/{i}", "protobuf", number, described)
            writer.early(Channel(channel, f"/{i}", "protobuf", described, number))
        for i in range(len(sizes)):
            writer.add_message(i % 3 + 1, i, payloads[i % 3][i // 3], i + 1, i)
        writer.flush()
        writer.add_metadata("cosim.result", {"l": "w"})
        writer.finish()
    assert ours.read_bytes() == theirs.read_bytes()


def encoded(message: Any, time_ns: int, fields: dict[str, Any]) -> bytes:
    """A message of this class with these fields and this stamp, as protobuf writes it."""
    at = {"seconds": time_ns // 10**9, "nanos": time_ns % 10**9}
    data: bytes = message(timestamp=at, **fields).SerializeToString(deterministic=True)
    return data


def again(message: Any, payload: bytes) -> bytes:
    """What protobuf reads, as it writes it."""
    data: bytes = message.FromString(payload).SerializeToString(deterministic=True)
    return data


def turned(psi: float) -> dict[str, float]:
    """The quaternion of a heading [rad]."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(psi / 2), "w": math.cos(psi / 2)}


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 2**62),
            *[st.one_of(st.just(0.0), st.just(-0.0), st.floats(-1e9, 1e9))] * 4,
        ),
        min_size=1,
        max_size=20,
        unique_by=lambda row: row[0],
    )
)
def test_poses_are_what_protobuf_reads(rows: list[tuple[Any, ...]]) -> None:
    """Of one width, whatever the numbers: protobuf writes what it reads back as it would."""
    rows.sort(key=lambda row: row[0])
    values = np.array([row[1:] for row in rows])
    with TemporaryDirectory() as folder:
        with TraceWriter(Path(folder, "a.mcap"), run={}) as writer:
            writer.write_rows([Poses(np.array([row[0] for row in rows], np.int64), values)])
            path = writer.finish({})
        found, message = payloads_of(path, "/auv/pose"), type_of(path, "/auv/pose")
        expected = [
            encoded(
                message,
                t,
                {
                    "frame_id": "ned",
                    "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": turned(psi)},
                },
            )
            for t, x, y, z, psi in rows
        ]
    assert len({len(payload) for payload in found}) == 1
    assert [again(message, payload) for payload in found] == expected


VALUES = {
    "int": st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(0, 300)),
    "bool": st.booleans(),
    "float": st.floats(width=64),
    "string": st.sampled_from(["", "lost", "overtaken", "ä" * 70]),
}


@settings(deadline=None)
@given(
    rows=st.lists(st.tuples(*[VALUES[signal.kind] for signal in MIXED]), min_size=1, max_size=30),
    absent=st.booleans(),
)
def test_rows_of_every_kind_are_byte_for_byte_what_protobuf_writes(
    rows: list[tuple[Any, ...]], *, absent: bool
) -> None:
    """Integers, booleans and strings, laid out many at a time; also with a value absent."""
    if absent:
        rows = [*rows, (None, True, None, "x")]
    with TemporaryDirectory() as folder:
        with TraceWriter(Path(folder, "a.mcap"), run={}) as writer:
            topic = writer.add_topic("/m", MIXED, schema_name="t.M")
            writer.write_rows([Rows(topic, np.arange(len(rows)), rows)])
            path = writer.finish({})
        found, message = payloads_of(path, "/m"), type_of(path, "/m")
    names = [signal.name for signal in MIXED]
    for payload, row in zip(found, rows, strict=True):
        filled = {n: v for n, v in zip(names, row, strict=True) if v is not None}
        assert payload == message(**filled).SerializeToString(deterministic=True)


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


def test_transforms_are_what_protobuf_reads(tmp_path: Path) -> None:
    """Of the first pose in each tenth of a second."""
    times = np.array([0, 10**8 + 7, 10**9, 10**9 + 1, 2 * 10**9 + 5], np.int64)
    values = np.array(
        [[0.0, -0.0, 3.0, 0.0], [1.0, 2.0, 0.0, 0.5], [0] * 4, [9.0] * 4, [1.0, 2.0, 3.0, 4]]
    )
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        writer.write_rows([Poses(times, values)])
        path = writer.finish({})
    rows = [(t, row) for t, row in zip(times.tolist(), values.tolist(), strict=True)]
    message = type_of(path, "/tf")
    assert [again(message, payload) for payload in payloads_of(path, "/tf")] == [
        encoded(
            message,
            t,
            {
                "parent_frame_id": "ned",
                "child_frame_id": "auv",
                "translation": {"x": x, "y": y, "z": z},
                "rotation": turned(psi),
            },
        )
        for t, (x, y, z, psi) in rows
        if t != 10**9 + 1
    ]


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
