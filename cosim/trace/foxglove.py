"""The Foxglove schemas of a trace, which Foxglove and Lichtblick show without any setup.

`foxglove.Log`, `foxglove.PoseInFrame`, `foxglove.FrameTransform`: names, fields and numbers as
published with the Foxglove SDK. They are defined here, `google.protobuf.Timestamp` included: the
content hash covers the descriptors, which must not change with the installed protobuf version.
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

from cosim.trace.layout import message_class

LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}
"""`foxglove.Log.Level` by the name `TraceWriter.log` takes."""

_SCALARS = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "string": FieldDescriptorProto.TYPE_STRING,
    "int64": FieldDescriptorProto.TYPE_INT64,
    "int32": FieldDescriptorProto.TYPE_INT32,
    "fixed32": FieldDescriptorProto.TYPE_FIXED32,
}

_MESSAGES = {
    "google.protobuf.Timestamp": (("seconds", "int64"), ("nanos", "int32")),
    "foxglove.Vector3": (("x", "double"), ("y", "double"), ("z", "double")),
    "foxglove.Quaternion": (("x", "double"), ("y", "double"), ("z", "double"), ("w", "double")),
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


def _path(message: str) -> str:
    if message == "google.protobuf.Timestamp":
        return "google/protobuf/timestamp.proto"
    return f"{message.replace('.', '/')}.proto"


def _file(message: str) -> FileDescriptorProto:
    package, _, name = message.rpartition(".")
    descriptor = DescriptorProto(name=name)
    dependencies = []
    for number, (field, kind) in enumerate(_MESSAGES[message], start=1):
        entry = descriptor.field.add(
            name=field, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL
        )
        if kind in _SCALARS:
            entry.type = _SCALARS[kind]
            continue
        entry.type_name = f".{kind}"
        if kind in _MESSAGES:
            entry.type = FieldDescriptorProto.TYPE_MESSAGE
            dependencies.append(_path(kind))
        else:
            entry.type = FieldDescriptorProto.TYPE_ENUM
            levels = EnumDescriptorProto(name="Level")
            for level, value in {"unknown": 0, **LEVELS}.items():
                levels.value.add(name=level.upper(), number=value)
            descriptor.enum_type.append(levels)
    return FileDescriptorProto(
        name=_path(message),
        package=package,
        dependency=dependencies,
        syntax="proto3",
        message_type=[descriptor],
    )


def descriptors(message: str) -> FileDescriptorSet:
    """Return the files of `message` and of all messages in it, each after those it imports."""
    return FileDescriptorSet(file=[_file(name) for name in dict.fromkeys(_needed(message))])


def _needed(message: str) -> Iterator[str]:
    for _, kind in _MESSAGES[message]:
        if kind in _MESSAGES:
            yield from _needed(kind)
    yield message


@functools.cache
def message_type(message: str) -> type[Any]:
    """Return the message class of a schema."""
    return message_class(descriptors(message), message)


def encoded(message: str, time_ns: int, fields: Mapping[str, Any]) -> bytes:
    """Encode a message with a timestamp."""
    seconds, nanos = divmod(time_ns, 10**9)
    filled = message_type(message)(timestamp={"seconds": seconds, "nanos": nanos}, **fields)
    data: bytes = filled.SerializeToString(deterministic=True)
    return data
