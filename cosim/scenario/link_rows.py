"""What measures ask of a packet link during a run, also where the run breaks off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.network import NONE_YET, LinkState

Integers = NDArray[np.int64]


def messages_in_use(instance: ComponentInstance, link: str, first: int, last: int) -> Integers:
    """Return the row that was sent in the message in use at each of the points, int64 (n,).

    -1 before the first message, -2 where the substitute is in use. -1 also at a point at which a
    message is sent whose delay was never known: a run breaks off there.
    """
    comm_points = instance.comm_points
    points = comm_points.points_ns[first:last]
    known = first + int(np.searchsorted(points, comm_points.links[link].horizon_ns))
    rows = np.full(last - first, NONE_YET, np.int64)
    if known > first:
        rows[: known - first] = comm_points.rows_of_messages(link, first, known)
    return rows


def link_state(instance: ComponentInstance, link: str, first: int, last: int) -> LinkState:
    """Return the state of a packet link at the points first to last - 1.

    Where a run breaks off at a point at which a message of unknown delay is sent, the state is
    the one before that message.
    """
    points = instance.comm_points.points_ns[first:last]
    return instance.comm_points.links[link].state(points, broken_off=True)


def changes_between(
    instance: ComponentInstance, link: str, after_ns: int, until_ns: int
) -> Integers:
    """Return the instants in (after, until] [ns] at which the message in use changes, int64 (m,).

    Strictly increasing, as far as they are known.
    """
    traffic = instance.comm_points.links[link]
    return traffic.changes(after_ns, min(until_ns, traffic.horizon_ns - 1))[0]
