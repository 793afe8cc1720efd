"""Coupling delay: the delay that the exchange at communication points adds beyond the links.

An input is held over its receiver's step. The coupling delay is the age of the held value at
the end of that step, less the delay of the link: a step under Jacobi, nothing where the sender
has stepped before (Gauss-Seidel), half a step with policy "midpoint"; plus the wait for the own
points of a sender or receiver, and a point more under "previous". Messages are held on purpose:
they count only where a newer one was delivered and is not yet in use, or where the sender's value
was old when it was sent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Connection, Route, Run, System, receiving_order
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
    later = route.route_key.policy == "previous"
    ends = points[np.minimum(own_points.following[starts], points.size - 1)]
    link = None if route.route_key.link is None else system.links[route.route_key.link]
    if isinstance(link, PacketLink):
        schedule = run.schedules.get(link.name)
        sender = next(s for s in run.instances if s.name == route.source)
        if schedule is None:
            return 0.0
        read_at = points[np.maximum(starts - later, 0)]
        return _late_message(schedule, sender.own_points.last, points, read_at, ends)
    used = route.in_step
    # a value of the initialisation, row -1, is that of the first point
    row = np.clip(used.row[starts], 0, points.size - 1)
    origin = points[row].astype(np.float64)
    if used.weight is not None and used.after is not None:
        after = np.minimum(used.after[starts], points.size - 1)
        origin += used.weight[starts] * (points[after] - points[row])
    due = ends if link is None else link.read_ns(ends)
    return float((due - origin).max(initial=0.0))


def cut_delays_s(run: Run, system: System) -> dict[Connection, float]:
    """Return by connection that is cut because of unknown feedthrough the delay that this adds [s].

    That is the longest step of the run that ends at one of the receiver's points; a sender with a
    step of its own sends less often, and its step counts.
    """
    points = run.points_ns
    instances = {instance.name: instance for instance in run.instances}
    found = {}
    for c in receiving_order(system).cut:
        sender, receiver = (instances[end.component] for end in (c.source, c.target))
        own = receiver.own_points.own
        here = own[(own > 0) & (own < points.size)]
        sent = sender.own_points.last if c.link is None else np.arange(points.size)
        late = points[sent[here]] - points[sent[here - 1]]
        found[c] = float(late.max(initial=0)) / 1e9
    return found


def _late_message(
    schedule: PacketSchedule,
    sent_from: Integers,
    points: Integers,
    read_at: Integers,
    ends: Integers,
) -> float:
    """Return the coupling delay over a packet link; `read_at`: when its state is read."""
    times, messages = schedule.changes()
    place = np.searchsorted(times, read_at, side="right")
    following = np.append(times, np.iinfo(np.int64).max)[place]
    wait = np.where(following < ends, ends - following, 0)
    used = np.concatenate(([-1], messages))[place]
    real = used >= 0
    rows = np.searchsorted(points, schedule.sent_ns[used[real]])
    old = np.zeros(read_at.size, np.int64)
    old[real] = points[rows] - points[sent_from[rows]]
    return float((wait + old).max(initial=0))
