"""The message types of ROS 2 that a bag has, as their packages define them.

Texts of std_msgs, geometry_msgs, nav_msgs, tf2_msgs, rcl_interfaces and builtin_interfaces without
their comments; a schema is the text of a type and of all types in it.
"""

from __future__ import annotations

from collections.abc import Iterator

_DEFINITIONS = {
    "std_msgs/msg/Float64": "float64 data",
    "std_msgs/msg/Int64": "int64 data",
    "std_msgs/msg/Bool": "bool data",
    "std_msgs/msg/String": "string data",
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/msg/Pose": (
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"
    ),
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/msg/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/msg/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "nav_msgs/msg/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
    "rcl_interfaces/msg/Log": (
        "uint8 DEBUG=10\nuint8 INFO=20\nuint8 WARN=30\nuint8 ERROR=40\nuint8 FATAL=50\n"
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
        "string function\nuint32 line"
    ),
}

_RULE = "=" * 80


def definition(name: str) -> str:
    """Return the schema of a type, `geometry_msgs/msg/PoseStamped`, with those it has in it."""
    own, *others = dict.fromkeys(_needed(name))
    parts = [_DEFINITIONS[own]]
    parts += [f"MSG: {other.replace('/msg/', '/')}\n{_DEFINITIONS[other]}" for other in others]
    return f"\n{_RULE}\n".join(parts) + "\n"


def _needed(name: str) -> Iterator[str]:
    yield name
    for line in _DEFINITIONS[name].splitlines():
        package, slash, kind = line.split()[0].partition("/")
        if slash:
            yield from _needed(f"{package}/msg/{kind.removesuffix('[]')}")
