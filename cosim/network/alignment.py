"""Align the schedules of links with the communication points.

Either every send and arrival becomes a communication point, or it is moved to an existing one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, distinct
from cosim.network.checks import check_choice
from cosim.network.grid import PointGrid, communication_points
from cosim.network.messages import resend_at
from cosim.network.packet_schedule import PacketSchedule
from cosim.network.scheduling import resolve_messages, shares_medium

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
    InputError : unknown policy, schedules of different runs, points out of order, a link over a
        medium on a grid (`growing_schedules`).
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
    return Alignment(distinct(np.concatenate(instants)), tuple(schedules))


def _on_grid(s: PacketSchedule, points: NDArray[np.int64]) -> PacketSchedule:
    if s.link.hop is not None:
        raise shares_medium(s.link)
    grid = PointGrid(points)
    sent = grid.up(s.messages.sent_ns)
    return resolve_messages(s.link, s.end_ns, resend_at(s.link, s.messages, sent), grid)
