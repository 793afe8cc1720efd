"""Which row of the sender each input reads at each communication point.

A route's rows are filled in for a block of points at a time, as these become known; an array is as
long as the run, so that a point has one index everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master.communication_points import BLOCK, CommunicationPoints, blocks
from cosim.master.communication_schedule import Link
from cosim.master.parts import Parts, RouteKey
from cosim.master.reserved import Reserved
from cosim.network import (
    DELIVERED,
    NONE_YET,
    PacketLink,
    TransportLink,
)

Integers = NDArray[np.int64]


_NONE: Integers = np.zeros(0, np.int64)


class _Sample(NamedTuple):
    """The rows read at some points: `row`, or between `row` and `after` by `weight`."""

    row: Integers
    after: Integers | None = None
    weight: NDArray[np.float64] | None = None


class RowsInUse:
    """Which rows are read at each point, as far as the points are known.

    A receiver with own points keeps between them what it read at the last one.

    Parameters
    ----------
    route_key : sender, link and policy.
    receiver : name of the receiver.
    stepped_before : the sender steps before the receiver (Gauss-Seidel), so that a connection
        without a link reads its outputs after the step.
    initialised : at the first point the inputs have the values that the initialisation settled on.

    Attributes
    ----------
    row : -1 none yet: the input keeps the value that the row has, -2 the link's substitute,
        int64 (most,).
    after : the second row of an interpolated value, int64 (most,); None without weights.
    weight : the value is (1 - weight) row + weight after, (most,); None: row alone.
    link : of the present run; None: a wire.
    initialised : at the first point the inputs have the values that the initialisation settled
        on: their senders' outputs at that point, which the row may not contain yet.

    Raises
    ------
    InputError : a policy that the link does not allow.
    """

    def __init__(
        self,
        system: Parts,
        comm_points: CommunicationPoints,
        route_key: RouteKey,
        receiver: str,
        *,
        stepped_before: bool,
        initialised: bool = False,
    ) -> None:
        self._key, self._stepped_before = route_key, stepped_before
        self.link: Link | None = None if route_key.link is None else system.links[route_key.link]
        self._points, self._step_ns = comm_points, system.comm_schedule.step_ns
        self._sender = comm_points.own_points[route_key.source]
        self._receiver = comm_points.own_points[receiver]
        self._later = route_key.policy == "previous"
        self._ahead = route_key.policy not in ("hold", "previous")
        if isinstance(self.link, PacketLink) and self._ahead:
            raise InputError(
                "over a packet link an input is held until the next message",
                where=f"connection {route_key}",
                expected="the policy hold or previous",
                got=route_key.policy,
            )
        interpolated = isinstance(self.link, TransportLink) or self._ahead
        most = comm_points.most
        self._settled = self._later or initialised
        plain = self.link is None and not (self._settled or self._ahead or stepped_before)
        self._is_last = plain and self._receiver.always
        kinds = (np.int64, np.int64, np.float64) if interpolated else (np.int64,)
        self._reserved = [] if self._is_last else [Reserved((most,), kind) for kind in kinds]
        # what a wire brings at every point is the sender's latest row: nothing of its own
        self.row: Integers = self._sender.last if self._is_last else self._reserved[0].array
        self.after: Integers | None = self._reserved[1].array if interpolated else None
        self.weight: NDArray[np.float64] | None = self._reserved[2].array if interpolated else None
        self.begin(system)

    def begin(self, system: Parts) -> None:
        """Begin a run of a system, whose points begin at 0: the first one, or another one."""
        name = self._key.link
        self.link = None if name is None else system.links[name]
        wired = self._stepped_before and self.link is not None and is_wire(system, self.link)
        self._at_once = self.link is None or wired
        # a message of unknown delay may be sent at the first point: only this one is known yet
        if self.link is not None and isinstance(self.link, PacketLink) and self.link.is_live:
            self.row[0] = NONE_YET
        elif self._settled or not self._points.ready:
            self.row[0] = self._sample(0, 1).row[0]
        self.initialised = self._settled and bool(self.row[0] >= 0)

    def fill(self, first: int, last: int) -> None:
        """Fill in the rows at the points first to last - 1, which are ready.

        Raises
        ------
        InputError : the middle of a step is not known when the step begins.
        """
        if self._is_last:
            return
        begin = max(first - self._later, 0)
        sample = self._sample(begin, last)
        for array, values in zip((self.row, self.after, self.weight), sample, strict=True):
            if array is None or values is None:
                continue
            if self._later:  # the first point has none before it
                values = np.concatenate([values[: begin - first + 1], values[:-1]])  # noqa: PLW2901
            array[first:last] = values
        if first == 0 and self._settled:
            self.row[0] = min(self.row[0], NONE_YET)
            if self.weight is not None:
                self.weight[0] = 0.0
        if not self._receiver.always:
            kept = self._receiver.last[first:last]
            for array in (self.row, self.after, self.weight):
                if array is not None:
                    array[first:last] = array[kept]

    def bare(self, first: int, last: int) -> Integers:
        """Return which of the points first to last - 1 read no row, counted from the first."""
        if self._is_last:
            return _NONE
        return np.flatnonzero(self.row[first:last] < 0)

    def oldest(self, first: int) -> int:
        """Return the first row that is read at point `first` or later.

        `first` : its row is filled in, as that of each later point that is ready.
        """
        before = max(first - 1, 0)
        rows = self.row[self._receiver.last[before] : self._points.ready]
        least = int(rows[rows >= 0].min(initial=first))
        later = self._sender.last[self._points.last_at(self._oldest_ns(before))]
        return max(min(least, int(later)) - self._later, 0)

    def _oldest_ns(self, k: int) -> int:
        """Return the instant of the oldest value read, or delivered, after point k [ns]."""
        now = int(self._points.points_ns[k])
        if isinstance(self.link, PacketLink):
            return self._points.links[self.link.name].oldest_awaited_ns(now)
        back = 0
        if self.link is not None:
            delay = self.link.delay
            back = self.link.delay_ns if delay is None else int(delay.delays_ns.max())
        # the line through the latest values begins before them
        return min(now - back, self._line_from(k))

    def give_back(self, before: int) -> None:
        """Give back the memory of the points before this one."""
        for reserved in self._reserved:
            reserved.give_back(before)

    def _sample(self, first: int, last: int) -> _Sample:
        """Return the rows that a receiver without own points reads, at `hold` for `previous`."""
        if self._at_once and not self._ahead:
            if not self._stepped_before:
                return _Sample(self._sender.last[first:last])
            here = np.minimum(np.arange(first, last) + 1, self._points.final)
            return _Sample(self._sender.last[here])
        if isinstance(self.link, PacketLink):
            row = self._points.rows_of_messages(self.link.name, first, last)
            return _Sample(np.where(row >= 0, self._sender.last[np.maximum(row, 0)], row))
        return self._interpolated(first, last, self.link)

    def _interpolated(self, first: int, last: int, link: TransportLink | None) -> _Sample:
        """Return rows and weights of a delayed continuous signal at the instants of the policy."""
        points = self._points.points_ns
        now = points[first:last]
        ahead = np.zeros(now.size, np.int64)
        if self._ahead:
            following = self._receiver.following[first:last]
            ends = points[np.maximum(following, 0)]
            ahead = np.where(following < 0, 0, ends - now) // 2
        wanted = now + ahead if link is None else link.read_ns(now + ahead)
        own = self._sent_from(min(int(wanted.min()), self._line_from(first)))
        sent = points[own]
        index = np.searchsorted(sent, wanted, side="right") - 1
        known = np.searchsorted(sent, now, side="right") - 1
        following = np.minimum(index + 1, sent.size - 1)
        past, gap = wanted - sent[index], np.maximum(sent[following] - sent[index], 1)
        weight = np.where(past > 0, past / gap, 0.0)
        beyond = (np.where(past > 0, following, index) > known) & (wanted > sent[known])
        # between two points of a slow sender the second is not known yet: the first is used
        weight = np.where(following > known, 0.0, weight)
        index = np.minimum(index, known)
        if self._key.policy == "linear":
            begin = _pair(sent, known, self._step_ns)
            span = np.maximum(sent[known] - sent[begin], 1)
            rest = np.where(known > begin, (wanted - sent[begin]) / span, 0.0)
            index, following = np.where(beyond, begin, index), np.where(beyond, known, following)
            weight = np.where(beyond, rest, weight)
        elif self._key.policy == "midpoint":
            self._check_known(first, beyond, ahead, now + ahead - wanted)
        if isinstance(own, slice):
            return _Sample(own.start + index, own.start + following, weight)
        return _Sample(own[index], own[following], weight)

    def _line_from(self, first: int) -> int:
        """Return the instant from which a line through the latest values may begin [ns]."""
        known = int(self._points.points_ns[self._sender.last[first]])
        return known - self._step_ns * self._ahead

    def _sent_from(self, instant_ns: int) -> slice | Integers:
        """Return the sender's points that are known, from the last one at an instant on."""
        begin = int(self._sender.last[self._points.last_at(instant_ns)])
        if self._sender.always:
            return slice(begin, self._points.count)
        return self._sender.own_between(begin, self._points.count)

    def _check_known(
        self, first: int, beyond: NDArray[np.bool_], ahead: Integers, back: Integers
    ) -> None:
        """Check that the middle of each step is known when the step begins."""
        points = self._points
        here = np.arange(first, first + beyond.size)
        steps = (self._receiver.following[here] >= 0) & (here != points.final)
        if not (beyond & steps).any():
            return
        k = int(np.argmax(beyond & steps))
        raise InputError(
            "the middle of a step is not known when the step begins",
            where=f"connection {self._key}",
            expected=f"a transport delay of at least {int(ahead[k]) / 1e9:g} s"
            " and a sender that steps as often",
            got=f"{int(back[k]) / 1e9:g} s",
            hint="the policy linear extrapolates",
        )


