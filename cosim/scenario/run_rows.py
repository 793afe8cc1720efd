"""What measures ask of a run, its communication points and its links beside rows and routes.

Every question stands here once, so that measures do not depend on how a run keeps its points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run, System
from cosim.network import NONE_YET, LinkState

Integers = NDArray[np.int64]


def point_count(run: Run) -> int:
    """Return the number of points that a run has reached."""
    return run.points_ns.size


def end_ns(run: Run) -> int:
    """Return the time of the last point that a run has reached [ns]; 0 if it has reached none."""
    return int(run.points_ns[-1]) if run.points_ns.size else 0


def link_statistics(run: Run) -> dict[str, dict[str, Any]]:
    """Return the statistics of the packet links of a run, by name."""
    return {name: schedule.statistics() for name, schedule in run.schedules.items()}


def keep_option(*, keep: bool) -> dict[str, Any]:
    """Return the arguments with which a session keeps its rows, or not; today it always does."""
    del keep
    return {}


def most_points(system: System) -> int:
    """Return how many points a run to the end has, as far as it is known before the run."""
    return system.comm_schedule.points_ns.size


def planned_end_ns(instance: ComponentInstance) -> int:
    """Return the time at which the run ends if nothing ends it before [ns]."""
    return int(instance.comm_points.points_ns[-1])


def oldest_row(instance: ComponentInstance) -> int:
    """Return the first row that routes may still read; it never goes back."""
    return int(getattr(instance.comm_points, "oldest", 0))


def messages_in_use(instance: ComponentInstance, link: str, first: int, last: int) -> Integers:
    """Return the row that was sent in the message in use at each of the points, int64 (n,).

    -1 before the first message, -2 where the substitute is in use. -1 also at a point at which a
    message is sent whose delay was never known: a run breaks off there.
    """
    comm_points = instance.comm_points
    live = comm_points.live.get(link)
    known = last
    if live is not None:
        points = comm_points.points_ns[first:last]
        known = first + int(np.searchsorted(points, live.horizon_ns))
    rows = np.full(last - first, NONE_YET, np.int64)
    if known > first:
        rows[: known - first] = comm_points.rows_of_messages(link, first, known)
    return rows


def link_state(instance: ComponentInstance, link: str, first: int, last: int) -> LinkState:
    """Return the state of a packet link at the points first to last - 1.

    Where a run breaks off at a point at which a message of unknown delay is sent, the state is
    the one before that message.
    """
    comm_points = instance.comm_points
    live = comm_points.live.get(link)
    end = int(comm_points.points_ns[last - 1])
    if live is not None and end >= live.horizon_ns:
        return live.finish(end, broken_off=True).state(comm_points.points_ns[first:last])
    return comm_points.state(link, first, last)


class LinkChanges:
    """The instants at which the message in use over a packet link changes.

    Parameters
    ----------
    system : the system of the run.
    link : name of the link.
    """

    def __init__(self, system: System, link: str) -> None:
        self._link = link
        schedule = system.comm_schedule.schedules.get(link)
        self._known = None if schedule is None else schedule.changes()[0]

    def between(self, instance: ComponentInstance, after_ns: int, until_ns: int) -> Integers:
        """Return the instants in (after, until] [ns], int64 (m,), strictly increasing."""
        if self._known is not None:
            begin, end = np.searchsorted(self._known, [after_ns, until_ns], side="right")
            return self._known[begin:end]
        live, found = instance.comm_points.live[self._link], []
        change = live.next_change_ns(after_ns)
        while change is not None and change <= until_ns:
            found.append(change)
            change = live.next_change_ns(change)
        return np.array(found, np.int64)
