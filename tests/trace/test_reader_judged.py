"""Whatever is read is what independent readers read: the mcap package, protobuf's own parser."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from content_hashes import former_hash, plain_hash
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto as F,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_files import write_protobuf
from mcap_protobuf.decoder import DecoderFactory

from cosim.core import InputError, LossError
from cosim.trace import Poses, Rows, Signal, Trace, TraceWriter, content_hash

MIXED = [
    Signal("n", kind="int", unit="1"),
    Signal("on", kind="bool"),
    Signal("x", unit="m"),
    Signal("s", kind="string"),
]


def recorded_run(path: Path, **options: Any) -> Path:
    """Four topics between each other: doubles, all kinds with gaps, poses, log lines."""
    draw = np.random.default_rng(5)
    with TraceWriter(path, run={"a": "b"}, chunk_bytes=5000, **options) as writer:
        doubles = writer.add_topic(
            "/a/output", [Signal(f"x[{i}]") for i in range(20)], schema_name="t.A"
        )
        mixed = writer.add_topic("/link/l", MIXED, schema_name="t.B")
        for turn in range(4):
            times = np.arange(150) * 10 + 1500 * turn
            rows = [
                [int(i) - 70, bool(i % 2), None if i % 5 == 0 else i / 7, "é\0" * (i % 4)]
                for i in range(150)
            ]
            parts = [
                Rows(doubles, times, draw.normal(size=(150, 20))),
                Rows(mixed, times + 3, rows, times, np.arange(150)),
                Poses(times, draw.normal(size=(150, 4))),
            ]
            writer.write_rows(parts)
            writer.log(int(times[-1]), "info", "master", f"turn {turn}")
        writer.finish({"status": "finished"})
    return path


def judged(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    """(log, publish, sequence, message) by topic, by the official reader and decoder."""
    found: dict[str, list[tuple[Any, ...]]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, m, row in reader.iter_decoded_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append(
                (m.log_time, m.publish_time, m.sequence, row)
            )
    return found


def inner(message: Any, path: str) -> Any:
    """Value of a dotted field; None where it, or what it lies in, is absent."""
    for name in path.split("."):
        if message.DESCRIPTOR.fields_by_name[name].has_presence and not message.HasField(name):
            return None
        message = getattr(message, name)
    return message


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_every_topic_equals_the_official_readers(tmp_path: Path, compression: str) -> None:
    path = recorded_run(tmp_path / "a.mcap", compression=compression)
    trace = Trace(path)
    tables = trace.read_all()
    expected = judged(path)
    assert set(tables) == set(expected)
    for topic, rows in expected.items():
        table = tables[topic]
        assert table.log_time_ns.tolist() == [row[0] for row in rows]
        assert table.publish_time_ns.tolist() == [row[1] for row in rows]
        assert table.sequence.tolist() == [row[2] for row in rows]
        metadata = trace.topics[topic].metadata
        fields = {metadata.get(f"{f}.name", f): f for f in _dotted(rows[0][3].DESCRIPTOR)}
        assert set(fields) == set(table.columns)
        for name, field in fields.items():
            values = [inner(row[3], field) for row in rows]
            assert table.present[name].tolist() == [value is not None for value in values]
            there = table.present[name]
            assert table[name][there].tolist() == [v for v in values if v is not None]


def _dotted(descriptor: Any, before: str = "") -> list[str]:
    found = []
    for field in descriptor.fields:
        if field.is_repeated or field.type == F.TYPE_BYTES:
            continue  # no column
        if field.message_type is not None:
            found += _dotted(field.message_type, f"{before}{field.name}.")
        else:
            found.append(f"{before}{field.name}")
    return found


def everything() -> tuple[bytes, Any]:
    """A proto3 message with every kind of field, nested, repeated, in a choice, with presence."""
    kinds = {
        "d": F.TYPE_DOUBLE, "f": F.TYPE_FLOAT, "i32": F.TYPE_INT32, "i64": F.TYPE_INT64,
        "u32": F.TYPE_UINT32, "u64": F.TYPE_UINT64, "s32": F.TYPE_SINT32, "s64": F.TYPE_SINT64,
        "x32": F.TYPE_FIXED32, "q32": F.TYPE_SFIXED32, "q64": F.TYPE_SFIXED64,
        "b": F.TYPE_BOOL, "s": F.TYPE_STRING, "y": F.TYPE_BYTES,
    }  # fmt: skip
    file = FileDescriptorProto(name="e.proto", package="e", syntax="proto3")
    part = file.message_type.add(name="Part")
    for number, (name, kind) in enumerate(kinds.items(), start=1):
        part.field.add(name=name, number=number, type=kind, label=F.LABEL_OPTIONAL)
    whole = file.message_type.add(name="Whole")
    whole.oneof_decl.add(name="choice")
    whole.oneof_decl.add(name="_maybe")
    whole.field.add(
        name="part", number=1, type=F.TYPE_MESSAGE, type_name=".e.Part", label=F.LABEL_OPTIONAL
    )
    whole.field.add(
        name="left", number=2, type=F.TYPE_DOUBLE, oneof_index=0, label=F.LABEL_OPTIONAL
    )
    whole.field.add(
        name="right", number=3, type=F.TYPE_INT64, oneof_index=0, label=F.LABEL_OPTIONAL
    )
    whole.field.add(
        name="maybe", number=4, type=F.TYPE_DOUBLE, oneof_index=1, proto3_optional=True,
        label=F.LABEL_OPTIONAL,
    )  # fmt: skip
    whole.field.add(name="many", number=5, type=F.TYPE_DOUBLE, label=F.LABEL_REPEATED)
    whole.field.add(name="plain", number=300, type=F.TYPE_DOUBLE, label=F.LABEL_OPTIONAL)
    whole.field.add(
        name="parts", number=7, type=F.TYPE_MESSAGE, type_name=".e.Part", label=F.LABEL_REPEATED
    )
    pool = DescriptorPool()
    pool.Add(file)
    found = GetMessageClass(pool.FindMessageTypeByName("e.Whole"))
    return FileDescriptorSet(file=[file]).SerializeToString(), found


SCHEMA, WHOLE = everything()
numbers = {
    "d": st.floats(), "f": st.floats(width=32), "i32": st.integers(-(2**31), 2**31 - 1),
    "i64": st.integers(-(2**63), 2**63 - 1), "u32": st.integers(0, 2**32 - 1),
    "u64": st.integers(0, 2**64 - 1), "s32": st.integers(-(2**31), 2**31 - 1),
    "s64": st.integers(-(2**63), 2**63 - 1), "x32": st.integers(0, 2**32 - 1),
    "q32": st.integers(-(2**31), 2**31 - 1), "q64": st.integers(-(2**63), 2**63 - 1),
    "b": st.booleans(), "s": st.text(max_size=3), "y": st.binary(max_size=3),
}  # fmt: skip
parts = st.fixed_dictionaries({}, optional=numbers)
wholes = st.fixed_dictionaries(
    {},
    optional={
        "part": parts,
        "maybe": st.floats(),
        "many": st.lists(st.floats(), max_size=3),
        "plain": st.floats(),
        "parts": st.lists(parts, max_size=2),
    },
)


def same(one: Any, two: Any) -> bool:
    return bool(one == two) or (one != one and two != two)  # noqa: PLR0124 - NaN


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(wholes, st.integers(0, 2)), min_size=1, max_size=6), st.data())
def test_decoded_messages_equal_protobufs(
    rows: list[tuple[dict[str, Any], int]], data: st.DataObject
) -> None:
    """Whatever is present, whatever the widths, also messages laid out oddly."""
    payloads = []
    for content, choice in rows:
        message = WHOLE(**content)
        if choice == 1:
            message.left = 2.5
        elif choice == 2:
            message.right = -7
        payloads.append(message.SerializeToString())
    oddity = data.draw(st.sampled_from(["none", "twice", "unknown", "choice twice", "reversed"]))
    if oddity == "twice":  # protobuf merges what comes twice; the last scalar counts
        payloads[0] += WHOLE(part={"d": 1.5}, plain=3.0).SerializeToString()
    elif oddity == "unknown":
        payloads[0] += b"\xa2\x06\x03abc"
    elif oddity == "choice twice":
        payloads[0] += WHOLE(left=1.0).SerializeToString() + WHOLE(right=2).SerializeToString()
    elif oddity == "reversed":
        payloads[0] = WHOLE(plain=1.0).SerializeToString() + WHOLE(maybe=2.0).SerializeToString()
    payloads = payloads * 20  # enough of a kind to be taken together
    with TemporaryDirectory() as folder:
        path = write_protobuf(Path(folder, "a.mcap"), "/whole", SCHEMA, "e.Whole", payloads)
        table, signals = Trace(path).read("/whole"), Trace(path).topics["/whole"].signals
    parsed = [WHOLE.FromString(payload) for payload in payloads]
    assert [s.name for s in signals if s.name.startswith("part.")] == [
        f"part.{name}" for name in numbers if name != "y"
    ]
    assert [*table.columns] == [signal.name for signal in signals]
    for name, values in table.columns.items():
        expected = [inner(message, name) for message in parsed]
        assert table.present[name].tolist() == [value is not None for value in expected], name
        for value, wanted in zip(values.tolist(), expected, strict=True):
            assert wanted is None or same(value, wanted), name


INDEXES = [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE]


@pytest.mark.parametrize("chunking", [True, False])
@pytest.mark.parametrize("index", INDEXES)
@pytest.mark.parametrize("summary", [True, False])
def test_files_of_the_official_writer(
    tmp_path: Path, *, chunking: bool, index: IndexType, summary: bool
) -> None:
    """Unchunked, without index, without summary: the same rows, and the content hash."""
    stream = BytesIO()
    writer = Writer(
        stream,
        chunk_size=700,
        compression=CompressionType.LZ4,
        index_types=index,
        use_chunking=chunking,
        use_statistics=summary,
        use_summary_offsets=summary,
        repeat_channels=summary,
        repeat_schemas=summary,
    )
    writer.start("", "judge")
    schema = writer.register_schema("e.Whole", "protobuf", SCHEMA)
    channel = writer.register_channel("/whole", "protobuf", schema)
    other = writer.register_channel("/json", "json", 0)
    for k in range(200):
        writer.add_message(channel, 10 * k, WHOLE(plain=k / 3, maybe=k).SerializeToString(), k, k)
        if k % 3 == 0:
            writer.add_message(other, 10 * k, json.dumps({"k": k}).encode(), 10 * k)
    writer.add_metadata("theirs", {"x": "y"})
    writer.finish()
    path = tmp_path / "theirs.mcap"
    path.write_bytes(stream.getvalue())
    trace = Trace(path)
    assert (trace.complete, trace.library) == (True, "judge")
    table = trace.read("/whole")
    assert table["plain"].tolist() == [k / 3 for k in range(200)]
    assert table.log_time_ns.tolist() == [10 * k for k in range(200)]
    assert trace.read("/json")["k"].tolist() == list(range(0, 200, 3))
    assert (trace.topics["/whole"].count, trace.topics["/whole"].end_ns) == (200, 1990)
    assert trace.metadata == [("theirs", {"x": "y"})]
    assert content_hash(path) == former_hash(path)


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_content_hash_as_defined(tmp_path: Path, compression: str) -> None:
    path = recorded_run(tmp_path / "a.mcap", compression=compression)
    assert content_hash(path) == plain_hash(path)


def official(path: Path, channels: list[tuple[str, str, str, list[bytes]]]) -> Path:
    """A file with (topic, encoding, schema name, payloads)."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "judge")
        for topic, encoding, name, payloads in channels:
            schema = writer.register_schema(
                name, "protobuf" if encoding == "protobuf" else "x", SCHEMA
            )
            channel = writer.register_channel(topic, encoding, schema)
            for k, payload in enumerate(payloads):
                writer.add_message(channel, k, payload, k)
        writer.finish()
    return path


