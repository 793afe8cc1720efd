"""The Foxglove schemas of a trace, which Foxglove and Lichtblick show without any setup.

`foxglove.Log`, `foxglove.PoseInFrame`, `foxglove.FrameTransform`, `foxglove.SceneUpdate`, as the
Foxglove SDK publishes them, stand in `foxglove.binpb` (a `FileDescriptorSet`; its licence beside
it), those of `google.protobuf` included: the bytes of a trace must not change with the installed
version of either.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

from cosim.trace.rows.layout import message_class

LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}
"""`foxglove.Log.Level` by the name `TraceWriter.log` takes."""


@functools.cache
def _files() -> Mapping[str, FileDescriptorProto]:
    """The files of all schemas by name."""
    content = Path(__file__).with_name("foxglove.binpb").read_bytes()
    return {file.name: file for file in FileDescriptorSet.FromString(content).file}


def descriptors(message: str) -> FileDescriptorSet:
    """Return the file of `message` and those that it imports, each after those it imports."""
    needed = _needed(f"{message.replace('.', '/')}.proto")
    return FileDescriptorSet(file=[_files()[name] for name in dict.fromkeys(needed)])


def _needed(name: str) -> Iterator[str]:
    for imported in _files()[name].dependency:
        yield from _needed(imported)
    yield name


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
