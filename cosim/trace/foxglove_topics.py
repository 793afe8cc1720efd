"""Encode the topics in Foxglove's schemas: the log, the vehicle's pose, the frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace import foxglove, layout
from cosim.trace.block import HEAD, Records
from cosim.trace.poses import pose_messages
from cosim.trace.rows import Lines, Poses

NED, MAP = "ned", "map"
"""Frames: x north, y east, z down, as the vehicle's equations; x east, y north, z up."""

_HALF_TURN = math.sqrt(0.5)  # about the line between x and y: x <-> y, z -> -z
_FRAME = {
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
            at = part.log_ns[i : i + 1]
            topic_id, data = self.log(int(at[0]), level, name, message)
            line = np.frombuffer(bytes(HEAD.size) + data, np.uint8)[None, :].copy()
            rank = np.asarray(part.rank, np.int64)
            records.append(Records(topic_id, at, at, _zeros(1), line, rank))
        return records

    def poses(self, part: Poses) -> list[Records]:
        """Return the records of poses; before the very first, that of their frame."""
        records = []
        log_ns, rank = part.log_ns, np.asarray(part.rank, np.int64)
        if layout.FRAME_TOPIC not in self._ids:
            topic_id = self._topic(layout.FRAME_TOPIC, "foxglove.FrameTransform")
            encoded = foxglove.encoded("foxglove.FrameTransform", int(log_ns[0]), _FRAME)
            first = rank[:1] if rank.ndim == 2 else rank
            line = np.frombuffer(bytes(HEAD.size) + encoded, np.uint8)[None, :].copy()
            records.append(Records(topic_id, log_ns[:1], log_ns[:1], _zeros(1), line, first))
        topic_id = self._topic(layout.POSE_TOPIC, "foxglove.PoseInFrame")
        position, psi = part.values[:, :3], part.values[:, 3]
        for mine, lines in pose_messages(NED, log_ns, position, psi, room=HEAD.size):
            times = log_ns[mine]
            own = rank[mine] if rank.ndim == 2 else rank
            records.append(Records(topic_id, times, times, _zeros(times.size), lines, own))
        return records

    def _topic(self, topic: str, schema: str) -> int:
        if topic not in self._ids:
            self._ids[topic] = self._register(topic, schema, foxglove.descriptors(schema), {})
        return self._ids[topic]


def _zeros(count: int) -> NDArray[np.int64]:
    return np.zeros(count, np.int64)