def _pair(sent: Integers, known: Integers, step_ns: int) -> Integers:
    """Return the first point of the line through the latest value: most of a step before it.

    A line through two points that lie close together, as events do, would amplify rounding.
    """
    return np.maximum(np.searchsorted(sent, sent[known] - (3 * step_ns) // 4, side="right") - 1, 0)


def walk(
    system: Parts, route_key: RouteKey, receiver: str
) -> Iterator[tuple[CommunicationPoints, RowsInUse, int, int]]:
    """Yield block by block, before the run, what a route reads: points, rows, first, last.

    Raises
    ------
    InputError : as `RowsInUse`.
    """
    points = CommunicationPoints(system, live=False)
    used = RowsInUse(system, points, route_key, receiver, stepped_before=False)
    first = 0
    while first < points.ready:
        used.fill(first, points.ready)
        yield points, used, first, points.ready
        before = min(used.oldest(points.ready - 1), points.ready - 1)
        first = points.ready
        points.give_back(before)
        used.give_back(before)
        points.extend()


def check_midpoint(system: Parts, route_key: RouteKey, receiver: str) -> None:
    """Check that the middle of every step is known when the step begins.

    Raises
    ------
    InputError : it is not, at some step of the run.
    """
    link = None if route_key.link is None else system.links[route_key.link]
    longest = system.components[receiver].every_ns or system.comm_schedule.step_ns
    every = system.components[route_key.source].every_ns
    if isinstance(link, TransportLink) and every is None:
        least = int(link.delay.delays_ns.min()) if link.delay is not None else link.delay_ns
        if 2 * least >= longest:
            return
    for _ in walk(system, route_key, receiver):
        pass


def is_wire(system: Parts, link: PacketLink | TransportLink) -> bool:
    """Whether a packet link brings every value at once: messages without delay, at every point."""
    if not isinstance(link, PacketLink) or link.is_live or system.grows:
        return False
    if link.least_transit_ns > 0:
        return False
    return all(
        (points.rows_of_messages(link.name, first, last) == np.arange(first, last)).all()
        for points, first, last in blocks(system)
    )


def delivers_at_once(system: Parts, link: PacketLink) -> bool:
    """Whether a message of a packet link may be delivered at the point at which it is sent."""
    if link.is_live:
        return True
    if link.least_transit_ns > 0:
        return False
    schedule = system.comm_schedule
    traffic, until, count = schedule.begin()[link.name], 0, 0
    while until < schedule.end_ns:
        until = min(until + BLOCK * schedule.step_ns, schedule.end_ns)
        traffic.advance(until)
        found = traffic.arrivals(count)
        if ((found.arrival_ns == found.sent_ns) & (found.status == DELIVERED)).any():
            return True
        count += found.arrival_ns.size
        traffic.forget(until)
    return False
