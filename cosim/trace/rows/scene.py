"""What a 3D view shows of a vehicle beside its poses: the hull, and the path flown so far.

Both are `foxglove.SceneUpdate`. The hull is one message in the vehicle's frame. The path is written
anew every so often, whole, since a view that jumps to an instant gets only the last message before
it: a bounded number of points, ever farther apart, and ever fewer messages.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.rows import foxglove

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]

HULL_LENGTH_M = 5.3
"""Length of the NPS AUV II, `length` of its model (Table 1 of the paper)."""

HULL_DIAMETER_M = 1.19
"""Diameter at which a cylinder of that length with round ends displaces its 5454 kg of water."""

MOST_POINTS = 256
"""Most points of a path; beyond, every second one is left out."""

SCENE_PERIOD_NS = 100_000_000
"""Frames, references and states of links are written at the first instant in each tenth second."""

_POINTS_PER_METRE = 1024.0
"""Points of a path are rounded to about a millimetre: fewer digits take less room."""

_FARTHEST_M = 1e6
_LEAST_ROWS = 32
"""Least number of poses between two messages of a path."""

_YELLOW = {"r": 0.95, "g": 0.75, "b": 0.1, "a": 1.0}
_DARK = {"r": 0.2, "g": 0.2, "b": 0.25, "a": 1.0}
_BLUE = {"r": 0.15, "g": 0.55, "b": 0.95, "a": 1.0}
_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_ALONG_X = {"x": 0.0, "y": math.sqrt(0.5), "z": 0.0, "w": math.sqrt(0.5)}
"""Turns a cylinder, which stands along z, to lie along x."""


def hull(time_ns: int, vehicle: str) -> bytes:
    """Encode the hull in the frame of a vehicle (x ahead, y to starboard, z down).

    A cylinder with a round bow and stern; a fin astern on top says which way it looks.
    """
    straight = HULL_LENGTH_M - HULL_DIAMETER_M
    across = dict.fromkeys("xyz", HULL_DIAMETER_M)
    tube = {"x": HULL_DIAMETER_M, "y": HULL_DIAMETER_M, "z": straight}
    fin = {"x": 0.1 * HULL_LENGTH_M, "y": 0.1 * HULL_DIAMETER_M, "z": 0.5 * HULL_DIAMETER_M}
    on_top = {"x": -0.4 * straight, "y": 0.0, "z": -0.6 * HULL_DIAMETER_M}
    entity = {
        "frame_id": vehicle,
        "id": f"{vehicle} hull",
        "frame_locked": True,
        "cylinders": [
            {
                "pose": {"position": {}, "orientation": _ALONG_X},
                "size": tube,
                "bottom_scale": 1.0,
                "top_scale": 1.0,
                "color": _YELLOW,
            }
        ],
        "spheres": [
            {
                "pose": {"position": {"x": side * 0.5 * straight}, "orientation": _UPRIGHT},
                "size": across,
                "color": color,
            }
            for side, color in ((1, _DARK), (-1, _YELLOW))
        ],
        "cubes": [
            {
                "pose": {"position": on_top, "orientation": _UPRIGHT},
                "size": fin,
                "color": _DARK,
            }
        ],
    }
    return _update(time_ns, entity)


class Thinned:
    """Chooses the first instant in each tenth of a second."""

    def __init__(self) -> None:
        self._latest = -1

    def __call__(self, times_ns: Integers) -> NDArray[np.intp]:
        """Return which of the next instants are chosen, (k,)."""
        tenths = times_ns // SCENE_PERIOD_NS
        chosen = np.flatnonzero(np.diff(tenths, prepend=self._latest) > 0)
        self._latest = int(tenths[-1]) if tenths.size else self._latest
        return chosen


class Path:
    """The path of a vehicle, gathered while its poses come about.

    Attributes
    ----------
    points : kept so far, and the last position, (n, 3) [m], n <= `MOST_POINTS` + 1.
    """

    def __init__(self) -> None:
        self._stride, self._count, self._due = 1, 0, _LEAST_ROWS
        self._kept = np.zeros((0, 3))
        self._last = np.zeros((0, 3))

    @property
    def points(self) -> Reals:
        """See the class."""
        return np.vstack([self._kept, self._last])

    def add(self, position: Reals) -> list[tuple[int, Reals]]:
        """Take the next positions, (m, 3) [m]; return the paths that are due, by number of pose.

        What is no place in a picture, NaN or more than 1,000 km away, is left out.
        """
        found = []
        begin = 0
        while begin < len(position):
            end = min(begin + self._due - self._count, len(position))
            self._take(position[begin:end])
            begin = end
            if self._count == self._due:
                self._due += max(2 * len(self._kept), _LEAST_ROWS)
                found.append((end - 1, self.points))
        return found

    def _take(self, position: Reals) -> None:
        first = -self._count % self._stride
        self._count += len(position)
        there = np.abs(position).max(axis=1) < _FARTHEST_M  # false of NaN
        position = np.rint(np.where(there[:, None], position, 0.0) * _POINTS_PER_METRE)
        kept = there & (np.arange(len(position)) % self._stride == first)
        self._kept = np.concatenate([self._kept, position[kept] / _POINTS_PER_METRE])
        if there.any():
            self._last = position[there][-1:] / _POINTS_PER_METRE
        while len(self._kept) > MOST_POINTS:
            self._kept = self._kept[::2]
            self._stride *= 2


def path(time_ns: int, vehicle: str, frame: str, points: Reals) -> bytes:
    """Encode the path of a vehicle up to an instant [ns]; points in the frame, (n, 3) [m]."""
    line = {
        "type": 0,
        "pose": {"position": {}, "orientation": _UPRIGHT},
        "thickness": 2.0,
        "scale_invariant": True,
        "points": [{"x": x, "y": y, "z": z} for x, y, z in points.tolist()],
        "color": _BLUE,
    }
    return _update(time_ns, {"frame_id": frame, "id": f"{vehicle} path", "lines": [line]})


def _update(time_ns: int, entity: dict[str, Any]) -> bytes:
    message = foxglove.message_type("foxglove.SceneUpdate")
    filled = message(entities=[{"timestamp": foxglove.stamp(time_ns), **entity}])
    data: bytes = filled.SerializeToString(deterministic=True)
    return data
