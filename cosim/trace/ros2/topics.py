"""What becomes of each topic of a trace in ROS 2: its topics, types, and messages.

* poses: geometry_msgs/PoseStamped, and nav_msgs/Path of where the vehicle has been;
* frames: tf2_msgs/TFMessage on /tf, those that do not move on /tf_static;
* outputs with pose and speed of a vehicle: nav_msgs/Odometry, beside their signals;
* the log: rcl_interfaces/Log;
* every other signal: a topic of std_msgs Float64, Int64, Bool or String.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.ros2.ros_messages import header, message, pose, pose_stamped, stamp, turn, vector
from cosim.trace.rows.foxglove_topics import MAP, NED
from cosim.trace.rows.layout import (
    FIXED_FRAME_TOPIC,
    FRAME_TOPIC,
    VEHICLE,
    component_of,
    field_names,
)
from cosim.trace.rows.scene import Path
from cosim.trace.tables.table import Table
from cosim.trace.tables.topic_info import TopicInfo

Numbers = NDArray[np.intp]

_NS = 10**9
_POSITION = tuple(f"pose.position.{axis}" for axis in "xyz")
_TURN = tuple(f"pose.orientation.{axis}" for axis in "xyzw")
_ETA = ("eta.x", "eta.y", "eta.z", "eta.psi")
_NU = ("nu.u", "nu.v", "nu.w", "nu.r")
_LEVELS = {1: 10, 2: 20, 3: 30, 4: 40, 5: 50}
"""Levels of rcl_interfaces/Log by those of foxglove.Log."""
_NONE = np.zeros(36)
"""A covariance of which nothing is known."""


class Outgoing(NamedTuple):
    """Messages of one ROS 2 topic.

    Attributes
    ----------
    rows : numbers of the rows that they come from, (k,).
    messages : of the type, one for each row.
    notes : of the topic: name, unit and description of a signal.
    """

    topic: str
    type: str
    rows: Numbers
    messages: Sequence[Any]
    notes: Mapping[str, str] = {}


class Converter(ABC):
    """Makes the messages of one topic of a trace, part by part."""

    @abstractmethod
    def __call__(self, table: Table) -> Iterator[Outgoing]:
        """Yield the messages of the next rows."""

    def last(self) -> Iterator[Outgoing]:
        """Yield the messages that conclude the topic, of its last row: none, by default."""
        return iter(())


def converters(topics: Mapping[str, TopicInfo]) -> dict[str, list[Converter]]:
    """Return what makes messages of each topic that can be read, by topic."""
    readable = {t: i for t, i in topics.items() if i.signals and i.encoding == "protobuf"}
    names = _Names()
    vehicles = [t for t, i in readable.items() if _has(i, _ETA) and t.endswith("/output")]
    found: dict[str, list[Converter]] = {}
    frames = _Frames(names.free(FRAME_TOPIC), names.free(FIXED_FRAME_TOPIC))
    for topic, info in readable.items():
        match info.schema:
            case "foxglove.PoseInFrame":
                found[topic] = [_Poses(names.free(topic), names)]
            case "foxglove.FrameTransform":
                found[topic] = [frames]
            case "foxglove.Log":
                found[topic] = [_Log(names.free(topic))]
            case _:
                found[topic] = [_Signals(info, names)]
        if topic in vehicles and _has(info, _NU):
            frame = VEHICLE if len(vehicles) == 1 else str(component_of(topic))
            found[topic].append(_Odometry(names.free(f"/{frame}/odometry"), frame))
    return found


class _Names:
    """Topic names as ROS 2 allows them: letters, digits and _ in parts, no part with a digit first.

    What is taken gets `_2`, `_3`, ...
    """

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def free(self, wanted: str) -> str:
        parts = [re.sub(r"[^A-Za-z0-9_]", "_", part) for part in wanted.split("/") if part]
        base = "/" + "/".join(f"x_{part}" if part[0].isdigit() else part for part in parts)
        name, number = base, 1
        while name in self._taken:
            number += 1
            name = f"{base}_{number}"
        self._taken.add(name)
        return name


def _has(info: TopicInfo, names: Sequence[str]) -> bool:
    return set(names) <= {signal.name for signal in info.signals}


def _instants(table: Table) -> list[int]:
    """Return the times of rows [ns]; an `InputError` where a message has no room for one."""
    times = table.log_time_ns
    if times.size and not -(2**31) <= int(times.min()) // _NS <= int(times.max()) // _NS < 2**31:
        raise InputError(
            "an instant does not fit into a ROS 2 message",
            where="trace export --to ros2",
            expected=f"seconds below {2**31}",
            got=f"{int(np.abs(times).max()) // _NS} s",
        )
    found: list[int] = times.tolist()
    return found


def _rows(table: Table, *names: str) -> list[tuple[float, ...]]:
    """Return the values of some columns, row by row."""
    return list(zip(*(table[name].tolist() for name in names), strict=True))


class _Signals(Converter):
    """A topic of rows: every signal is a topic of its own."""

    _TYPES: Mapping[str, str] = {
        "float": "std_msgs/msg/Float64",
        "int": "std_msgs/msg/Int64",
        "bool": "std_msgs/msg/Bool",
        "string": "std_msgs/msg/String",
    }

    def __init__(self, info: TopicInfo, names: _Names) -> None:
        fields = field_names([signal.name for signal in info.signals])
        self._topics = {
            signal: (names.free(f"{info.topic}/{field}"), self._TYPES[signal.kind])
            for signal, field in zip(info.signals, fields, strict=True)
        }

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        for signal, (topic, kind) in self._topics.items():
            there = np.flatnonzero(table.present[signal.name])
            known = {"name": signal.name, "unit": signal.unit, "description": signal.description}
            notes = {key: text for key, text in known.items() if text is not None}
            values = table[signal.name][there].tolist()
            yield Outgoing(topic, kind, there, [message(kind, data=x) for x in values], notes)


class _Poses(Converter):
    """Poses, and the path that those of a vehicle make: a pose, not a reference."""

    def __init__(self, topic: str, names: _Names) -> None:
        self._topic = topic
        self._path = Path() if topic.endswith("/pose") else None
        if self._path is not None:
            self._path_topic = names.free(f"{topic.rpartition('/')[0]}/path")
        self._last: tuple[str, int] | None = None

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        times, frames = _instants(table), table["frame_id"].tolist()
        at = map(pose, _rows(table, *_POSITION), _rows(table, *_TURN))
        poses = [pose_stamped(*one) for one in zip(times, frames, at, strict=True)]
        yield Outgoing(self._topic, "geometry_msgs/msg/PoseStamped", _all(table), poses)
        if self._path is not None and times:
            positions = np.column_stack([table[name] for name in _POSITION])
            for k, points in self._path.add(positions):
                yield self._of_path(frames[k], times[k], points, k)
            self._last = frames[-1], times[-1]

    def last(self) -> Iterator[Outgoing]:
        if self._path is not None and self._last is not None:
            yield self._of_path(*self._last, self._path.points, 0)

    def _of_path(self, frame: str, time_ns: int, points: NDArray[Any], row: int) -> Outgoing:
        poses = [
            pose_stamped(time_ns, frame, pose(point, (0.0, 0.0, 0.0, 1.0)))
            for point in points.tolist()
        ]
        kind = "nav_msgs/msg/Path"
        one = message(kind, header=header(time_ns, frame), poses=poses)
        return Outgoing(self._path_topic, kind, np.array([row], np.intp), [one])


class _Frames(Converter):
    """Frames, one transform in each message."""

    def __init__(self, moving: str, static: str) -> None:
        self._topics = moving, static

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        places = _rows(table, *(f"translation.{axis}" for axis in "xyz"))
        turns = _rows(table, *(f"rotation.{axis}" for axis in "xyzw"))
        frames = [*zip(table["parent_frame_id"], table["child_frame_id"], strict=True)]
        messages = [
            message("tf2_msgs/msg/TFMessage", transforms=[_transform(*one)])
            for one in zip(_instants(table), frames, places, turns, strict=True)
        ]
        is_static = np.array([pair == (MAP, NED) for pair in frames], np.bool_)
        for static, topic in enumerate(self._topics):
            mine = np.flatnonzero(is_static == static)
            chosen = [messages[k] for k in mine]
            yield Outgoing(topic, "tf2_msgs/msg/TFMessage", mine, chosen)


def _transform(time_ns: int, frames: tuple[str, str], xyz: Any, xyzw: Any) -> Any:
    parent, child = frames
    moved = message(
        "geometry_msgs/msg/Transform", translation=vector("Vector3", xyz), rotation=turn(xyzw)
    )
    return message(
        "geometry_msgs/msg/TransformStamped",
        header=header(time_ns, parent),
        child_frame_id=child,
        transform=moved,
    )


class _Odometry(Converter):
    """Pose in the frame of the equations, and speed in the vehicle's; no covariance is known."""

    def __init__(self, topic: str, frame: str) -> None:
        self._topic, self._frame = topic, frame

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        *place, psi = (table[name] for name in _ETA)
        turns = np.column_stack([np.sin(0.5 * psi), np.cos(0.5 * psi)]).tolist()
        speeds = _rows(table, *_NU)
        messages = [
            self._message(time_ns, pose(xyz, (0.0, 0.0, *zw)), speed)
            for time_ns, xyz, zw, speed in zip(
                _instants(table), np.column_stack(place).tolist(), turns, speeds, strict=True
            )
        ]
        yield Outgoing(self._topic, "nav_msgs/msg/Odometry", _all(table), messages)

    def _message(self, time_ns: int, at: Any, speed: tuple[float, ...]) -> Any:
        linear, angular = speed[:3], (0.0, 0.0, speed[3])
        twist = message(
            "geometry_msgs/msg/Twist",
            linear=vector("Vector3", linear),
            angular=vector("Vector3", angular),
        )
        parts = {
            "pose": message("geometry_msgs/msg/PoseWithCovariance", pose=at, covariance=_NONE),
            "twist": message(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=_NONE
            ),
        }
        of = {"header": header(time_ns, NED), "child_frame_id": self._frame}
        return message("nav_msgs/msg/Odometry", **of, **parts)


class _Log(Converter):
    """Lines of the log."""

    def __init__(self, topic: str) -> None:
        self._topic = topic

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        kind, lines = "rcl_interfaces/msg/Log", _rows(table, "level", "name", "message")
        places = _rows(table, "file", "line")
        messages = [
            message(
                kind,
                stamp=stamp(time_ns),
                level=_LEVELS.get(int(level), 0),
                name=name,
                msg=text,
                file=file,
                function="",
                line=line,
            )
            for time_ns, (level, name, text), (file, line) in zip(
                _instants(table), lines, places, strict=True
            )
        ]
        yield Outgoing(self._topic, kind, _all(table), messages)


def _all(table: Table) -> Numbers:
    return np.arange(len(table))
