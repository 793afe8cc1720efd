"""Encode many poses at once, `foxglove.PoseInFrame` and `FrameTransform`, in a fixed width.

Every number is written, zeros too, and integers in so many bytes that every time has room: any
parser of protobuf reads that. All poses of a frame have one shape, and are filled together.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cosim.trace.rows.encode import tag, varint

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_SECOND = 10**9
_WIDTH = 5
"""Bytes of an integer, seven bits each: seconds up to 2**34, which log times in ns do not reach."""
_STAMP = b"".join(tag(n, 0) + b"\x80" * (_WIDTH - 1) + b"\0" for n in (1, 2))
_PLACE = b"".join(tag(n) + bytes(8) for n in (1, 2, 3))
_TURN = b"".join(tag(n) + bytes(8) for n in (3, 4))
"""Of messages with every number zero: seconds and nanos; x, y, z; z and w of a quaternion."""


def pose_messages(
    frame: str, time_ns: Integers, position: Reals, psi: Reals, room: int = 0
) -> Bytes:
    """Return messages, uint8 (m, room + size), of poses.

    Parameters
    ----------
    frame : frame_id.
    time_ns : timestamps [ns], >= 0, (m,).
    position : x, y, z [m], (m, 3).
    psi : turn about z [rad], (m,).
    room : bytes left free in front of each message.
    """
    pose = _field(1, _PLACE) + _field(2, _TURN)
    parts = [_field(1, _STAMP), _field(2, frame.encode()), _field(3, pose)]
    at = room + sum(map(len, parts[:2])) + 4
    return _filled(parts, time_ns, position, psi, room, (at, at + len(_field(1, _PLACE))))


def transform_messages(
    frames: tuple[str, str], time_ns: Integers, position: Reals, psi: Reals, room: int = 0
) -> Bytes:
    """Return the same poses as `foxglove.FrameTransform`: of a frame in its parent.

    frames : parent_frame_id, child_frame_id; the other arguments as for `pose_messages`.
    """
    names = [_field(number, name.encode()) for number, name in zip((2, 3), frames, strict=True)]
    parts = [_field(1, _STAMP), *names, _field(4, _PLACE), _field(5, _TURN)]
    at = room + sum(map(len, parts[:3])) + 2
    return _filled(parts, time_ns, position, psi, room, (at, at + len(parts[3])))


def _field(number: int, content: bytes) -> bytes:
    """Return a field with a text or a message."""
    return tag(number, 2) + varint(len(content)) + content


def _filled(
    parts: list[bytes],
    time_ns: Integers,
    position: Reals,
    psi: Reals,
    room: int,
    at: tuple[int, int],
) -> Bytes:
    """Return the messages; `at` : where the contents of place and turn begin in a line."""
    line = np.frombuffer(bytes(room) + b"".join(parts), np.uint8)
    lines = np.tile(line, (time_ns.size, 1))
    if not time_ns.size:
        return lines
    for k, values in enumerate(np.divmod(time_ns, _SECOND)):
        first = room + 3 + k * (_WIDTH + 1)
        for j in range(_WIDTH):
            lines[:, first + j] |= (values >> 7 * j & 0x7F).astype(np.uint8)
    # sin and cos of the C library, as for a single pose: NumPy's differ in the last bit
    halves = (0.5 * psi).tolist()
    turn = np.array([(math.sin(half), math.cos(half)) for half in halves]).reshape(-1, 2)
    for first, values in zip(at, (position, turn), strict=True):
        shape, strides = values.shape, (lines.shape[1], 9)
        into: Reals = np.ndarray(shape, "<f8", lines, first + 1, strides)
        into[:] = values
    return lines
