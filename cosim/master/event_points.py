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
point for all components. `docs/explanation/events.md` says how this meets links. The points between
two instants at which anything of this happens are carried out by the kernel (`quiet_points`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError
from cosim.fmu import ACCEPTED_STATUSES, FmuState
from cosim.master.event_instance import SECOND_NS, EventInstance, nanosecond_of
from cosim.master.exchange import TOO_LARGE
from cosim.master.guards import Guards
from cosim.master.plain_loop import step_call
from cosim.master.quiet_points import QuietKernel
from cosim.master.system import System
from cosim.master.table import ENDED, JUMPED, RETURNED, WORD_BITS, EarlyStop, Step, Table
from cosim.master.wiring import Wiring

Integers = NDArray[np.int64]

MOST_POINTS: Final = 1000
"""Points of events within `_PROGRESS_NS` after which events count as ones that do not end."""
_PROGRESS_NS: Final = 1000


class _Stepped(NamedTuple):
    """A component that stepped: its state before, if it may be taken back, and where it was [s]."""

    one: EventInstance
    saved: FmuState | None
    begun: float


class _Target(NamedTuple):
    """Where the steps from a point lead: the nanosecond of the next point, and its time [s]."""

    instant_ns: int
    time: Fraction


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
        *,
        kernel: bool,
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
        self._first = {  # in the order of their steps
            number: events[number]
            for _, number in self._steps
            if number in events and events[number].slave.options.early_return
        }
        self._calls = {
            one.number: step_call(one.slave, table.no_way_back.data) for one in self._instances
        }
        for one in self._instances:
            one.word = table.word
        if len(self._first) > 1:
            table.no_way_back[0] = 0  # a step may be taken back for an event of another component
        self._quiet: QuietKernel | None = None
        self._may_be_quiet = kernel and not any(
            one.slave.description.scheduled
            or (one.instance.component.isolate and len(self._first) > 1)
            for one in self._instances
        )

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

    def go_quietly(
        self, k: int, most: int, until_ns: int | None, guards: Guards | None
    ) -> tuple[int, EarlyStop | None]:
        """Carry out point k and those that follow it as long as nothing happens, by the kernel.

        Parameters
        ----------
        most : points to carry out.
        until_ns : it goes no further than to the first point at or after this instant [ns].
        guards : as of an engine.

        Returns
        -------
        The number of complete rows, to whose next point the slaves have come; k where point k is
        none that the kernel carries out. Why the run, or a guard, ends it there.

        Raises
        ------
        ComponentError : a slave that returned early gave no time of its step.
        """
        instants = self._quiet_instants(k, most, until_ns)
        if not instants.size:
            return k, None
        if self._quiet is None:
            self._quiet = QuietKernel(self._table, self._events, self._first)
        last = k + instants.size
        self._points.replace_from(k + 1, instants, instants / 1e9)
        self._wiring.fill_routes(k, last)
        self._wiring.begin_rows(k, last)
        if guards is not None:
            guards.prepare(k, last)
        early_stop = self._quiet.run(0, len(self._table.operations), k, last, guards)
        if early_stop is None:
            self._came_to(last)
            return last, None
        return self._after_quiet(early_stop, instants, k)

    def _quiet_instants(self, k: int, most: int, until_ns: int | None) -> Integers:
        """Return the instants to which steps from point k on lead without an event [ns]."""
        none = np.zeros(0, np.int64)
        now_ns = int(self._points.points_ns[k])
        adjusted = self._table.adjustments.count[0] or self._table.copying[0]
        if not self._may_be_quiet or k == 0 or adjusted or self._asked_to_end is not None:
            return none
        if now_ns == self._end_ns or now_ns < self._begin_ns + _PROGRESS_NS:
            return none
        limit_ns = self._end_ns + 1
        for one in self._instances:
            instants = [nanosecond_of(instant) for instant in one.instants()]
            limit_ns = min([limit_ns, *instants])
            quiet = not (one.slave.in_event_mode or one.event_needed)
            if not quiet or limit_ns <= now_ns or one.time != now_ns / 1e9:
                return none
        found = self._points.planned_before(limit_ns, most)
        if until_ns is not None:
            found = found[: int(np.searchsorted(found, until_ns)) + 1]
        close = np.flatnonzero(np.diff(found, prepend=now_ns) < _PROGRESS_NS)
        return found[: close[0]] if close.size else found

    def _came_to(self, k: int) -> None:
        """Note that all slaves are at point k, by steps alone, of which the last may announce."""
        now_ns = int(self._points.points_ns[k])
        self._now = Fraction(now_ns, SECOND_NS)
        self._begin_ns, self._crowded = int(self._points.points_ns[k - 1]), 0
        self._busy.clear()
        for one in self._instances:
            one.time = now_ns / 1e9
            one.event_needed = bool(one.slave.results.event_handling_needed)

    def _after_quiet(
        self, early_stop: EarlyStop, instants: Integers, k: int
    ) -> tuple[int, EarlyStop | None]:
        """Go on where the kernel stopped, in the quiet points from k on."""
        status, at = early_stop.status, early_stop.k
        ended = early_stop.what in ("guard", "announced")  # all steps of the point
        if (reached := at + ended) > k:
            self._came_to(reached)
        self._forget_after(reached)
        if status == RETURNED:
            return at + 1, self._after_return(early_stop, at, int(instants[at - k]))
        if status == TOO_LARGE:  # an integer that no double is: Python has texts for it
            self._may_be_quiet = False
        if ended or status in (JUMPED, TOO_LARGE):
            return reached, early_stop if early_stop.what == "guard" else None
        if early_stop.what in ("step", "end"):  # whose end is named
            self._points.add(int(instants[at - k]), float(instants[at - k] / 1e9))
        return early_stop.complete, early_stop

    def _forget_after(self, k: int) -> None:
        """Let point k be the last one that is known."""
        points = self._points
        if points.count > k + 1:
            last = points.points_ns[k : k + 1].copy(), points.seconds[k : k + 1].copy()
            points.replace_from(k, *last)

    def _after_return(self, early_stop: EarlyStop, k: int, target_ns: int) -> EarlyStop | None:
        """End the steps from point k to an instant [ns], of which one returned early."""
        begun, target = float(self._points.seconds[k]), Fraction(target_ns, SECOND_NS)
        first = [*self._first.values()]
        place = [*self._first].index(early_stop.instance)
        stepped: list[_Stepped] = []
        for one in first[: place + 1]:
            results = one.slave.results
            one.event_needed = bool(results.event_handling_needed)
            one.time = float(target)
            if results.early_return:
                one.time = one.slave.time_reached(begun, float(target))
            saved = None if self._quiet is None else self._quiet.saved.get(one.number)
            stepped.append(_Stepped(one, saved, begun))
        waiting = first[place + 1 :]
        now_ns = int(self._points.points_ns[k])
        to = self._reached(now_ns, _Target(target_ns, target), stepped, waiting)
        return self._end_steps(k, to, stepped, waiting)

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
        return self._end_steps(k, _Target(target_ns, target), [], [*self._first.values()])

    def _end_steps(
        self, k: int, to: _Target, stepped: list[_Stepped], waiting: list[EventInstance]
    ) -> EarlyStop | None:
        """Step from point k where some of those that may return early have stepped."""
        now_ns, alone = int(self._points.points_ns[k]), len(self._first) == 1
        while waiting:
            one = waiting.pop(0)
            saved = None if alone else one.slave.snapshot()
            begun = one.time
            early_stop = self._step_one(one, k, float(to.time))
            if early_stop is not None:
                self._points.add(to.instant_ns, float(to.time))
                return early_stop
            stepped.append(_Stepped(one, saved, begun))
            to = self._reached(now_ns, to, stepped, waiting)
        for one, saved, _ in stepped:
            self._free(one, saved)
        self._points.add(to.instant_ns, float(to.time))
        if to.instant_ns > now_ns:
            self._now = to.time
            early_stop = self._step_others(k, float(to.time))
            if early_stop is not None:
                return early_stop
        return None

    def _reached(
        self, now_ns: int, to: _Target, stepped: list[_Stepped], waiting: list[EventInstance]
    ) -> _Target:
        """Return where the last one that stepped is; take those before it back if it is early."""
        one, reached = stepped[-1].one, Fraction(stepped[-1].one.time)
        if not one.slave.results.early_return or nanosecond_of(reached) >= to.instant_ns:
            return to
        for before in stepped[:-1]:
            self._take_back(before)
            stepped.remove(before)
            waiting.append(before.one)
        return _Target(max(nanosecond_of(reached), now_ns), reached)

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

    def _take_back(self, stepped: _Stepped) -> None:
        """Return a component to before its step: another one has an event before its end."""
        one, saved, begun = stepped
        if saved is not None:
            one.slave.restore(saved)
            self._free(one, saved)
        if one.slave.options.intermediate:
            one.slave.forget_within_steps()
        one.time, one.event_needed = begun, False

    def _free(self, one: EventInstance, saved: FmuState | None) -> None:
        """Free a saved state, unless the kernel saves into it again."""
        kept = self._quiet is not None and self._quiet.saved.get(one.number) is saved
        if saved is not None and not kept:
            one.slave.free(saved)
