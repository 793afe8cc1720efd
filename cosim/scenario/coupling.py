"""Coupling delay: the delay that the exchange at communication points adds beyond the links.

An input is held over its receiver's step. The coupling delay is the age of the held value at
the end of that step, less the delay of the link: a step under Jacobi, nothing where the sender
has stepped before (Gauss-Seidel), half a step with policy "midpoint"; plus the wait for the own
points of a sender or receiver, and a point more under "previous". Messages are held on purpose:
they count only where a newer one was delivered and is not yet in use, or where the sender's value
was old when it was sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Route, Run, System
from cosim.network import PacketLink, TransportLink
from cosim.scenario.link_rows import changes_between, messages_in_use
from cosim.scenario.measure import Measure, after, measured

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]

_NEVER = np.iinfo(np.int64).max


def coupling_delays_s(run: Run, system: System) -> dict[str, float]:
    """Return the largest coupling delay [s] by connection.

    A key is `sender -> receiver` for a wire, `controller -> plant over downlink` for a link.
    """
    return measured(run, CouplingMeasure(system))


class CouplingMeasure(Measure[dict[str, float]]):
    """The largest coupling delay [s] by connection; empty for a run without a step."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._delays: list[tuple[str, _RouteDelay]] = []

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the routes."""
        by_name = {instance.name: instance for instance in instances}
        for receiver in instances:
            for route in receiver.routes:
                name = route.route_key.link
                words = f"{route.source} -> {receiver.name}" + (f" over {name}" if name else "")
                link = None if name is None else self._system.links[name]
                delay: _RouteDelay
                if isinstance(link, PacketLink):
                    delay = _MessageDelay(receiver, route, by_name[route.source])
                else:
                    delay = _SignalDelay(receiver, route, link)
                self._delays.append((words, delay))

    def add(self, first: int, last: int) -> None:
        """Take the steps that end at the points."""
        for _, delay in self._delays:
            delay.add(first, last)

    def result(self, run: Run) -> dict[str, float]:
        """Return the delays; a step that the run broke off counts up to there."""
        found: dict[str, float] = {}
        for words, delay in self._delays if run.count > 1 else ():
            late = float(delay.largest_ns(run.end_ns)) / 1e9
            found[words] = max(late, found.get(words, 0.0))
        return dict(sorted(found.items()))


class _RouteDelay(Protocol):
    """The coupling delays of the values that come by one route."""

    def add(self, first: int, last: int) -> None:
        """Take the steps of the receiver that end at the points first to last - 1."""

    def largest_ns(self, end_ns: int) -> float:
        """Return the largest, with that of the step during which the run ended [ns]."""


class _SignalDelay:
    """Values of a signal, by a wire or a transport link."""

    def __init__(
        self, receiver: ComponentInstance, route: Route, link: TransportLink | None
    ) -> None:
        self._receiver, self._used, self._link = receiver, route.in_step, link
        self._largest = 0.0
        self._begun_ns = 0
        self._taken: Reals | None = None
        self._awaited = False

    def add(self, first: int, last: int) -> None:
        """Take steps; what is held over the last one may be the row of the next point."""
        points = self._receiver.comm_points.points_ns
        if self._awaited:
            self._taken, self._awaited = points[first : first + 1].astype(np.float64), False
        own = self._receiver.own_points.own_between(first, last)
        if not own.size:
            return
        taken = after(self._taken, self._instants(own, last))
        due = self._due(points[own])[own.size - taken.size + 1 :]
        self._largest = max(self._largest, float((due - taken[:-1]).max(initial=0.0)))
        self._begun_ns, self._taken = int(points[own[-1]]), taken[-1:].copy()
        self._awaited = bool(self._used.row[own[-1]] >= last)

    def largest_ns(self, end_ns: int) -> float:
        """Return the largest delay [ns]."""
        if self._taken is None or self._begun_ns >= end_ns:
            return self._largest
        return max(self._largest, float((self._due(np.array([end_ns])) - self._taken)[0]))

    def _due(self, ends: Integers) -> Integers:
        return ends if self._link is None else self._link.read_ns(ends)

    def _instants(self, own: Integers, last: int) -> Reals:
        """Return the instants of the values that are held from own points on [ns]."""
        points, used = self._receiver.comm_points.points_ns, self._used
        row = used.row[own]
        # a value of the initialisation, row -1, is that of the first point
        taken = np.where(row >= 0, points[np.minimum(row, last - 1)], 0)
        origin = taken.astype(np.float64)
        if used.weight is not None and used.after is not None:
            later = np.minimum(used.after[own], last - 1)
            origin += used.weight[own] * (points[later] - taken)
        return origin


class _MessageDelay:
    """Values of messages, by a packet link."""

    def __init__(
        self,
        receiver: ComponentInstance,
        route: Route,
        sender: ComponentInstance,
    ) -> None:
        self._receiver, self._sender = receiver, sender
        self._link = str(route.route_key.link)
        self._later = route.route_key.policy == "previous"
        self._largest = 0
        self._point_ns = -1
        self._begun_ns = 0
        self._old_before: Integers | None = None
        self._old: Integers | None = None
        self._following: Integers | None = None

    def add(self, first: int, last: int) -> None:
        """Take steps."""
        points = self._receiver.comm_points.points_ns
        until_ns = int(points[last - 1])
        changes = changes_between(self._receiver, self._link, self._point_ns, until_ns)
        if self._following is not None and changes.size:
            self._following = np.minimum(self._following, changes[:1])
        own = self._receiver.own_points.own_between(first, last)
        old, read_at = self._read(first, last)
        if own.size:
            ends = points[own]
            place = np.searchsorted(changes, read_at[own - first], side="right")
            following = after(self._following, np.append(changes, _NEVER)[place])
            old = after(self._old, old[own - first])
            ends = ends[own.size - old.size + 1 :]
            self._compare(ends, following[:-1], old[:-1])
            self._begun_ns = int(points[own[-1]])
            self._following, self._old = following[-1:].copy(), old[-1:].copy()

    def largest_ns(self, end_ns: int) -> float:
        """Return the largest delay [ns]."""
        if self._following is not None and self._old is not None and self._begun_ns < end_ns:
            self._compare(np.array([end_ns]), self._following, self._old)
        return self._largest

    def _compare(self, ends: Integers, following: Integers, old: Integers) -> None:
        wait = np.where(following < ends, ends - following, 0)
        self._largest = max(self._largest, int((wait + old).max(initial=0)))

    def _read(self, first: int, last: int) -> tuple[Integers, Integers]:
        """Return how old values were when they were sent, and when the link's state is read [ns].

        For steps that begin at the points first to last - 1.
        """
        points = self._receiver.comm_points.points_ns
        used = messages_in_use(self._receiver, self._link, first, last)
        old = np.zeros(last - first, np.int64)
        real = used >= 0
        old[real] = points[used[real]] - points[self._sender.own_points.last[used[real]]]
        here = points[first:last]
        if not self._later:
            self._point_ns = int(here[-1])
            return old, here
        earlier = old[:1] if self._old_before is None else self._old_before
        before = np.array([max(self._point_ns, 0)])
        self._old_before, self._point_ns = old[-1:].copy(), int(here[-1])
        return np.concatenate((earlier, old[:-1])), np.concatenate((before, here[:-1]))
