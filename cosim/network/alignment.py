"""Align the schedules of links with the communication points.

Either every send and arrival becomes a communication point, or it is moved to an existing one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.network.checks import check_choice, check_duration
from cosim.network.messages import resend_at
from cosim.network.packet_schedule import PacketSchedule
from cosim.network.scheduling import resolve_messages, rounded_up

AlignmentPolicy = Literal["align", "grid"]


class Alignment(NamedTuple):
    """Communication points, and the schedules whose sends and deliveries all lie on them."""

    points_ns: NDArray[np.int64]
    schedules: tuple[PacketSchedule, ...]


def align(
    schedules: Sequence[PacketSchedule],
    points_ns: int | ArrayLike,
    policy: AlignmentPolicy = "align",
) -> Alignment:
    """Return communication points and schedules in which every send and delivery is a point.

    Parameters
    ----------
    schedules : of all the links of one run (same end_ns).
    points_ns : communication points [ns], strictly increasing from 0 to end_ns; or the step
        [ns] of a uniform grid (its multiples up to end_ns, and end_ns itself).
    policy : "align": every instant of sending, of delivery and of a noticed loss (`on_loss`
        other than "hold") becomes a point, and the schedules stay as they are. "grid": the
        points stay; a message is sent at the first point at or after its instant, and arrives
        at the first point at or after that plus delay plus jitter, so that it is never early.
        A recorded delay is taken at the point of sending.

    Raises
    ------
    InputError : unknown policy, schedules of different runs, points out of order.
    """
    check_choice("align", "policy", policy, get_args(AlignmentPolicy))
    ends = {s.end_ns for s in schedules}
    if len(ends) > 1:
        raise InputError(
            "the schedules belong to runs of different length",
            where="align",
            expected="one end_ns",
            got=", ".join(f"{s.link.name}: {s.end_ns} ns" for s in schedules),
        )
    points = communication_points(points_ns, ends.pop() if ends else None)
    if policy == "grid":
        return Alignment(points, tuple(_on_grid(s, points) for s in schedules))
    instants = [points]
    for s in schedules:
        instants += [s.sent_ns, s.changes()[0]]
    return Alignment(np.unique(np.concatenate(instants)), tuple(schedules))


def communication_points(points_ns: int | ArrayLike, end_ns: int | None) -> NDArray[np.int64]:
    """Check the points of `align`, or lay out a grid for a step; int64 (n,)."""
    if isinstance(points_ns, (int, np.integer)):
        check_duration("align: step", points_ns, minimum=1)
        if end_ns is None:
            raise InputError(
                "with a step alone the end of the run is unknown",
                where="align",
                expected="at least one schedule, or the points themselves",
                got="no schedule",
            )
        return np.append(np.arange(0, end_ns, points_ns, dtype=np.int64), end_ns)
    points = np.asarray(points_ns)
    right = points.ndim == 1 and points.size > 0 and np.issubdtype(points.dtype, np.integer)
    if not right or points[0] != 0 or (np.diff(points) <= 0).any():
        raise InputError(
            "communication points out of order",
            where="align",
            expected="integers [ns], strictly increasing from 0",
            got=f"array of {points.dtype}, shape {points.shape}",
        )
    if end_ns is not None and points[-1] != end_ns:
        raise InputError(
            "the communication points do not end where the schedules do",
            where="align",
            expected=f"last point {end_ns} ns",
            got=f"{points[-1]} ns",
        )
    return points.astype(np.int64)


def _on_grid(s: PacketSchedule, points: NDArray[np.int64]) -> PacketSchedule:
    sent = rounded_up(s.messages.sent_ns, points)
    return resolve_messages(s.link, s.end_ns, resend_at(s.link, s.messages, sent), points)
