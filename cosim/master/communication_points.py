"""The communication points of a run, which become known block by block.

How far they are known depends on the links: the arrival of a message, which is a point, is known
when the message is sent; where its delay follows a signal of the run, when the loop has reached
that point. Where components have events, each point becomes known when the steps to it are made:
an event may come first, and several points may have one instant. A point keeps its index for the
whole run, in arrays that are reserved for all of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice, takewhile
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, distinct
from cosim.master.communication_schedule import CommunicationSchedule
from cosim.master.component_points import ComponentPoints
from cosim.master.event_values import EventValues
from cosim.master.parts import Parts
from cosim.master.reserved import Reserved
from cosim.network import (
    SUBSTITUTE,
    Arrivals,
    Delivery,
    LinkState,
    MediumDelivery,
    PacketLink,
    Traffic,
)

Integers = NDArray[np.int64]
Rows = NDArray[np.float64]

BLOCK: Final = 1 << 15
"""Most steps of a run in a block: most runs are one block."""
_EVENTS, _MORE_EVENTS = 8, 100_000
"""Room for so many points per planned one, and so many more, where components have events."""


class CommunicationPoints:
    """The communication points of a run, and its packet links, as far as they are known.

    Parameters
    ----------
    live : whether the run has its links whose delays follow a signal; without them the points on a
        grid are known before it.
    block : steps of the run in a block; nothing but time and memory depends on it.

    Attributes
    ----------
    most : room for points; the index of the spare row.
    points_ns : the points [ns], int64 (most,); `count` of them are known.
    seconds, sizes : the points by the clock of the components [s], which is later than the run by
        the schedule's `start_ns`, and the step from each to the next [s], (most,).
    final : index of the last point of the run; `most` as long as it is not known.
    ready : number of points at which it is known what is read and where each step ends.
    crossing : whether a message of unknown delay is sent at point `ready`.
    oldest : the first point that may still be asked for.
    end_ns : the end of the run [ns].
    own_points : by component.
    links : the packet links, by name.
    values : by live link, the values of its delay signal so far, 0 if it follows none; by live
        medium, the places of its nodes.
    event_values : what events have set; of adjustable links `NAME.delay` [ns] and `NAME.loss`.
    modes : the mode machines, whose states are event values by their names.
    live : the links whose delays follow a signal of the run or may be changed, and the media that
        such links share or whose nodes move.
    grows : whether points depend on signals of the run.
    has_events : whether points are added one at a time, as events occur (`add`).
    on_new : called with the index of the first of the points that were added, and their instants,
        [ns] and [s].
    """

    def __init__(self, system: Parts, *, live: bool = True, block: int = BLOCK) -> None:
        self._schedule, self._delays = system.comm_schedule, system.delays
        self._with_live, self._block_ns = live, block * self._schedule.step_ns
        self.most, self.end_ns = self._schedule.most, self._schedule.end_ns
        self.grows, self.has_events = self._schedule.grows, live and system.has_events
        self.on_new: Callable[[int, Integers, Rows], None] | None = None
        self.event_values, self.modes = EventValues(), system.modes
        if self.has_events:
            self.most = _EVENTS * self.most + _MORE_EVENTS
        kinds = (np.int64, float, float)
        self._reserved = [Reserved((self.most,), kind, large_pages=True) for kind in kinds]
        self.points_ns, self.seconds, self.sizes = (one.array for one in self._reserved)
        steps = dict.fromkeys(component.every_ns for component in system.components.values())
        self._steps = {every: ComponentPoints(every, self.most) for every in (*steps, None)}
        self.own_points = {n: self._steps[c.every_ns] for n, c in system.components.items()}
        self._begin()

    def begin_again(self, schedule: CommunicationSchedule) -> None:
        """Begin another run, by a schedule that differs in links only and has as much room.

        Nothing may have been given back.
        """
        self._schedule = schedule
        self.event_values.restore({})
        if self.links or self.final == self.most:
            self._begin()

    def _begin(self) -> None:
        self.count = self.oldest = self.ready = 0
        self.final = self.most
        self._planned: deque[int] = deque()
        self._planned_until = -1
        self.links: Mapping[str, Delivery] = {
            name: link
            for name, link in self._schedule.begin().items()
            if self._with_live or not link.is_live
        }
        self.live = {
            link.link.resolved_with: link.traffic if isinstance(link, MediumDelivery) else link
            for link in self.links.values()
            if link.is_live
        }
        self._greatest_ages = {
            name: link.greatest_age_ns
            for name, link in self._schedule.links.items()
            if isinstance(link, PacketLink) and link.greatest_age_ns
        }
        self.values: dict[str, list[Any]] = {name: [] for name in self.live}
        for points in self._steps.values():
            points.latest = -1
        if self.has_events:
            self.crossing = True
            self.add(0, 0.0)
        else:
            self.extend()

    def at_s(self, time_ns: int) -> float:
        """Return an instant of the run by the clock of the components [s]."""
        return self._schedule.at_s(time_ns)

    @property
    def start_ns(self) -> int:
        """The time of the components at the beginning of the run [ns]."""
        return self._schedule.start_ns

    def mode(self, machine: str, first: int, last: int) -> Integers:
        """Return the number of the state that a machine is in at points first to last - 1."""
        numbers = self.event_values.read(machine, self.points_ns[first:last])
        initial = self.modes[machine].initial
        return np.where(np.isnan(numbers), initial, numbers).astype(np.int64)

    def planned(self) -> int:
        """Return the next instant that is a point, whatever events come before it [ns].

        That is one of the grid, of a step or an instant of the scenario, or of a message.
        """
        now = int(self.points_ns[self.count - 1])
        while not self._planned or self._planned[0] <= now:
            if self._planned:
                self._planned.popleft()
            else:
                self._plan()
        return self._planned[0]

    def _plan(self) -> None:
        """Plan the instants of another block."""
        until = min(max(self._planned_until, 0) + self._block_ns, self.end_ns)
        self._planned.extend(self._instants(self._planned_until, until).tolist())
        self._planned_until = until

    def add(self, instant_ns: int, seconds: float) -> None:
        """Add a point, at the instant of the last one or later, where components have events.

        `seconds` : the instant as the components are told it: that of an event as its component
        gave it.

        Raises
        ------
        InputError : there are too many.
        """
        self.replace_from(self.count, np.array([instant_ns]), np.array([seconds]))

    def replace_from(self, first: int, instants_ns: Integers, seconds: Rows) -> None:
        """Let these be the points from index `first` on, in place of those that were added there.

        Raises
        ------
        InputError : there are too many.
        """
        last = first + instants_ns.size
        if last >= self.most:
            raise InputError(
                "the events of the run add too many points",
                where="run",
                expected=f"at most {self.most}: {_EVENTS} per planned point, {_MORE_EVENTS} more",
                hint="look at the components that ask for events, in the trace",
            )
        while self._planned_until < instants_ns[-1]:  # the links must know
            self._plan()
        self.points_ns[first:last], self.seconds[first:last] = instants_ns, seconds
        before = max(first - 1, 0)
        times, exact = self.points_ns[before:last], self.seconds[before:last]
        whole = exact == times / 1e9
        sizes = np.where(whole[1:] & whole[:-1], np.diff(times) / 1e9, np.diff(exact))
        self.sizes[before : last - 1] = sizes
        self.count, self.ready = last, last - 1
        for points in self._steps.values():
            points.extend(self.points_ns, first, last, self.end_ns)
        if self.on_new is not None:
            self.on_new(first, instants_ns, seconds)

    def planned_before(self, limit_ns: int, most: int) -> Integers:
        """Return the next instants that are points, before another one [ns], at most so many."""
        self.planned()
        return np.array([*takewhile(lambda t: t < limit_ns, islice(self._planned, most))], np.int64)

    def finish(self) -> None:
        """Make the last point the last of the run."""
        self.final, self.ready, self.crossing = self.count - 1, self.count, False

    def extend(self) -> None:
        """Add points until another one is ready, or the run must come to a crossing or its end."""
        before = self.ready
        while self._add_block() and self.ready == before and not self.crossing:
            pass

    def _add_block(self) -> bool:
        """Add the points of another block; return whether there are any."""
        after = int(self.points_ns[self.count - 1]) if self.count else -1
        until = min(max(after, 0) + self._block_ns, self.end_ns)
        if self.grows:
            until = min(until, *(link.horizon_ns for link in self.live.values()))
        if until <= after:
            self._set_ready()
            return False
        new = self._instants(after, until)
        first, self.count = self.count, self.count + new.size
        self.points_ns[first : self.count] = new
        start_ns = self._schedule.start_ns
        seconds = self.seconds[first : self.count]
        seconds[:] = new + start_ns if start_ns else new
        seconds /= 1e9
        begin = max(first - 1, 0)
        points_ns, sizes = self.points_ns[begin : self.count], self.sizes[begin : self.count - 1]
        if self._schedule.is_even(points_ns):
            sizes.fill(self._schedule.step_ns / 1e9)
        else:
            sizes[:] = points_ns[1:] - points_ns[:-1]
            sizes /= 1e9
        for points in self._steps.values():
            points.extend(self.points_ns, first, self.count, self.end_ns)
        if until == self.end_ns:
            self.final = self.count - 1
        self._set_ready()
        return True

    def _instants(self, after: int, until: int) -> Integers:
        """Return the points in (after, until] [ns] that the links and the rule of the run give."""
        found = [self._schedule.known(after, until)]
        for link in self.links.values():
            if not link.is_live:
                link.advance(until)
            if self._schedule.events == "align":
                found.append(link.sendings(after, until))
                # what a live link brings at its horizon is known when the loop is there
                found.append(link.changes(after, min(until, link.horizon_ns - 1))[0])
        if self._schedule.events == "align":  # where a packet begins to be sent
            horizons = (one.horizon_ns for one in self.live.values())
            found += [np.array([at], np.int64) for at in horizons if after < at <= until]
        return found[0] if len(found) == 1 else distinct(np.concatenate(found))

    def _set_ready(self) -> None:
        if self.final < self.most:
            self.ready = self.count
        else:
            self.ready = max(0, min(points.latest for points in self._steps.values()))
        self.crossing = False
        horizon_ns = min((link.horizon_ns for link in self.live.values()), default=None)
        if horizon_ns is not None and horizon_ns <= self.points_ns[self.count - 1]:
            horizon = self.index(horizon_ns)
            self.crossing = horizon <= self.ready
            self.ready = min(self.ready, horizon)

    def resolve(self, k: int, row: Rows, columns: Mapping[str, tuple[int, ...]]) -> None:
        """Resolve the delays of what is sent at point k, and add the points known by then.

        `columns` : of the signals of each live link in `row`.

        Raises
        ------
        InputError : a value that gives no valid delay; the link and the message are named. No
            link has sent anything then.
        """
        now = int(self.points_ns[k])
        values: dict[str, Any] = dict.fromkeys(self.live, 0.0)
        for name, source in self._delays.items():
            if self.live[name].horizon_ns == now:
                values[name] = source.value([float(row[c]) for c in columns[name]])
                self.live[name].check_value(values[name])
        for name, link in self.live.items():
            while link.horizon_ns == now:
                self._resolve(link, values[name], now)
                self.values[name].append(values[name])
        self._set_ready()
        if self.ready <= k and not self.crossing:
            self.extend()

    def _resolve(self, link: Delivery | Traffic, value: Any, now: int) -> None:
        """Resolve a message of a live link that is sent now [ns], or what a live medium awaits."""
        delay, loss = (
            self.event_values.at(f"{link.sending_link}.{what}", now) for what in ("delay", "loss")
        )
        link.resolve(link.message, value, delay_ns=None if delay is None else int(delay), loss=loss)

    def go_back(
        self,
        values: Mapping[str, Sequence[Any]],
        event_values: Mapping[str, Sequence[Sequence[float]]],
        complete: int,
    ) -> None:
        """Return to the state in which these were the values so far, and `complete` rows were.

        Nothing may have been given back.
        """
        self.event_values.restore(event_values)
        if not self.live:
            return
        self._begin()
        self.values = {name: list(values[name]) for name in self.live}
        numbers = dict.fromkeys(self.live, 0)
        while self.ready <= complete and self.ready <= self.final:
            if self.crossing and not self._resolve_again(numbers):
                return
            if not self.crossing:
                self.extend()

    def _resolve_again(self, numbers: dict[str, int]) -> bool:
        """Resolve what is sent at the crossing; return whether all of it has values."""
        now = int(self.points_ns[self.ready])
        for name, link in self.live.items():
            while link.horizon_ns == now:
                if numbers[name] >= len(self.values[name]):
                    return False
                self._resolve(link, self.values[name][numbers[name]], now)
                numbers[name] += 1
        self._set_ready()
        return True

    def index(self, instants_ns: int) -> int:
        """Return the index of the point at this instant [ns], or of the one after it."""
        return int(self.rows_at(np.array([instants_ns]))[0])

    def rows_at(self, instants_ns: Integers) -> Integers:
        """Return the indices of the points at these instants [ns]."""
        known = self.points_ns[self.oldest : self.count]
        return self.oldest + np.searchsorted(known, instants_ns)

    def rows_sent_at(self, instants_ns: Integers) -> Integers:
        """Return the indices of the points whose values are sent at these instants [ns].

        Of the points of one instant this is the last: what is sent is what events left.
        """
        if not self.has_events:
            return self.rows_at(instants_ns)
        known = self.points_ns[self.oldest : self.count]
        return self.oldest + np.searchsorted(known, instants_ns, side="right") - 1

    def last_at(self, instant_ns: int) -> int:
        """Return the index of the last point at or before an instant [ns]; 0 before the first."""
        known = self.points_ns[self.oldest : self.count]
        return max(self.oldest + int(np.searchsorted(known, instant_ns, side="right")) - 1, 0)

    def rows_of_messages(self, name: str, first: int, last: int) -> Integers:
        """Return the row in use over a packet link at points first to last - 1, as `RowsInUse`."""
        points = self.points_ns[first:last]
        used, repeats = self.links[name].runs_in_use(points)
        real, sent = used >= 0, used.copy()
        used[real] = self.rows_sent_at(used[real])
        found = np.repeat(used, repeats)
        oldest = self._greatest_ages.get(name)
        if oldest is not None:
            found[(found >= 0) & (points - np.repeat(sent, repeats) >= oldest)] = SUBSTITUTE
        # what is sent and delivered at one instant is what the sender has by then
        return np.minimum(found, np.arange(first, last)) if self.has_events else found

    def arrivals(self, name: str, first: int) -> Arrivals:
        """Return the known arrivals and drops of a link, from the `first`-th on."""
        return self.links[name].arrivals(first)

    def state(self, name: str, first: int, last: int) -> LinkState:
        """Return the state of a packet link at the points first to last - 1.

        Raises
        ------
        InputError : there is no packet link of this name.
        """
        if name not in self.links:
            raise InputError.unknown("packet link", name, self.links)
        return self.links[name].state(self.points_ns[first:last])

    def give_back(self, before: int) -> None:
        """Give back the memory of the points before this one: nobody asks for them any more."""
        if before <= self.oldest:
            return
        self.oldest = before
        for reserved in self._reserved:
            reserved.give_back(before)
        for points in self._steps.values():
            points.give_back(before)
        for link in self.links.values():
            link.forget(int(self.points_ns[before]))


def blocks(system: Parts) -> Iterator[tuple[CommunicationPoints, int, int]]:
    """Yield the points of a run block by block, before it: points, first, last.

    On a grid links whose delays follow a signal are left out: they have no effect on the points.
    """
    points, first = CommunicationPoints(system, live=False), 0
    while first < points.ready:
        yield points, first, points.ready
        first = points.ready
        points.give_back(first - 1)
        points.extend()