def test_json_of_other_tools(tmp_path: Path) -> None:
    """Nested objects, short lists, gaps, numbers of both kinds, values of several kinds."""
    rows: list[dict[str, Any]] = [
        {"a": {"b": 1, "c": 0.5}, "v": [1.0, 2.0], "flag": True, "t": "x", "mix": 1},
        {"a": {"b": 2}, "v": [3.0], "t": "y", "mix": "two", "big": 10**30, "long": [0] * 100},
    ]
    path = official(
        tmp_path / "j.mcap", [("/j", "json", "J", [json.dumps(row).encode() for row in rows])]
    )
    table = Trace(path).read("/j")
    assert table["a.b"].tolist() == [1, 2]
    assert table["a.b"].dtype == np.int64
    assert np.array_equal(table["a.c"], [0.5, np.nan], equal_nan=True)
    assert table["v[0]"].tolist() == [1.0, 3.0]
    assert table.present["v[1]"].tolist() == [True, False]
    assert table["flag"].tolist() == [True, False]
    assert table["mix"].tolist() == ["1", "two"]
    assert "long[0]" not in table.columns
    assert Trace(path).signal("/j:a.b").values.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("encoding", "message"),
    [("ros1", "ROS 1"), ("cdr", "ROS 2"), ("cbor", "cbor"), ("", "no encoding")],
)
def test_other_encodings_are_refused_by_name(tmp_path: Path, encoding: str, message: str) -> None:
    path = official(tmp_path / "r.mcap", [("/imu", encoding, "sensor_msgs/Imu", [b"\0\1"])])
    assert Trace(path).topics["/imu"].count == 1
    with pytest.raises(InputError, match=message):
        Trace(path).read("/imu")


