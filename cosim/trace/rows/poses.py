"""Encode many poses at once, `foxglove.PoseInFrame` and `FrameTransform`, as protobuf does.

proto3 omits zeros and writes integers in as few bytes as they need: poses with the same fields in
the same widths have messages of one shape, and are encoded together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cosim.trace.rows.wire import equal_rows, put_varints, varint, varint_lengths

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_SECOND = 10**9


def pose_messages(
    frame: str, time_ns: Integers, position: Reals, psi: Reals, room: int = 0
) -> Iterator[tuple[NDArray[np.intp], Bytes]]:
    """Yield numbers (k,) and messages, uint8 (k, room + size), of the poses of each shape.

    Parameters
    ----------
    frame : frame_id.
    time_ns : timestamps [ns], >= 0, (m,).
    position : x, y, z [m], (m, 3).
    psi : turn about z [rad], (m,).
    room : bytes left free in front of each message.
    """
    for mine, stamp, place, turn in _by_shape(time_ns, position, psi):
        pose = np.hstack([_message(0x0A, place), _message(0x12, turn)])
        parts = [_message(0x0A, stamp), _text(0x12, frame, mine.size), _message(0x1A, pose)]
        yield mine, np.hstack([np.zeros((mine.size, room), np.uint8), *parts])


def transform_messages(
    frames: tuple[str, str], time_ns: Integers, position: Reals, psi: Reals, room: int = 0
) -> Iterator[tuple[NDArray[np.intp], Bytes]]:
    """Yield the same poses as `foxglove.FrameTransform`: of a frame in its parent.

    frames : parent_frame_id, child_frame_id; the other arguments as for `pose_messages`.
    """
    for mine, stamp, place, turn in _by_shape(time_ns, position, psi):
        names = [
            _text(tag, name, mine.size) for tag, name in zip((0x12, 0x1A), frames, strict=True)
        ]
        parts = [_message(0x0A, stamp), *names, _message(0x22, place), _message(0x2A, turn)]
        yield mine, np.hstack([np.zeros((mine.size, room), np.uint8), *parts])


def _by_shape(
    time_ns: Integers, position: Reals, psi: Reals
) -> Iterator[tuple[NDArray[np.intp], Bytes, Bytes, Bytes]]:
    """Yield numbers, timestamps, positions and orientations of the poses of each shape."""
    if not time_ns.size:
        return
    seconds, nanos = np.divmod(time_ns, _SECOND)
    # sin and cos of the C library, as for a single pose: NumPy's differ in the last bit
    halves = (0.5 * psi).tolist()
    turn = np.array([(math.sin(half), math.cos(half)) for half in halves]).reshape(-1, 2)
    doubles = np.ascontiguousarray(np.column_stack([position, turn]), dtype="<f8")
    # what protobuf takes for zero is all bits zero: -0.0 is written
    there = doubles.view("<u8").reshape(doubles.shape) != 0
    shape = np.column_stack([_length(seconds), _length(nanos), there])
    for mine in equal_rows(shape):
        of_seconds, of_nanos, *given = shape[mine[0]].tolist()
        stamp = [_varint(0x08, seconds[mine], of_seconds), _varint(0x10, nanos[mine], of_nanos)]
        place = [_double(9 + 8 * j, doubles[mine, j]) for j in range(3) if given[j]]
        facing = [_double(25 + 8 * j, doubles[mine, 3 + j]) for j in range(2) if given[3 + j]]
        nothing = np.zeros((mine.size, 0), np.uint8)
        yield mine, np.hstack(stamp), np.hstack([nothing, *place]), np.hstack([nothing, *facing])


def _text(tag: int, text: str, count: int) -> Bytes:
    encoded = text.encode()
    field = np.frombuffer(bytes([tag]) + varint(len(encoded)) + encoded, np.uint8)
    return np.tile(field, (count, 1))


def _length(values: Integers) -> Integers:
    """Return the length of each varint; 0 for zero, which proto3 omits."""
    return np.where(values == 0, 0, varint_lengths(values))


def _varint(tag: int, values: Integers, length: int) -> Bytes:
    if length == 0:
        return np.zeros((values.size, 0), np.uint8)
    field = np.empty((values.size, 1 + length), np.uint8)
    field[:, 0] = tag
    put_varints(field[:, 1:], values)
    return field


def _double(tag: int, values: Reals) -> Bytes:
    head = np.full((values.size, 1), tag, np.uint8)
    body = np.ascontiguousarray(values, dtype="<f8").view(np.uint8).reshape(values.size, 8)
    return np.hstack([head, body])


def _message(tag: int, body: Bytes) -> Bytes:
    """Encode a field that has a message of fewer than 128 bytes."""
    head = np.tile(np.array([tag, body.shape[1]], np.uint8), (len(body), 1))
    return np.hstack([head, body])
