"""The Foxglove schemas of a trace, which Foxglove and Lichtblick show without any setup.

`foxglove.Log`, `foxglove.PoseInFrame`, `foxglove.FrameTransform`, `foxglove.SceneUpdate`: names,
fields and numbers as published with the Foxglove SDK. They are defined here, those of
`google.protobuf` included: the bytes of a trace must not change with the installed protobuf
version.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from typing import Any

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    EnumDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from cosim.trace.rows.layout import message_class

LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}
"""`foxglove.Log.Level` by the name `TraceWriter.log` takes."""

_SCALARS = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "string": FieldDescriptorProto.TYPE_STRING,
    "int64": FieldDescriptorProto.TYPE_INT64,
    "int32": FieldDescriptorProto.TYPE_INT32,
    "bool": FieldDescriptorProto.TYPE_BOOL,
    "bytes": FieldDescriptorProto.TYPE_BYTES,
    "fixed32": FieldDescriptorProto.TYPE_FIXED32,
}

_ENUMS: dict[str, Mapping[str, int]] = {
    "foxglove.Log.Level": {"UNKNOWN": 0, **{name.upper(): n for name, n in LEVELS.items()}},
    "foxglove.LinePrimitive.Type": {"LINE_STRIP": 0, "LINE_LOOP": 1, "LINE_LIST": 2},
    "foxglove.SceneEntityDeletion.Type": {"MATCHING_ID": 0, "ALL": 1},
}
"""Values of each enumeration, which is declared in the message that has it."""

_XYZ = ("x", "double"), ("y", "double"), ("z", "double")
_TIME = ("seconds", "int64"), ("nanos", "int32")
_PLACED = ("pose", "foxglove.Pose"), ("size", "foxglove.Vector3")
_COLOR = ("color", "foxglove.Color")

_MESSAGES: dict[str, tuple[tuple[str, str], ...]] = {
    "google.protobuf.Timestamp": _TIME,
    "google.protobuf.Duration": _TIME,
    "foxglove.Vector3": _XYZ,
    "foxglove.Point3": _XYZ,
    "foxglove.Quaternion": (*_XYZ, ("w", "double")),
    "foxglove.Color": (("r", "double"), ("g", "double"), ("b", "double"), ("a", "double")),
    "foxglove.KeyValuePair": (("key", "string"), ("value", "string")),
    "foxglove.Pose": (("position", "foxglove.Vector3"), ("orientation", "foxglove.Quaternion")),
    "foxglove.PoseInFrame": (
        ("timestamp", "google.protobuf.Timestamp"),
        ("frame_id", "string"),
        ("pose", "foxglove.Pose"),
    ),
    "foxglove.FrameTransform": (
        ("timestamp", "google.protobuf.Timestamp"),
        ("parent_frame_id", "string"),
        ("child_frame_id", "string"),
        ("translation", "foxglove.Vector3"),
        ("rotation", "foxglove.Quaternion"),
    ),
    "foxglove.ArrowPrimitive": (
        ("pose", "foxglove.Pose"),
        ("shaft_length", "double"),
        ("shaft_diameter", "double"),
        ("head_length", "double"),
        ("head_diameter", "double"),
        _COLOR,
    ),
    "foxglove.CubePrimitive": (*_PLACED, _COLOR),
    "foxglove.SpherePrimitive": (*_PLACED, _COLOR),
    "foxglove.CylinderPrimitive": (
        *_PLACED,
        ("bottom_scale", "double"),
        ("top_scale", "double"),
        _COLOR,
    ),
    "foxglove.LinePrimitive": (
        ("type", "foxglove.LinePrimitive.Type"),
        ("pose", "foxglove.Pose"),
        ("thickness", "double"),
        ("scale_invariant", "bool"),
        ("points", "repeated foxglove.Point3"),
        _COLOR,
        ("colors", "repeated foxglove.Color"),
        ("indices", "repeated fixed32"),
    ),
    "foxglove.TriangleListPrimitive": (
        ("pose", "foxglove.Pose"),
        ("points", "repeated foxglove.Point3"),
        _COLOR,
        ("colors", "repeated foxglove.Color"),
        ("indices", "repeated fixed32"),
    ),
    "foxglove.TextPrimitive": (
        ("pose", "foxglove.Pose"),
        ("billboard", "bool"),
        ("font_size", "double"),
        ("scale_invariant", "bool"),
        _COLOR,
        ("text", "string"),
    ),
    "foxglove.ModelPrimitive": (
        ("pose", "foxglove.Pose"),
        ("scale", "foxglove.Vector3"),
        _COLOR,
        ("override_color", "bool"),
        ("url", "string"),
        ("media_type", "string"),
        ("data", "bytes"),
    ),
    "foxglove.SceneEntityDeletion": (
        ("timestamp", "google.protobuf.Timestamp"),
        ("type", "foxglove.SceneEntityDeletion.Type"),
        ("id", "string"),
    ),
    "foxglove.SceneEntity": (
        ("timestamp", "google.protobuf.Timestamp"),
        ("frame_id", "string"),
        ("id", "string"),
        ("lifetime", "google.protobuf.Duration"),
        ("frame_locked", "bool"),
        ("metadata", "repeated foxglove.KeyValuePair"),
        ("arrows", "repeated foxglove.ArrowPrimitive"),
        ("cubes", "repeated foxglove.CubePrimitive"),
        ("spheres", "repeated foxglove.SpherePrimitive"),
        ("cylinders", "repeated foxglove.CylinderPrimitive"),
        ("lines", "repeated foxglove.LinePrimitive"),
        ("triangles", "repeated foxglove.TriangleListPrimitive"),
        ("texts", "repeated foxglove.TextPrimitive"),
        ("models", "repeated foxglove.ModelPrimitive"),
    ),
    "foxglove.SceneUpdate": (
        ("deletions", "repeated foxglove.SceneEntityDeletion"),
        ("entities", "repeated foxglove.SceneEntity"),
    ),
    "foxglove.Log": (
        ("timestamp", "google.protobuf.Timestamp"),
        ("level", "foxglove.Log.Level"),
        ("message", "string"),
        ("name", "string"),
        ("file", "string"),
        ("line", "fixed32"),
    ),
}
"""Fields of each message, numbered from 1 in this order."""


_GOOGLE, _REPEATED = "google.protobuf", "repeated "


def _path(message: str) -> str:
    package, _, name = message.rpartition(".")
    return f"{package.replace('.', '/')}/{name.lower() if package == _GOOGLE else name}.proto"


def _file(message: str) -> FileDescriptorProto:
    package, _, name = message.rpartition(".")
    descriptor = DescriptorProto(name=name)
    dependencies = []
    for number, (field, kind) in enumerate(_MESSAGES[message], start=1):
        one = kind.removeprefix(_REPEATED)
        label = (
            FieldDescriptorProto.LABEL_OPTIONAL
            if one == kind
            else FieldDescriptorProto.LABEL_REPEATED
        )
        entry = descriptor.field.add(name=field, number=number, label=label)
        if one in _SCALARS:
            entry.type = _SCALARS[one]
            continue
        entry.type_name = f".{one}"
        if one in _MESSAGES:
            entry.type = FieldDescriptorProto.TYPE_MESSAGE
            dependencies.append(_path(one))
        else:
            entry.type = FieldDescriptorProto.TYPE_ENUM
            values = EnumDescriptorProto(name=one.rpartition(".")[2])
            for value, of in _ENUMS[one].items():
                values.value.add(name=value, number=of)
            descriptor.enum_type.append(values)
    return FileDescriptorProto(
        name=_path(message),
        package=package,
        dependency=dict.fromkeys(dependencies),
        syntax="proto3",
        message_type=[descriptor],
    )


def descriptors(message: str) -> FileDescriptorSet:
    """Return the files of `message` and of all messages in it, each after those it imports."""
    return FileDescriptorSet(file=[_file(name) for name in dict.fromkeys(_needed(message))])


def _needed(message: str) -> Iterator[str]:
    for _, kind in _MESSAGES[message]:
        one = kind.removeprefix(_REPEATED)
        if one in _MESSAGES:
            yield from _needed(one)
    yield message


@functools.cache
def message_type(message: str) -> type[Any]:
    """Return the message class of a schema."""
    return message_class(descriptors(message), message)


def encoded(message: str, time_ns: int, fields: Mapping[str, Any]) -> bytes:
    """Encode a message with a timestamp."""
    filled = message_type(message)(timestamp=stamp(time_ns), **fields)
    data: bytes = filled.SerializeToString(deterministic=True)
    return data


def stamp(time_ns: int) -> dict[str, int]:
    """Return the fields of a timestamp."""
    seconds, nanos = divmod(time_ns, 10**9)
    return {"seconds": seconds, "nanos": nanos}