def test_several_channels_of_a_topic_are_one_table(tmp_path: Path) -> None:
    """Rows in file order, columns of all, each present where its channel wrote."""
    path = tmp_path / "s.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "judge")
        schema = writer.register_schema("e.Whole", "protobuf", SCHEMA)
        first = writer.register_channel("/t", "protobuf", schema)
        second = writer.register_channel("/t", "json", 0)
        for k in range(10):
            payload = (
                WHOLE(plain=float(k)).SerializeToString() if k % 2 else b'{"plain": 0.5, "n": 1}'
            )
            writer.add_message(first if k % 2 else second, k, payload, k)
        writer.finish()
    table = Trace(path).read("/t")
    assert table["plain"].tolist() == [float(k) if k % 2 else 0.5 for k in range(10)]
    assert table.present["n"].tolist() == [k % 2 == 0 for k in range(10)]
    assert Trace(path).topics["/t"].count == 10


def test_bad_rows_are_reported(tmp_path: Path) -> None:
    """A row that is no message of its schema, or no JSON, names file and topic."""
    path = official(
        tmp_path / "b.mcap",
        [("/p", "protobuf", "e.Whole", [b"\x09\x00"]), ("/j", "json", "", [b"{", b"[]"])],
    )
    for topic in ("/p", "/j"):
        with pytest.raises(LossError, match=topic):
            Trace(path).read(topic)
