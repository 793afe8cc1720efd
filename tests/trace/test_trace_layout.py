"""Names, descriptors and schemas, as they are in a file."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from google.protobuf import timestamp_pb2
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


@pytest.mark.parametrize("name", ["Log", "PoseInFrame", "FrameTransform", "SceneUpdate"])
def test_schemas_of_views_are_those_of_the_foxglove_sdk(
    foxglove: dict[str, Any], name: str
) -> None:
    """Every message, field and enumeration in them; a newer version of it may have more."""
    published = getattr(import_module("foxglove.messages"), name).get_schema()
    theirs = message_type(published.data, published.name).DESCRIPTOR
    ours = foxglove[f"foxglove.{name}"].DESCRIPTOR
    assert described(ours).items() <= described(theirs).items()
    assert len(described(ours)) > 5


def described(descriptor: Any) -> dict[str, Any]:
    """Every field of a message and of those in it, and every value of an enumeration, by name."""
    found: dict[str, Any] = {}
    for field in descriptor.fields:
        found[field.full_name] = (field.number, field.type, field.is_repeated)
        if field.message_type is not None:
            found |= described(field.message_type)
        for value in field.enum_type.values if field.enum_type is not None else ():
            found[f"{field.full_name} {value.name}"] = value.number
    return found


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
