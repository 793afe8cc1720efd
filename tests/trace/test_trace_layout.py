"""Names, descriptors and schemas, as they are in a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from google.protobuf import timestamp_pb2
from google.protobuf.descriptor import FieldDescriptor
from hypothesis import given, settings, strategies as st
from mcap_files import message_type, payloads_of, schemas_of, type_of

from cosim.core import InputError
from cosim.trace import Signal, Trace, TraceWriter


def declared(path: Path, names: Sequence[str]) -> Path:
    """A trace with a topic of these signals, without a row."""
    with TraceWriter(path, run={}) as writer:
        signals = [Signal(name) for name in names]
        writer.add_topic("/p/output", signals, schema_name="cosim.p.Output")
        return writer.finish({})


def field_names(path: Path, names: Sequence[str]) -> list[str]:
    """The names of the protobuf fields of these signals."""
    return [f.name for f in type_of(declared(path, names), "/p/output").DESCRIPTOR.fields]


@pytest.fixture
def foxglove(tmp_path: Path) -> dict[str, Any]:
    """The messages of Foxglove that a trace has, by the name of their schema."""
    with TraceWriter(tmp_path / "foxglove.mcap", run={}) as writer:
        writer.log(7_000_000_008, "info", "a", "b")
        writer.pose(7_000_000_008, 1.0, 2.0, 3.0, 0.5)
        path = writer.finish({})
    return {
        schema.name: message_type(schema.data, schema.name) for schema in schemas_of(path).values()
    }


def test_field_names_of_the_design(tmp_path: Path) -> None:
    """The names the design page gives as examples."""
    names = ["eta.x", "K[1,3]", "moment.z"]
    assert field_names(tmp_path / "a.mcap", names) == ["eta_x", "K_1_3", "moment_z"]


def test_field_names_that_collide(tmp_path: Path) -> None:
    """Names that would be the same field, or the same JSON name, are numbered."""
    names = ["a.b", "a_b", "aB", "A.b", "1", "_", "τ"]
    found = field_names(tmp_path / "a.mcap", names)
    assert found == ["a_b", "a_b_2", "aB_3", "A_b_4", "x_1", "x", "x_2"]


@settings(deadline=None)
@given(st.lists(st.text(min_size=1, max_size=6), min_size=1, max_size=30, unique=True))
def test_any_names_make_a_valid_message(names: list[str]) -> None:
    """Whatever the FMI names, protobuf accepts the message, and the names can be got back."""
    with TemporaryDirectory() as folder:
        path = declared(Path(folder, "a.mcap"), names)
        fields = type_of(path, "/p/output").DESCRIPTOR.fields
        assert [signal.name for signal in Trace(path).topics["/p/output"].signals] == names
    assert [f.number for f in fields] == list(range(1, len(names) + 1))
    assert all(f.has_presence for f in fields)


@pytest.mark.parametrize("signals", [15, 16, 2047, 2048, 2100])
def test_tags_of_any_length_are_protobufs(tmp_path: Path, signals: int) -> None:
    """The tag is the base-128 number of field << 3 | 1: of one byte, of two from 16, of three."""
    row = [k / 7 for k in range(signals)]
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        names = [Signal(f"x[{k}]") for k in range(signals)]
        writer.write(writer.add_topic("/t", names, schema_name="t.T"), 0, row)
        path = writer.finish({})
    message = type_of(path, "/t")(**{f"x_{k}": value for k, value in enumerate(row)})
    assert payloads_of(path, "/t") == [message.SerializeToString(deterministic=True)]
    table = Trace(path).read("/t")
    assert [table[f"x[{k}]"][0] for k in range(signals)] == row


def test_foxglove_numbers(foxglove: dict[str, Any]) -> None:
    """Fields have the numbers and types of the published Foxglove schemas."""
    published = {
        "foxglove.Log": [
            ("timestamp", 1, FieldDescriptor.TYPE_MESSAGE),
            ("level", 2, FieldDescriptor.TYPE_ENUM),
            ("message", 3, FieldDescriptor.TYPE_STRING),
            ("name", 4, FieldDescriptor.TYPE_STRING),
            ("file", 5, FieldDescriptor.TYPE_STRING),
            ("line", 6, FieldDescriptor.TYPE_FIXED32),
        ],
        "foxglove.PoseInFrame": [
            ("timestamp", 1, FieldDescriptor.TYPE_MESSAGE),
            ("frame_id", 2, FieldDescriptor.TYPE_STRING),
            ("pose", 3, FieldDescriptor.TYPE_MESSAGE),
        ],
        "foxglove.FrameTransform": [
            ("timestamp", 1, FieldDescriptor.TYPE_MESSAGE),
            ("parent_frame_id", 2, FieldDescriptor.TYPE_STRING),
            ("child_frame_id", 3, FieldDescriptor.TYPE_STRING),
            ("translation", 4, FieldDescriptor.TYPE_MESSAGE),
            ("rotation", 5, FieldDescriptor.TYPE_MESSAGE),
        ],
    }
    for name, fields in published.items():
        descriptor = foxglove[name].DESCRIPTOR
        assert [(f.name, f.number, f.type) for f in descriptor.fields] == fields
    update = foxglove["foxglove.SceneUpdate"].DESCRIPTOR
    assert [f.name for f in update.fields] == ["deletions", "entities"]
    assert all(f.is_repeated for f in update.fields)
    entity = update.fields_by_name["entities"].message_type
    assert {f.name: f.number for f in entity.fields} == {
        "timestamp": 1, "frame_id": 2, "id": 3, "lifetime": 4, "frame_locked": 5, "metadata": 6,
        "arrows": 7, "cubes": 8, "spheres": 9, "cylinders": 10, "lines": 11, "triangles": 12,
        "texts": 13, "models": 14,
    }  # fmt: skip
    line = entity.fields_by_name["lines"].message_type
    assert [(f.name, f.type) for f in line.fields] == [
        ("type", FieldDescriptor.TYPE_ENUM),
        ("pose", FieldDescriptor.TYPE_MESSAGE),
        ("thickness", FieldDescriptor.TYPE_DOUBLE),
        ("scale_invariant", FieldDescriptor.TYPE_BOOL),
        ("points", FieldDescriptor.TYPE_MESSAGE),
        ("color", FieldDescriptor.TYPE_MESSAGE),
        ("colors", FieldDescriptor.TYPE_MESSAGE),
        ("indices", FieldDescriptor.TYPE_FIXED32),
    ]
    levels = foxglove["foxglove.Log"].DESCRIPTOR.enum_types_by_name["Level"]
    assert [(v.name, v.number) for v in levels.values] == [
        ("UNKNOWN", 0),
        ("DEBUG", 1),
        ("INFO", 2),
        ("WARNING", 3),
        ("ERROR", 4),
        ("FATAL", 5),
    ]


def test_timestamp_is_the_well_known_one(tmp_path: Path, foxglove: dict[str, Any]) -> None:
    """The timestamp spelled out here reads as protobuf's own."""
    (data,) = payloads_of(tmp_path / "foxglove.mcap", "/auv/pose")
    pose = foxglove["foxglove.PoseInFrame"].FromString(data)
    theirs = timestamp_pb2.Timestamp.FromString(pose.timestamp.SerializeToString())
    assert theirs.ToNanoseconds() == 7_000_000_008


def test_layout_refuses_invalid_signals_and_names(tmp_path: Path) -> None:
    """Nameless signals, unknown kinds, signals twice and impossible schema names."""
    with pytest.raises(InputError, match="name"):
        Signal("")
    with pytest.raises(InputError, match="kind"):
        Signal("a", kind="complex")  # type: ignore[arg-type]
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        with pytest.raises(InputError, match="twice"):
            writer.add_topic("/a", [Signal("a"), Signal("a")], schema_name="cosim.A")
        with pytest.raises(InputError, match="schema name"):
            writer.add_topic("/a", [Signal("a")], schema_name="cosim.a-b")
