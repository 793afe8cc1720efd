"""Coupling delay: the delay that the exchange at communication points adds beyond the links.

An input is held over its receiver's step. The coupling delay is the age of the held value at
the end of that step, less the delay of the link: a step under Jacobi, nothing where the sender
has stepped before (Gauss-Seidel), half a step with policy "midpoint"; plus the wait for the own
points of a sender or receiver, and a point more under "previous". Messages are held on purpose:
they count only where a newer one was delivered and is not yet in use, or where the sender's value
was old when it was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Route, System
from cosim.network import PacketLink, TransportLink
from cosim.scenario.link_rows import changes_between, messages_in_use
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.signal_reader import own_points

Integers = NDArray[np.int64]

_NEVER = np.iinfo(np.int64).max

_Delays = Callable[[Integers, Integers], NDArray[Any]]
"""The own points at which steps of a receiver begin, at least one, and when they end [ns], to their
delays [ns]."""


@measure
def coupling_delays(run: MeasuredRun, system: System) -> Fold[dict[str, float]]:
    """Measure the largest coupling delay [s] by connection; empty for a run without a step.

    A key is `sender -> receiver` for a wire, `controller -> plant over downlink` for a link.
    """
    routes: list[tuple[str, ComponentInstance, _Delays]] = []
    for receiver in run.instances.values():
        for route in receiver.routes:
            name = route.route_key.link
            words = f"{route.source} -> {receiver.name}" + (f" over {name}" if name else "")
            link = None if name is None else system.links[name]
            delays: _Delays
            if isinstance(link, PacketLink):
                delays = partial(_of_messages, receiver, route, run.instances[route.source])
            else:
                delays = partial(_of_signal, receiver, route, link)
            routes.append((words, receiver, delays))
    largest = dict.fromkeys((words for words, _, _ in routes), 0.0)
    while block := (yield):
        for words, receiver, delays in routes:
            own = own_points(receiver, block)
            if own.size > 1:
                steps = delays(own[:-1], run.comm_points.points_ns[own[1:]])
                largest[words] = max(largest[words], float(steps.max()))
    if run.end.count < 2:
        return {}
    for words, receiver, delays in routes:  # a step that the run broke off counts up to there
        begin = receiver.own_points.last[run.end.count - 1 : run.end.count]
        if run.comm_points.points_ns[begin[0]] < run.end.end_ns:
            step = delays(begin, np.array([run.end.end_ns]))
            largest[words] = max(largest[words], float(step[0]))
    return {words: delay / 1e9 for words, delay in sorted(largest.items())}


def _of_signal(
    receiver: ComponentInstance,
    route: Route,
    link: TransportLink | None,
    begins: Integers,
    ends: Integers,
) -> NDArray[np.float64]:
    """Return the delays of values of a signal, by a wire or a transport link."""
    points, used = receiver.comm_points.points_ns, route.in_step
    row = used.row[begins]
    # a value of the initialisation, row -1, is that of the first point; a run may end before a row
    taken = np.where(row >= 0, np.minimum(points[row], ends), 0)
    origin = taken.astype(np.float64)
    if used.weight is not None and used.after is not None:
        origin += used.weight[begins] * (points[used.after[begins]] - taken)
    return np.asarray((ends if link is None else link.read_ns(ends)) - origin)


def _of_messages(
    receiver: ComponentInstance,
    route: Route,
    sender: ComponentInstance,
    begins: Integers,
    ends: Integers,
) -> Integers:
    """Return the delays of values of messages, by a packet link."""
    points, link = receiver.comm_points.points_ns, str(route.route_key.link)
    read = np.maximum(begins - (route.route_key.policy == "previous"), 0)
    used = messages_in_use(receiver, link, int(read[0]), int(read[-1]) + 1)[read - read[0]]
    sent = np.maximum(used, 0)
    old = np.where(used >= 0, points[sent] - points[sender.own_points.last[sent]], 0)
    changes = changes_between(receiver, link, int(points[read[0]]), int(ends[-1]))
    following = np.append(changes, _NEVER)[np.searchsorted(changes, points[read], side="right")]
    return np.asarray(old + np.where(following < ends, ends - following, 0))
