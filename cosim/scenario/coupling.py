"""Coupling delay: the delay that the exchange at communication points adds beyond the links.

An input is held over its receiver's step. The coupling delay is the age of the held value at
the end of that step, less the delay of the link: a step under Jacobi, nothing where the sender
has stepped before (Gauss-Seidel), half a step with policy "midpoint"; plus the wait for the own
points of a sender or receiver. Messages are held on purpose: they count only where a newer one
was delivered and is not yet in use, or where the sender's value was old when it was sent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Route, Run, System
from cosim.network import PacketLink, PacketSchedule

Integers = NDArray[np.int64]


def coupling_delays_s(run: Run, system: System) -> dict[str, float]:
    """Return the largest coupling delay [s] by connection.

    A key is `sender -> receiver` for a wire, `controller -> plant over downlink` for a link.
    """
    found: dict[str, float] = {}
    if run.points_ns.size < 2:
        return found
    for instance in run.instances:
        for route in instance.routes:
            over = f" over {route.route_key.link}" if route.route_key.link else ""
            words = f"{route.source} -> {instance.name}{over}"
            late = float(_late_ns(run, system, instance, route)) / 1e9
            found[words] = max(late, found.get(words, 0.0))
    return dict(sorted(found.items()))


def _late_ns(run: Run, system: System, receiver: ComponentInstance, route: Route) -> float:
    points = run.points_ns
    own_points = receiver.own_points
    starts = own_points.own[own_points.own < points.size - 1]
    ends = points[np.minimum(own_points.following[starts], points.size - 1)]
    link = None if route.route_key.link is None else system.links[route.route_key.link]
    if isinstance(link, PacketLink):
        schedule = run.schedules.get(link.name)
        sender = next(s for s in run.instances if s.name == route.source)
        if schedule is None:
            return 0.0
        return _late_message(schedule, sender.own_points.last, points, points[starts], ends)
    used = route.in_step
    row = np.minimum(used.row[starts], points.size - 1)
    origin = points[row].astype(np.float64)
    if used.weight is not None and used.after is not None:
        after = np.minimum(used.after[starts], points.size - 1)
        origin += used.weight[starts] * (points[after] - points[row])
    due = ends if link is None else link.read_ns(ends)
    return float((due - origin).max(initial=0.0))


def _late_message(
    schedule: PacketSchedule,
    sent_from: Integers,
    points: Integers,
    starts: Integers,
    ends: Integers,
) -> float:
    times, messages = schedule.changes()
    place = np.searchsorted(times, starts, side="right")
    following = np.append(times, np.iinfo(np.int64).max)[place]
    wait = np.where(following < ends, ends - following, 0)
    used = np.concatenate(([-1], messages))[place]
    real = used >= 0
    rows = np.searchsorted(points, schedule.sent_ns[used[real]])
    old = np.zeros(starts.size, np.int64)
    old[real] = points[rows] - points[sent_from[rows]]
    return float((wait + old).max(initial=0))
