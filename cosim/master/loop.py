"""The co-simulation loop (fixed or event-aligned points; Jacobi or Gauss-Seidel).

    for every communication point t_k:
        every component sends:    its outputs are written to row k
        every component receives: its inputs are read from the rows that the routes name
        every component steps from t_k to its next point, with constant inputs

(Jacobi; under Gauss-Seidel the components do this one after the other, and each receives the
outputs at t_{k+1} of those before it.) This is written down as a table of operations
(`cosim.master.table`), which an engine carries out for a segment of points at a time; after each
the observers receive the new rows. The length of a segment depends on the machine; nothing that is
recorded depends on it.

Under Jacobi, outputs computed from new inputs are exchanged at the next point only; this coupling
delay is reported apart from the delays of the links.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError, InputError
from cosim.master.adjustments import Adjustment, Adjustments
from cosim.master.engine import EngineChoice, build_engine
from cosim.master.event_instance import EventInstance
from cosim.master.event_points import EventPoints
from cosim.master.exchange import TOO_LARGE
from cosim.master.guards import Guards
from cosim.master.observers import ObserverDispatch
from cosim.master.pacing import Pace
from cosim.master.plain_loop import PlainLoop
from cosim.master.row_sums import sum_of_rows
from cosim.master.run import Run, RunStatus, run_status_of
from cosim.master.system import System
from cosim.master.table import ROW_SUM, EarlyStop, make_table
from cosim.master.unreceived_inputs import fill_unreceived_inputs
from cosim.master.wiring import Wiring
from cosim.trace.outcome import Cause

_SEGMENT_S = 0.05
_LONGEST = 1 << 16


class _Ahead(NamedTuple):
    """How far to go: so many points, and no further than to the first at or after an instant."""

    points: int
    until_ns: int | None


class _SegmentLength:
    """Chooses how many points a segment has, so that it takes about `_SEGMENT_S`."""

    def __init__(self) -> None:
        self.points = 1

    def took(self, points: int, seconds: float, *, alone: bool = False) -> None:
        """Adapt the length to the time that the last segment took.

        alone : it was a point with events, which takes longer than others.
        """
        share = min(8.0, _SEGMENT_S / max(seconds, 1e-9))
        length = max(1, min(_LONGEST, int(points * share)))
        self.points = max(self.points, length) if alone else length


class Loop:
    """The execution of a run whose slaves are initialised.

    `word` : as in `Table`. `events` : the instances in event mode, by number. `keep` : all rows
    stay in memory; else those that may still be read.

    Attributes
    ----------
    complete : number of complete rows; the slaves are at the point after them.
    status, reason, cause : as in `Run`; None while the run can continue.
    adjustments : overrides and biases, by column of the rows.
    table : the operations.
    """

    def __init__(
        self,
        system: System,
        wiring: Wiring,
        dispatch: ObserverDispatch,
        choice: EngineChoice,
        word: NDArray[np.int64] | None = None,
        events: Mapping[int, EventInstance] = MappingProxyType({}),
        *,
        keep: bool = True,
    ) -> None:
        self._system, self._wiring, self._dispatch = system, wiring, dispatch
        self._choice, self._keep = choice, keep
        self._comm_points = wiring.comm_points
        self._segment = _SegmentLength()
        self._early_stop: EarlyStop | None = None
        self._exchanged: int | None = None
        self.adjustments = Adjustments(wiring.rows.shape[1])
        self.table = make_table(system, wiring, self.adjustments, word)
        self._word = self.table.word
        self._engine = build_engine(choice.name, self.table, events)
        self._events: EventPoints | None = None
        if events:
            self._events = EventPoints(
                *(system, wiring, self.table, events, self._execute, self._complete_row),
                kernel=choice.name == "kernel",
            )
        self.complete = 0
        self.status: RunStatus | None = None
        self.reason: str | None = None
        self.cause: Cause | None = None
        self._dispatch.where, self._dispatch.make_whole = self._where, wiring.make_whole
        if system.threads > 1:
            self._turns = {name: i for i, name in enumerate(system.components)}
            self._dispatch.turn = self._turn

    @property
    def time_ns(self) -> int:
        """The time of the slaves [ns]."""
        return int(self._comm_points.points_ns[min(self.complete, self._comm_points.count - 1)])

    def run(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Callable[[], bool] | None = None,
        guards: Guards | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue to an instant, by `most` points, or to the end; return whether `stop` ended it.

        `stop` is evaluated after every row, `guards` are looked at by the engine: one that is not
        met ends it too. `pace` slows the run down to wall-clock time.
        """
        if guards is not None and guards.reads_inputs:
            self._copy_inputs()
        points, begun = self._comm_points.points_ns, self.complete
        while self.status is None:
            first = self.complete
            self._make_ready()
            last = self._comm_points.ready + self._comm_points.crossing
            if until_ns is not None and until_ns <= points[last - 1]:
                last = self._comm_points.index(until_ns)
            if most is not None:
                last = min(last, begun + most)
            if first >= last:
                return False
            longest = 1 if stop is not None else self._segment.points
            if pace is not None:
                known = points[: self._comm_points.count]
                longest = min(longest, pace.wait(known, first, self._dispatch.check_stop))
            ahead = _Ahead(
                longest if most is None else min(longest, begun + most - first), until_ns
            )
            met = self._advance(first, min(last, first + longest), guards, ahead)
            if pace is not None:
                pace.done(points[: self._comm_points.count], first, self.complete)
            if not met or (stop is not None and self.complete > first and stop()):
                return stop is not None
        return False

    def _make_ready(self) -> None:
        """Prepare the rows of the next points, where the slaves have come to the last ones."""
        comm_points = self._comm_points
        if self.complete < comm_points.ready:
            return
        if not self._keep:
            self._wiring.give_back(min(self.complete, self._dispatch.unread))
        if not comm_points.crossing:
            self._wiring.extend()

    def begin_again(self, system: System) -> None:
        """Begin another run, of a system to whose beginning slaves and wiring have returned."""
        self._system = system
        self._dispatch.make_whole = self._wiring.make_whole
        self.table.begin_again()
        self.go_back(0, {})

    def go_back(self, complete: int, adjustments: Mapping[int, Adjustment]) -> None:
        """Continue from `complete` rows, to which slaves and wiring have been restored."""
        self._word[ROW_SUM] = sum_of_rows(self._wiring.rows, self._wiring.outputs, 0, complete)
        self.complete, self._exchanged = complete, None
        self.adjustments.restore(adjustments)
        self._copy_if_adjusted()
        self.status = self.reason = self.cause = self._early_stop = None
        self._dispatch.where = self._where
        if complete > self._comm_points.final:  # back to the end: nothing is left to be done
            self.status = "finished"
            self._conclude()

    def exchange(self, column: int) -> bool:
        """Exchange values at the point of the slaves; return whether that of `column` is known.

        They are in the row that is next to be complete; the exchange takes place again when the
        run continues, with what is set or overridden by then. At a point that decides the delay
        of a message only what is sent there is known, and under Gauss-Seidel no input.
        """
        k, table = self.complete, self.table
        if self.status is not None:
            return False
        self._make_ready()
        crossing = k >= self._comm_points.ready
        if self._exchanged != k:
            self._execute(0, table.sent if crossing else table.complete, k, k + 1)
            self._exchanged = k
        if self._system.algorithm == "gauss-seidel":
            return column < table.outputs
        return not crossing or column in table.columns_sent

    def close(self) -> None:
        """End the threads of the engine."""
        self._engine.close()

    def adjust(self, column: int, by: Adjustment | None) -> None:
        """Adjust a column from the present point on, or no more."""
        if by is None:
            self.adjustments.release(column)
        else:
            self.adjustments.set(column, by)
        self._copy_if_adjusted()
        self.forget_exchange()

    def _copy_if_adjusted(self) -> None:
        if self.adjustments.count[0]:
            self._copy_inputs()

    def _copy_inputs(self) -> None:
        """Copy inputs into the rows from now on, those too that are set from the sender's.

        It may have begun at a later row before the run went back.
        """
        self.table.copying[0] = 1
        self._wiring.leave_whole_from(self.complete)

    def forget_exchange(self) -> None:
        """Take back the exchange at the point of the slaves: something was set or overridden."""
        if self._exchanged is not None:
            self._wiring.reset_inputs(self._exchanged)
        self._exchanged = None

    def result(self, count: int, *, whole: bool) -> Run:
        """Return the first `count` rows; "stopped" if the run has not ended by itself."""
        now = self._comm_points.at_s(self.time_ns)
        reason = self.reason if self.status else f"stopped at t = {now:g} s"
        return Run.of(
            self._wiring,
            count,
            self.status or "stopped",
            reason,
            self._choice,
            self.cause,
            kept=self._keep,
            whole=whole,
        )

    def fail(self, error: ComponentError, component: str) -> None:
        """End the run by an error of a component in a call between two points."""
        now = self._comm_points.at_s(self.time_ns)
        self.status, self.reason = "failed", error.text()
        self.cause = replace(Cause.of_error(error, now), component=component)
        self._conclude()

    def _advance(self, first: int, last: int, guards: Guards | None, ahead: _Ahead) -> bool:
        """Carry out the points first to last - 1, or to a guard; return whether all are met.

        ahead : how far to go where points become known on the way, as long as nothing happens.
        """
        began = time.perf_counter()
        self.forget_exchange()
        early_stop: EarlyStop | None = None
        met = False
        try:
            last, early_stop, met = self._go_through(first, last, guards, ahead)
            if early_stop is None:
                self._take_within_steps(first, last)
        except (ComponentError, InputError) as error:
            self._break_off(error, first)
        if self.status is None:
            self.complete = last if early_stop is None else early_stop.complete
        if early_stop is not None:
            self._early_stop = early_stop
            found = run_status_of(self._wiring, early_stop)
            self.status, self.reason, self.cause = found
            fill_unreceived_inputs(self.table, early_stop)
            with suppress(ComponentError):  # the run has failed already
                self._take_within_steps(first, early_stop.k + 1)
        elif self.status is None and self.complete > self._comm_points.final:
            self.status = "finished"
        self._dispatch.deliver(self.complete)
        is_event = self._events is not None and last == first + 1
        self._segment.took(last - first, time.perf_counter() - began, alone=is_event)
        if self.status is not None:
            self._conclude()
        return met

    def _go_through(
        self, first: int, last: int, guards: Guards | None, ahead: _Ahead
    ) -> tuple[int, EarlyStop | None, bool]:
        """Carry out points as `_advance`; return where they end, why there, whether all are met."""
        ready, early_stop = self._comm_points.ready, None
        if first != ready:
            last = min(last, ready)
            if guards is not None:
                guards.prepare(first, last)
            early_stop = self._execute(0, len(self.table.operations), first, last, guards)
        else:
            last = first
            if self._events is not None and ahead.points > 1:
                last, early_stop = self._events.go_quietly(first, *ahead, guards)
            if last == first and early_stop is None:
                # at a point that is crossed nobody looks at guards
                return first + 1, self._cross(ready), guards is None
        if early_stop is not None and early_stop.what == "guard":
            return early_stop.complete, None, False
        return last, early_stop, True

    def _take_within_steps(self, first: int, last: int) -> None:
        """Pass on what the components' outputs were within the steps from points first to last - 1.

        Raises
        ------
        ComponentError : values for a time that is not in these steps.
        """
        seconds = self._comm_points.seconds
        for instance in self._wiring.instances:
            dead = instance.slave.phase in ("failed", "closed")
            if not instance.component.intermediate or dead:
                continue
            begin = int(instance.own_points.last[first])
            end = max(begin, int(instance.own_points.following[first:last].max()))
            if taken := instance.slave.taken_within_steps(seconds[begin], seconds[end]):
                times = np.array([round(time * 1e9) for time, _ in taken], np.int64)
                times -= self._comm_points.start_ns
                values = np.array([values for _, values in taken])
                self._dispatch.within_steps(instance.name, times, values)

    def _execute(
        self, begin: int, end: int, first: int, last: int, guards: Guards | None = None
    ) -> EarlyStop | None:
        """Carry out operations begin to end - 1 at points first to last - 1."""
        self._word[1] = 1
        try:
            found = self._engine.run(begin, end, first, last, guards)
        finally:
            self._word[1] = 0
        if found is None or found.status != TOO_LARGE or self.table.threads > 1:
            return found
        # an integer that no double is: from here on by the loop in Python, which has texts for it
        self._engine = PlainLoop(self.table)
        early_stop = self._execute(self.table.place()[1], end, found.k, found.k + 1, guards)
        if early_stop is None and found.k + 1 < last:
            early_stop = self._execute(begin, end, found.k + 1, last, guards)
        return early_stop

    def _cross(self, k: int) -> EarlyStop | None:
        """Carry out point k, at which events may occur, or what is sent decides a delay."""
        if self._events is not None:
            return self._events.execute(k)
        sent = self.table.sent
        early_stop = self._execute(0, sent, k, k + 1)
        if early_stop is not None:
            return early_stop
        try:
            self._wiring.resolve_delays(self._system, k)
        except InputError as error:
            self.status, self.reason = "failed", error.text()
            now = self._comm_points.at_s(self.time_ns)
            self.cause = Cause("delay", time_s=now, detail=error.what)
            return None
        self._wiring.fill_routes(k, self._comm_points.ready)
        self._wiring.begin_rows(k, self._comm_points.ready)
        return self._execute(sent, len(self.table.operations), k, k + 1)

    def _complete_row(self, k: int) -> None:
        """Deliver row k before its events are handled: they may end the process."""
        self.complete = k + 1
        self._dispatch.deliver(self.complete)

    def _break_off(self, error: ComponentError | InputError, first: int) -> None:
        """End the run by an error at a point, of an FMI call or of what it returned."""
        place = self.table.place()
        k = max(first, place[0])
        time_s = self._comm_points.at_s(self._comm_points.points_ns[k])
        with_time = copy(error)
        with_time.what = f"{error.what} at t = {time_s:g} s"
        self.status, self.reason = "failed", with_time.text()
        self.complete = k + (place >= (k, self.table.complete))
        self.cause = Cause("refused", time_s=time_s, detail=error.what)
        if isinstance(error, ComponentError):
            cause = Cause.of_error(error, time_s)
            self.cause = replace(cause, detail=error.detail or error.what)

    def _conclude(self) -> None:
        points, early_stop = self._comm_points.points_ns, self._early_stop
        level = {"finished": "info", "stopped": "info"}.get(self.status or "", "error")
        last = early_stop.k if self.status == "failed" and early_stop else max(self.complete - 1, 0)
        place = (self.complete, int(points[last]))
        self._dispatch.where = lambda: place
        self._dispatch.note("master", level, self.reason or "the end is reached")

    def _where(self) -> tuple[int, int]:
        k, number = self.table.place()
        return k + (number > self.table.complete), int(self._comm_points.points_ns[k])

    def _turn(self, name: str) -> int:
        """Return the place of a component in the order of the system, while it steps."""
        stepping = self.table.place()[1] > self.table.complete
        return self._turns.get(name, 0) if stepping else 0
