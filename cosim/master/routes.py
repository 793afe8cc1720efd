"""Routes from senders to receivers: which row is read at each point.

An input is constant during a step of its receiver. The policy says at which value:

* hold: the signal, delayed by its link, at the beginning of the step (order 1);
* midpoint: the delayed signal in the middle of the step, which must be known: over a transport
  link with a delay of at least half a step (order 2);
* linear: the same, extrapolated from past values where it is not known (order 2);
* previous: what hold reads at the communication point before, one step of delay more. At the
  first point it is the value that the initialisation settled on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_points import ComponentPoints
from cosim.master.parts import Policy
from cosim.master.system import System
from cosim.network import PacketLink, TransportLink

Integers = NDArray[np.int64]


LOOKING_AHEAD: tuple[Policy, ...] = ("midpoint", "linear")
"""Policies whose value is not that at the beginning of the step."""


class RouteKey(NamedTuple):
    """What connections of one route have in common."""

    source: str
    link: str | None
    policy: Policy

    def __str__(self) -> str:
        return f"from {self.source}" + (f" over {self.link}" if self.link else "")


class RowsInUse(NamedTuple):
    """Which rows are read at each point.

    Attributes
    ----------
    row : -1 none yet: the input keeps the value that the row has, -2 the link's substitute,
        int64 (n,).
    after : the second row of an interpolated value, int64 (n,); None without weights.
    weight : the value is (1 - weight) row + weight after, (n,); None: row alone.
    initialised : at the first point the inputs have the values that the initialisation settled
        on: their senders' outputs at that point, which the row may not contain yet.
    """

    row: Integers
    after: Integers | None = None
    weight: NDArray[np.float64] | None = None
    initialised: bool = False

    def from_initialisation(self) -> RowsInUse:
        """Return the same rows, but at the first point the value of the initialisation."""
        first = np.arange(self.row.size) == 0
        weight = None if self.weight is None else np.where(first, 0.0, self.weight)
        return RowsInUse(
            np.where(first & (self.row >= 0), -1, self.row),
            self.after,
            weight,
            initialised=bool(self.row[0] >= 0),
        )

    def one_point_later(self) -> RowsInUse:
        """Return the rows that were read one point earlier."""
        before = np.maximum(np.arange(self.row.size) - 1, 0)
        parts = (None if part is None else part[before] for part in self[:3])
        return RowsInUse(*parts).from_initialisation()  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Route:
    """Inputs of one component that read outputs of one other over the same link and policy.

    Attributes
    ----------
    route_key : sender, link and policy.
    columns, targets : columns of the rows that are read and written.
    in_step : the rows read for the step from each point.
    at_point : those read for the outputs of the point itself, where they are others: the receiver
        has direct feedthrough, and its policy looks ahead.
    link : the packet link, or None.
    initialised : as in `RowsInUse`.
    """

    route_key: RouteKey
    columns: NDArray[np.intp]
    targets: NDArray[np.intp]
    in_step: RowsInUse
    link: PacketLink | None
    at_point: RowsInUse | None = None
    initialised: bool = False

    @property
    def at_start(self) -> bool:
        """Whether the inputs have a value of the sender at the first point."""
        return self.initialised or bool(self.in_step.row[0] >= 0)

    @property
    def source(self) -> str:
        """Name of the sender."""
        return self.route_key.source

    @cached_property
    def spans(self) -> tuple[slice, slice] | None:
        """The columns read and written as slices, where both are neighbours; else None."""
        pairs = np.column_stack([self.columns, self.targets])
        if not (np.diff(pairs, axis=0) == 1).all():
            return None
        (source, target), count = pairs[0].tolist(), len(pairs)
        return slice(source, source + count), slice(target, target + count)

    @cached_property
    def verbatim(self) -> bool:
        """Whether its values are neighbours, in the sender's row and the receiver's, unaltered."""
        altered = self.in_step.weight is not None or (
            self.link is not None and (self.link.quantization or self.link.on_loss != "hold")
        )
        return not altered and self.spans is not None


RouteFiller = Callable[[int, int], None]
"""Sets the rows that a route reads at the points first to last - 1."""


def growing_rows_in_use(
    system: System,
    comm_points: CommunicationPoints,
    route_key: RouteKey,
    *,
    stepped_before: bool,
    initialised: bool = False,
) -> tuple[RowsInUse, RouteFiller | None]:
    """Return as `rows_in_use` for points that are added during the run, and what sets the rows.

    `initialised` : as `RowsInUse.from_initialisation`.
    """
    hold, fill = _growing(system, comm_points, route_key, stepped_before=stepped_before)
    later = route_key.policy == "previous"
    if not (later or initialised):
        return hold, fill
    name = route_key.link
    if name is None or fill is None:
        return hold.one_point_later(), None
    if isinstance(system.links[name], PacketLink):
        known = name not in comm_points.live
        initialised = known and bool(comm_points.rows_of_messages(name, 0, 1)[0] >= 0)
    else:
        initialised = True
    found = RowsInUse(*(None if part is None else part.copy() for part in hold[:3]))  # type: ignore[arg-type]

    def fill_later(first: int, last: int) -> None:
        fill(first, last)
        start = max(first, 1)
        for mine, of_hold in zip(found[:3], hold[:3], strict=True):
            if mine is not None and of_hold is not None and start < last:
                mine[start:last] = of_hold[start - later : last - later]

    return found._replace(initialised=initialised), fill_later


def _growing(
    system: System, comm_points: CommunicationPoints, route_key: RouteKey, *, stepped_before: bool
) -> tuple[RowsInUse, RouteFiller | None]:
    most = comm_points.points_ns.size
    here = np.arange(most)
    channel = None if route_key.link is None else system.links[route_key.link]
    if channel is None:
        row = here + stepped_before

        def end(first: int, last: int) -> None:
            if first <= comm_points.final < last:
                row[comm_points.final] = comm_points.final

        return RowsInUse(row), end if stepped_before else None
    row = np.full(most, -1, np.int64)
    if isinstance(channel, PacketLink):
        name = channel.name

        def fill(first: int, last: int) -> None:
            row[first:last] = comm_points.rows_of_messages(name, first, last)

        return RowsInUse(row), fill
    after, weight = row.copy(), np.zeros(most)

    def interpolate(first: int, last: int) -> None:
        index, weight[first:last] = channel.rows(comm_points.points_ns[:last], first)
        row[first:last], after[first:last] = index, np.minimum(index + 1, last - 1)

    return RowsInUse(row, after, weight), interpolate


def rows_in_use(
    system: System,
    route_key: RouteKey,
    sender: ComponentPoints,
    receiver: ComponentPoints,
    *,
    stepped_before: bool,
) -> RowsInUse:
    """Return the rows that a receiver reads at its own points, kept in between.

    `stepped_before` : the sender steps before the receiver (Gauss-Seidel), so that a connection
    without a link reads its outputs after the step.

    Raises
    ------
    InputError : a policy that the link does not allow.
    """
    points = system.comm_schedule.points_ns
    channel = None if route_key.link is None else system.links[route_key.link]
    here = np.arange(points.size)
    later = route_key.policy == "previous"
    if later:
        route_key = route_key._replace(policy="hold")
    if isinstance(channel, PacketLink):
        if route_key.policy != "hold":
            raise InputError(
                "over a packet link an input is held until the next message",
                where=f"connection {route_key}",
                expected="the policy hold or previous",
                got=route_key.policy,
            )
        row = system.comm_schedule.schedules[channel.name].rows(points)
        found = RowsInUse(np.where(row >= 0, sender.last[np.maximum(row, 0)], row))
        if (row == here).all():  # no delay at all: as without a link
            channel = None
    if channel is None and route_key.policy == "hold":
        sender_rows = np.minimum(here + 1, points.size - 1) if stepped_before else here
        found = RowsInUse(sender.last[sender_rows])
    elif not isinstance(channel, PacketLink):
        found = _sampled(system, route_key, channel, sender, receiver)
    if later:
        found = found.one_point_later()
    return found if receiver.always else _at_own_points(found, receiver)


def _at_own_points(found: RowsInUse, receiver: ComponentPoints) -> RowsInUse:
    rows = RowsInUse(*(None if part is None else part[receiver.last] for part in found[:3]))  # type: ignore[arg-type]
    return rows._replace(initialised=found.initialised)


def _sampled(
    system: System,
    route_key: RouteKey,
    channel: TransportLink | None,
    sender: ComponentPoints,
    receiver: ComponentPoints,
) -> RowsInUse:
    """Return rows and weights of a delayed continuous signal at the instants of the policy."""
    points = system.comm_schedule.points_ns
    ahead = np.zeros(points.size, np.int64)
    if route_key.policy != "hold":
        ends = points[np.maximum(receiver.following, 0)]
        ahead = np.where(receiver.following < 0, 0, ends - points) // 2
    wanted = points + ahead if channel is None else channel.read_ns(points + ahead)
    sent = points[sender.own]
    index = np.searchsorted(sent, wanted, side="right") - 1
    known = np.searchsorted(sent, points, side="right") - 1
    following = np.minimum(index + 1, sent.size - 1)
    past, gap = wanted - sent[index], np.maximum(sent[following] - sent[index], 1)
    weight = np.where(past > 0, past / gap, 0.0)
    beyond = (np.where(past > 0, following, index) > known) & (wanted > sent[known])
    # between two points of a slow sender the second is not known yet: the first is used
    weight = np.where(following > known, 0.0, weight)
    index = np.minimum(index, known)
    if route_key.policy == "linear":
        first = _pair(sent, known, system.comm_schedule.step_ns)
        span = np.maximum(sent[known] - sent[first], 1)
        rest = np.where(known > first, (wanted - sent[first]) / span, 0.0)
        index, following = np.where(beyond, first, index), np.where(beyond, known, following)
        weight = np.where(beyond, rest, weight)
    elif route_key.policy == "midpoint" and beyond[receiver.own[:-1]].any():
        k = int(receiver.own[np.argmax(beyond[receiver.own])])
        raise InputError(
            "the middle of a step is not known when the step begins",
            where=f"connection {route_key}",
            expected=f"a transport delay of at least {int(ahead[k]) / 1e9:g} s"
            " and a sender that steps as often",
            got=f"{int(points[k] + ahead[k] - wanted[k]) / 1e9:g} s",
            hint="the policy linear extrapolates",
        )
    own = sender.own
    return RowsInUse(own[index], own[np.minimum(following, sent.size - 1)], weight)


def _pair(sent: Integers, known: Integers, step_ns: int) -> Integers:
    """Return the first point of the line through the latest value: most of a step before it.

    A line through two points that lie close together, as events do, would amplify rounding.
    """
    return np.maximum(np.searchsorted(sent, sent[known] - (3 * step_ns) // 4, side="right") - 1, 0)
