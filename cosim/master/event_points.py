"""The points of a run whose components have events.

    at a point (t, n):
        Clocks that are due tick; their components enter event mode
        values are exchanged: who receives a tick, or an input that jumps, enters event mode
        if a component is in event mode:
            each of those updates its discrete states
            the next point is (t, n + 1)
        else:
            the next point is the earliest of those planned, time events and ticks
            components that may return early step first; who returns early makes that the point
            all others step there

So every connection, link, override and recorded row is that of a point, and an event is one more
point for all components. `docs/explanation/events.md` says how this meets links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Final

from cosim.core import ComponentError
from cosim.fmu import ACCEPTED_STATUSES, FmuState
from cosim.master.event_instance import SECOND_NS, EventInstance, nanosecond_of
from cosim.master.plain_loop import step_call
from cosim.master.system import System
from cosim.master.table import ENDED, WORD_BITS, EarlyStop, Step, Table
from cosim.master.wiring import Wiring

MOST_POINTS: Final = 1000
"""Points of events within `_PROGRESS_NS` after which events count as ones that do not end."""
_PROGRESS_NS: Final = 1000


class EventPoints:
    """Carries out the points of a run whose components have events."""

    def __init__(
        self,
        system: System,
        wiring: Wiring,
        table: Table,
        events: Mapping[int, EventInstance],
        run: Callable[[int, int, int, int], EarlyStop | None],
        row_complete: Callable[[int], None],
    ) -> None:
        self._wiring, self._table, self._events, self._run = wiring, table, events, run
        self._row_complete = row_complete
        self._points = wiring.comm_points
        self._end_ns = system.comm_schedule.end_ns
        self._instances = list(events.values())
        self._now = Fraction(0)
        self._begin_ns = self._crowded = 0
        self._busy: dict[str, None] = {}
        self._asked_to_end: EventInstance | None = None
        self._steps = [
            (number, operation.instance)
            for number, operation in enumerate(table.operations)
            if isinstance(operation, Step)
        ]
        self._first = {one.number: one for one in self._instances if one.slave.options.early_return}
        self._calls = {
            one.number: step_call(one.slave, table.no_way_back.data) for one in self._instances
        }
        for one in self._instances:
            one.word = table.word
        if len(self._first) > 1:
            table.no_way_back[0] = 0  # a step may be taken back for an event of another component

    def execute(self, k: int) -> EarlyStop | None:
        """Carry out point k and add the next one, if the run goes on.

        Raises
        ------
        ComponentError : a slave refuses, or event iteration does not end.
        """
        self._wiring.fill_routes(k, k + 1)
        self._wiring.begin_rows(k, k + 1)
        now_ns = int(self._points.points_ns[k])
        self._count(k, now_ns)
        for one in self._instances:
            clocks = one.due(now_ns)
            if one.has_event(now_ns):
                one.enter_event_mode()
            one.tick(clocks)
            for clock in clocks:
                self._table.rows[k, one.column_of(clock.name)] = 1.0
        complete = self._table.complete + 1
        early_stop = self._run(0, complete, k, k + 1)
        if early_stop is not None:
            return early_stop
        self._table.word[0] = k << WORD_BITS | complete
        self._row_complete(k)
        if self._asked_to_end is not None:  # what its last event left is in the row
            self._note(self._asked_to_end.number, k)
            return EarlyStop(k, k + 1, "end", self._asked_to_end.number, 0)
        handling = [one for one in self._instances if one.slave.in_event_mode]
        if handling:
            return self._update(k, now_ns, handling)
        if now_ns == self._end_ns:
            self._points.finish()
            return None
        return self._step(k, now_ns)

    def _count(self, k: int, now_ns: int) -> None:
        """Count the points with hardly any time between them; too many are a ComponentError."""
        if k == 0 or now_ns >= self._begin_ns + _PROGRESS_NS:
            self._begin_ns, self._crowded = now_ns, 0
            self._busy.clear()
            return
        self._crowded += 1
        if self._crowded >= MOST_POINTS:  # an event and what it left are two points
            names = (one.instance.name for one in self._instances if one.is_busy(now_ns))
            self._busy.update(dict.fromkeys(names))
        if self._crowded > MOST_POINTS:
            busy = list(self._busy) or [one.instance.name for one in self._instances]
            raise ComponentError(
                "the events do not come to an end",
                where=", ".join(f"component {name!r}" for name in busy),
                expected=f"at most {MOST_POINTS} points within {_PROGRESS_NS} ns",
                hint="events that cause each other at once, a Clock with an interval of zero, or "
                "an event that is announced again when it has come",
                component=busy[0] if len(busy) == 1 else None,
            )

    def _update(self, k: int, now_ns: int, handling: list[EventInstance]) -> EarlyStop | None:
        """End the super-dense instant of point k."""
        need = False
        for one in handling:
            need_update, terminate = one.update(self._now)
            need |= need_update
            if terminate:
                one.slave.note_wish_to_end(now_ns / 1e9)
                self._asked_to_end = one
        if not need:
            for one in handling:
                one.slave.enter_step_mode()
        self._points.add(now_ns, float(self._points.seconds[k]))
        return None

    def _step(self, k: int, now_ns: int) -> EarlyStop | None:
        """Step from point k to the next one."""
        target_ns, target = self._next(now_ns)
        stepped: list[tuple[EventInstance, FmuState | None, float]] = []
        waiting = [self._first[number] for _, number in self._steps if number in self._first]
        alone = len(waiting) == 1
        while waiting:
            one = waiting.pop(0)
            saved = None if alone else one.slave.snapshot()
            begun = one.time
            early_stop = self._step_one(one, k, float(target))
            if early_stop is not None:
                self._points.add(target_ns, float(target))
                return early_stop
            stepped.append((one, saved, begun))
            reached = Fraction(one.time)
            if one.slave.results.early_return and nanosecond_of(reached) < target_ns:
                target_ns, target = max(nanosecond_of(reached), now_ns), reached
                for before in [s for s in stepped if s[0] is not one]:
                    self._take_back(*before)
                    stepped.remove(before)
                    waiting.append(before[0])
        for one, saved, _ in stepped:
            if saved is not None:
                one.slave.free(saved)
        self._points.add(target_ns, float(target))
        if target_ns > now_ns:
            self._now = target
            early_stop = self._step_others(k, float(target))
            if early_stop is not None:
                return early_stop
        return None

    def _next(self, now_ns: int) -> tuple[int, Fraction]:
        """Return the next instant that is known, [ns] and [s]."""
        planned_ns = self._points.planned()
        found = planned_ns, Fraction(planned_ns, SECOND_NS)
        for one in self._instances:
            for instant in one.instants():
                instant_ns = max(nanosecond_of(instant), now_ns + 1)
                if instant_ns < found[0]:
                    late = instant_ns == nanosecond_of(instant)
                    found = instant_ns, instant if late else Fraction(instant_ns, SECOND_NS)
        return found

    def _step_others(self, k: int, target: float) -> EarlyStop | None:
        """Step all components that have not stepped yet."""
        for number, instance in self._steps:
            if instance in self._first:
                continue
            one = self._events.get(instance)
            if one is None:
                early_stop = self._run(number, number + 1, k, k + 1)
            else:
                early_stop = self._step_one(one, k, target)
            if early_stop is not None:
                return early_stop
        return None

    def _step_one(self, one: EventInstance, k: int, target: float) -> EarlyStop | None:
        """Step a component with events to an instant [s], or to where it returns early."""
        size = target - one.time
        if size <= 0.0:
            return None
        here = one.time == self._points.seconds[k]
        if here and self._is_whole(k) and target == round(target * 1e9) / 1e9:
            size = (round(target * 1e9) - int(self._points.points_ns[k])) / 1e9
        if one.next_event is not None and nanosecond_of(one.next_event) == round(target * 1e9):
            until = max(target, float(one.next_event))
            if one.time + size < until:  # rounded down, it would not come to its event
                size = math.nextafter(until - one.time, math.inf)
        status = self._call(one, k, size)
        results = one.slave.results
        if status in ACCEPTED_STATUSES and results.terminate_simulation:
            status = ENDED
        if status in ACCEPTED_STATUSES and results.early_return and one.number not in self._first:
            status = ENDED
        if status not in ACCEPTED_STATUSES:
            return self._table.early_stop(status, 0)
        one.event_needed = bool(results.event_handling_needed)
        one.time = one.slave.time_reached(one.time, target) if results.early_return else target
        return None

    def _call(self, one: EventInstance, k: int, size: float) -> int:
        """Step a component by a size [s]; return the status. The call in progress is noted."""
        word = self._table.word
        self._note(one.number, k)
        word[1] = 1
        try:
            return self._calls[one.number](one.time, size)
        finally:
            word[1] = 0

    def _is_whole(self, k: int) -> bool:
        """Whether point k is told to the components as its whole nanoseconds."""
        return bool(self._points.seconds[k] == int(self._points.points_ns[k]) / 1e9)

    def _note(self, instance: int, k: int) -> None:
        """Note that the step of an instance is in progress, for messages."""
        number = next(number for number, owner in self._steps if owner == instance)
        self._table.word[0] = k << WORD_BITS | number

    @staticmethod
    def _take_back(one: EventInstance, saved: FmuState | None, begun: float) -> None:
        """Return a component to before its step: another one has an event before its end."""
        if saved is not None:
            one.slave.restore(saved)
            one.slave.free(saved)
        if one.slave.options.intermediate:
            one.slave.forget_within_steps()
        one.time, one.event_needed = begun, False
