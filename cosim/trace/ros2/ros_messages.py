"""Messages of ROS 2 and their definitions, those of the distribution Jazzy, by rosbags."""

from __future__ import annotations

import functools
from typing import Any

from cosim.core import optional

_NS = 10**9


@functools.cache
def _types() -> Any:
    """The types of the distribution, each with its class; an `InputError` without rosbags."""
    typesys = optional("rosbags.typesys", extra="ros2", what="exports to ROS 2")
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


def definition(kind: str) -> str:
    """Return the text of a type, `geometry_msgs/msg/PoseStamped`, with those it has in it."""
    text: str = _types().generate_msgdef(kind, ros_version=2)[0]
    return text


def serialised(kind: str, message: Any) -> bytes:
    """Return a message in CDR, little endian."""
    return bytes(_types().serialize_cdr(message, kind))


def message(kind: str, **fields: Any) -> Any:
    """Make a message of a type."""
    return _types().types[kind](**fields)


def stamp(time_ns: int) -> Any:
    """Return an instant."""
    seconds, nanos = divmod(time_ns, _NS)
    return message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanos)


def header(time_ns: int, frame: str) -> Any:
    """Return an instant and the frame in which something is."""
    return message("std_msgs/msg/Header", stamp=stamp(time_ns), frame_id=frame)


def vector(kind: str, xyz: Any) -> Any:
    """Return a Point or Vector3 of three numbers."""
    return message(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", xyz, strict=True)))


def turn(xyzw: Any) -> Any:
    """Return a quaternion of four numbers."""
    return message("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", xyzw, strict=True)))


def pose(xyz: Any, xyzw: Any) -> Any:
    """Return a place and a turn."""
    return message("geometry_msgs/msg/Pose", position=vector("Point", xyz), orientation=turn(xyzw))


def pose_stamped(time_ns: int, frame: str, at: Any) -> Any:
    """Return a pose at an instant, in a frame."""
    return message("geometry_msgs/msg/PoseStamped", header=header(time_ns, frame), pose=at)
