"""Names, descriptors and schemas."""

from __future__ import annotations

import pytest
from google.protobuf import timestamp_pb2
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import given, strategies as st

from cosim.core import InputError
from cosim.trace import Signal
from cosim.trace.rows import foxglove, layout
from cosim.trace.rows.encode import tag


def test_field_names_of_the_design() -> None:
    """The names the design page gives as examples."""
    assert layout.field_names(["eta.x", "K[1,3]", "moment.z"]) == ["eta_x", "K_1_3", "moment_z"]


def test_field_names_that_collide() -> None:
    """Names that would be the same field, or the same JSON name, are numbered."""
    names = ["a.b", "a_b", "aB", "A.b", "1", "_", "τ"]
    assert layout.field_names(names) == ["a_b", "a_b_2", "aB_3", "A_b_4", "x_1", "x", "x_2"]


@given(st.lists(st.text(min_size=1, max_size=6), min_size=1, max_size=30, unique=True))
def test_any_names_make_a_valid_message(names: list[str]) -> None:
    """Whatever the FMI names, protobuf accepts the message, and the names can be got back."""
    signals = [Signal(name) for name in names]
    files = FileDescriptorSet(file=[layout.file_descriptor("cosim.p.Output", signals)])
    message = layout.message_class(files, "cosim.p.Output")
    metadata = layout.channel_metadata(signals)
    fields = message.DESCRIPTOR.fields
    assert [layout.signal_of(f.name, "float", metadata).name for f in fields] == names
    assert [f.number for f in fields] == list(range(1, len(names) + 1))
    assert all(f.has_presence for f in fields)


@given(st.integers(1, 2**29 - 1))
def test_tag(number: int) -> None:
    """The tag is protobuf's base-128 number of field << 3 | 1."""
    value = 0
    for place, byte in enumerate(encoded := tag(number)):
        value |= (byte & 0x7F) << 7 * place
        assert bool(byte & 0x80) == (place < len(encoded) - 1)
    assert value == number << 3 | 1


def test_foxglove_numbers() -> None:
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
        descriptor = foxglove.message_type(name).DESCRIPTOR
        assert [(f.name, f.number, f.type) for f in descriptor.fields] == fields
    update = foxglove.message_type("foxglove.SceneUpdate").DESCRIPTOR
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
    levels = foxglove.message_type("foxglove.Log").DESCRIPTOR.enum_types_by_name["Level"]
    assert [(v.name, v.number) for v in levels.values] == [
        ("UNKNOWN", 0),
        ("DEBUG", 1),
        ("INFO", 2),
        ("WARNING", 3),
        ("ERROR", 4),
        ("FATAL", 5),
    ]


def test_timestamp_is_the_well_known_one() -> None:
    """The timestamp spelled out here reads as protobuf's own."""
    pose = foxglove.message_type("foxglove.PoseInFrame")(timestamp={"seconds": 7, "nanos": 8})
    theirs = timestamp_pb2.Timestamp.FromString(pose.timestamp.SerializeToString())
    assert theirs.ToNanoseconds() == 7_000_000_008


def test_layout_refuses_invalid_signals_and_names() -> None:
    """Nameless signals, unknown kinds, signals twice and impossible schema names."""
    with pytest.raises(InputError, match="name"):
        Signal("")
    with pytest.raises(InputError, match="kind"):
        Signal("a", kind="complex")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="twice"):
        layout.file_descriptor("cosim.A", [Signal("a"), Signal("a")])
    with pytest.raises(InputError, match="schema name"):
        layout.file_descriptor("cosim.a-b", [Signal("a")])
