"""Encode the topics in Foxglove's schemas: the log, poses, frames, hull and path of vehicles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.file.block import HEAD, Records
from cosim.trace.rows import foxglove, layout, scene
from cosim.trace.rows.poses import pose_messages, transform_messages
from cosim.trace.rows.rows import Lines, Poses
from cosim.trace.rows.scene import Path, Thinned

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]
Numbers = NDArray[np.intp]
Bytes = NDArray[np.uint8]

NED, MAP = "ned", "map"
"""Frames: x north, y east, z down, as the vehicle's equations; x east, y north, z up."""

_POSE, _FRAME = "foxglove.PoseInFrame", "foxglove.FrameTransform"
_SCENE = "foxglove.SceneUpdate"

_HALF_TURN = math.sqrt(0.5)  # about the line between x and y: x <-> y, z -> -z
_MAP_TO_NED = {
    "parent_frame_id": MAP,
    "child_frame_id": NED,
    "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
    "rotation": {"x": _HALF_TURN, "y": _HALF_TURN, "z": 0.0, "w": 0.0},
}


class Register(Protocol):
    """A function that declares a topic and returns its id."""

    def __call__(
        self, topic: str, schema_name: str, files: FileDescriptorSet, metadata: Mapping[str, str]
    ) -> int:
        """See `TraceWriter`."""


class FoxgloveTopics:
    """The Foxglove topics of a trace; each is declared when it is first used."""

    def __init__(self, register: Register) -> None:
        self._register = register
        self._ids: dict[str, int] = {}
        self._framed = False
        self._thinned: dict[tuple[str, bool], Thinned] = {}
        self._paths: dict[str, Path] = {}

    def log(self, time_ns: int, level: str, name: str, message: str) -> tuple[int, bytes]:
        """Return the topic's id and the bytes of a log line; `InputError` at an unknown level."""
        if level not in foxglove.LEVELS:
            known = ", ".join(foxglove.LEVELS)
            raise InputError("unknown level", where="log", expected=known, got=repr(level))
        fields = {"level": foxglove.LEVELS[level], "name": name, "message": message}
        data = foxglove.encoded("foxglove.Log", int(time_ns), fields)
        return self._topic(layout.LOG_TOPIC, "foxglove.Log"), data

    def lines(self, part: Lines) -> list[Records]:
        """Return the records of log lines; `InputError` at an unknown level."""
        records = []
        for i, (level, name, message) in enumerate(part.lines):
            at = int(part.log_ns[i])
            topic_id, data = self.log(at, level, name, message)
            records.append(_record(topic_id, at, data, np.asarray(part.rank, np.int64)))
        return records

    def poses(self, part: Poses) -> list[Records]:
        """Return the records of poses, of the vehicle's frame, and of the path that are due.

        Before the very first come the frame of all poses, and the vehicle's hull.
        """
        ranks = np.broadcast_to(np.asarray(part.rank, np.int64), (part.log_ns.size, _keys(part)))
        records = self._beginning(part, int(part.log_ns[0]), ranks[0])
        chosen = self._thinned.setdefault((part.vehicle, part.reference), Thinned())(part.log_ns)
        if part.reference:
            messages = pose_messages(NED, *_columns(part, chosen), room=HEAD.size)
            topic_id = self._topic(layout.reference_topic(part.vehicle), _POSE)
            return records + _records(topic_id, part.log_ns[chosen], ranks[chosen], messages)
        messages = pose_messages(NED, *_columns(part, slice(None)), room=HEAD.size)
        topic_id = self._topic(layout.pose_topic(part.vehicle), _POSE)
        records += _records(topic_id, part.log_ns, ranks, messages)
        frames = NED, part.vehicle
        messages = transform_messages(frames, *_columns(part, chosen), room=HEAD.size)
        topic_id = self._topic(layout.FRAME_TOPIC, _FRAME)
        records += _records(topic_id, part.log_ns[chosen], ranks[chosen], messages)
        for k, points in self._paths[part.vehicle].add(part.values[:, :3]):
            at = int(part.log_ns[k])
            topic_id, data = self._path(at, part.vehicle, points)
            records.append(_record(topic_id, at, data, ranks[k]))
        return records

    @property
    def has_paths(self) -> bool:
        """Whether a vehicle has had a pose."""
        return bool(self._paths)

    def whole_paths(self, time_ns: int) -> list[tuple[int, bytes]]:
        """Return the topic and the bytes of the path of each vehicle, as of an instant [ns]."""
        return [self._path(time_ns, name, path.points) for name, path in self._paths.items()]

    def _path(self, time_ns: int, vehicle: str, points: Reals) -> tuple[int, bytes]:
        topic_id = self._topic(layout.path_topic(vehicle), _SCENE)
        return topic_id, scene.path(time_ns, vehicle, NED, points)

    def _beginning(self, part: Poses, time_ns: int, rank: NDArray[np.int64]) -> list[Records]:
        records = []
        if not self._framed:
            self._framed = True
            data = foxglove.encoded(_FRAME, time_ns, _MAP_TO_NED)
            topic_id = self._topic(layout.FIXED_FRAME_TOPIC, _FRAME)
            records.append(_record(topic_id, time_ns, data, rank))
        if not part.reference and part.vehicle not in self._paths:
            self._paths[part.vehicle] = Path()
            topic_id = self._topic(layout.hull_topic(part.vehicle), _SCENE)
            data = scene.hull(time_ns, part.vehicle)
            records.append(_record(topic_id, time_ns, data, rank))
        return records

    def _topic(self, topic: str, schema: str) -> int:
        if topic not in self._ids:
            entries = {} if topic == layout.LOG_TOPIC else layout.COMPUTED
            self._ids[topic] = self._register(topic, schema, foxglove.descriptors(schema), entries)
        return self._ids[topic]


def _keys(part: Poses) -> int:
    return int(np.asarray(part.rank).shape[-1])


def _columns(part: Poses, which: slice | Numbers) -> tuple[Integers, Reals, Reals]:
    """Return times, positions and headings of some of the poses."""
    return part.log_ns[which], part.values[which, :3], part.values[which, 3]


def _records(topic_id: int, log_ns: Integers, ranks: Integers, lines: Bytes) -> list[Records]:
    """Lay out messages; none of none."""
    if not log_ns.size:
        return []
    return [Records(topic_id, log_ns, log_ns, _zeros(log_ns.size), lines, ranks)]


def _record(topic_id: int, time_ns: int, data: bytes, rank: NDArray[np.int64]) -> Records:
    """Lay out one message."""
    at = np.array([time_ns], np.int64)
    line = np.frombuffer(bytes(HEAD.size) + data, np.uint8)[None, :].copy()
    return Records(topic_id, at, at, _zeros(1), line, rank)


def _zeros(count: int) -> NDArray[np.int64]:
    return np.zeros(count, np.int64)
