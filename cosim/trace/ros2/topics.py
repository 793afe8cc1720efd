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
from cosim.trace.ros2.cdr import Bytes, Message
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


class Outgoing(NamedTuple):
    """Messages of one ROS 2 topic.

    Attributes
    ----------
    rows : numbers of the rows that they come from, (k,).
    lines : the messages, uint8 (k, size), with room for a record's head.
    notes : of the topic: name, unit and description of a signal.
    """

    topic: str
    type: str
    rows: Numbers
    lines: Bytes
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


def _stamps(times_ns: NDArray[np.int64]) -> dict[str, Any]:
    seconds, nanos = np.divmod(times_ns, _NS)
    if seconds.size and not -(2**31) <= int(seconds.min()) <= int(seconds.max()) < 2**31:
        raise InputError(
            "an instant does not fit into a ROS 2 message",
            where="trace export --to ros2",
            expected=f"seconds below {2**31}",
            got=f"{int(np.abs(seconds).max())} s",
        )
    return {"sec": seconds, "nanosec": nanos}


def _groups(*columns: NDArray[Any]) -> Iterator[tuple[tuple[str, ...], Numbers]]:
    """Yield the distinct texts of rows, and the numbers of the rows that have them."""
    rows: dict[tuple[str, ...], list[int]] = {}
    for k, texts in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        rows.setdefault(texts, []).append(k)
    for texts, mine in rows.items():
        yield texts, np.array(mine, np.intp)


class _Signals(Converter):
    """A topic of rows: every signal is a topic of its own."""

    _TYPES: Mapping[str, tuple[str, str]] = {
        "float": ("std_msgs/msg/Float64", "d"),
        "int": ("std_msgs/msg/Int64", "q"),
        "bool": ("std_msgs/msg/Bool", "B"),
        "string": ("std_msgs/msg/String", ""),
    }

    def __init__(self, info: TopicInfo, names: _Names) -> None:
        fields = field_names([signal.name for signal in info.signals])
        self._topics = {
            signal: (names.free(f"{info.topic}/{field}"), *self._TYPES[signal.kind])
            for signal, field in zip(info.signals, fields, strict=True)
        }

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        for signal, (topic, kind, form) in self._topics.items():
            there = np.flatnonzero(table.present[signal.name])
            values = table[signal.name][there]
            known = {"name": signal.name, "unit": signal.unit, "description": signal.description}
            notes = {key: text for key, text in known.items() if text is not None}
            if form:
                lines = Message().value(form, column="data").filled(there.size, {"data": values})
                yield Outgoing(topic, kind, there, lines, notes)
                continue
            for (text,), mine in _groups(values):
                lines = Message().text(text).filled(mine.size, {})
                yield Outgoing(topic, kind, there[mine], lines, notes)


class _Poses(Converter):
    """Poses, and the path that those of a vehicle make: a pose, not a reference."""

    def __init__(self, topic: str, names: _Names) -> None:
        self._topic = topic
        self._path = Path() if topic.endswith("/pose") else None
        if self._path is not None:
            self._path_topic = names.free(f"{topic.rpartition('/')[0]}/path")
        self._last: tuple[str, int] | None = None

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        columns = {name: table[name] for name in (*_POSITION, *_TURN)}
        times = _stamps(table.log_time_ns)
        for (frame,), mine in _groups(table["frame_id"]):
            message = Message().header(frame).values("d", " ".join(columns))
            given = {name: values[mine] for name, values in {**times, **columns}.items()}
            lines = message.filled(mine.size, given)
            yield Outgoing(self._topic, "geometry_msgs/msg/PoseStamped", mine, lines)
        if self._path is not None and len(table):
            positions = np.column_stack([table[name] for name in _POSITION])
            for k, points in self._path.add(positions):
                yield self._message(table["frame_id"][k], int(table.log_time_ns[k]), points, k)
            self._last = table["frame_id"][-1], int(table.log_time_ns[-1])

    def last(self) -> Iterator[Outgoing]:
        if self._path is not None and self._last is not None:
            yield self._message(*self._last, self._path.points, 0)

    def _message(self, frame: str, time_ns: int, points: NDArray[Any], row: int) -> Outgoing:
        seconds, nanos = divmod(time_ns, _NS)
        message = Message().value("i", seconds).value("I", nanos).text(frame)
        message.value("I", len(points))
        for point in points.tolist():
            message.value("i", seconds).value("I", nanos).text(frame)
            for value in (*point, 0.0, 0.0, 0.0, 1.0):
                message.value("d", value)
        rows = np.array([row], np.intp)
        return Outgoing(self._path_topic, "nav_msgs/msg/Path", rows, message.filled(1, {}))


class _Frames(Converter):
    """Frames, one transform in each message."""

    def __init__(self, moving: str, static: str) -> None:
        self._topics = moving, static

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        names = [f"translation.{axis}" for axis in "xyz"] + [f"rotation.{a}" for a in "xyzw"]
        columns = {**_stamps(table.log_time_ns), **{name: table[name] for name in names}}
        frames = table["parent_frame_id"], table["child_frame_id"]
        for (parent, child), mine in _groups(*frames):
            message = Message().value("I", 1).header(parent).text(child)
            lines = message.values("d", " ".join(names)).filled(
                mine.size, {name: values[mine] for name, values in columns.items()}
            )
            topic = self._topics[(parent, child) == (MAP, NED)]
            yield Outgoing(topic, "tf2_msgs/msg/TFMessage", mine, lines)


class _Odometry(Converter):
    """Pose in the frame of the equations, and speed in the vehicle's; no covariance is known."""

    def __init__(self, topic: str, frame: str) -> None:
        self._topic = topic
        self._message = Message().header(NED).text(frame).values("d", "x y z qx qy qz qw")
        self._covariance().values("d", "u v w p q r")
        self._covariance()

    def _covariance(self) -> Message:
        for _ in range(36):
            self._message.value("d", 0.0)
        return self._message

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        columns = [table[name] for name in (*_ETA, *_NU)]
        x, y, z, psi, u, v, w, r = columns
        given = {**dict(zip("xyz", (x, y, z), strict=True)), "u": u, "v": v, "w": w, "r": r}
        turned = {"qz": np.sin(0.5 * psi), "qw": np.cos(0.5 * psi)}
        lines = self._message.filled(len(table), {**_stamps(table.log_time_ns), **given, **turned})
        yield Outgoing(self._topic, "nav_msgs/msg/Odometry", np.arange(len(table)), lines)


class _Log(Converter):
    """Lines of the log."""

    def __init__(self, topic: str) -> None:
        self._topic = topic

    def __call__(self, table: Table) -> Iterator[Outgoing]:
        levels = [_LEVELS.get(level, 0) for level in table["level"].tolist()]
        columns = {**_stamps(table.log_time_ns), "level": np.array(levels, np.int64)}
        texts = table["name"], table["message"], table["file"]
        for (name, message, file), mine in _groups(*texts):
            line = Message().stamp().value("B", column="level")
            line.text(name).text(message).text(file).text("").value("I", column="line")
            given = {**columns, "line": table["line"]}
            lines = line.filled(mine.size, {key: values[mine] for key, values in given.items()})
            yield Outgoing(self._topic, "rcl_interfaces/msg/Log", mine, lines)
