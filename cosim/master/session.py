"""A run under control: step by step, read and set, saved and taken up again.

    with Session(system) as session:
        session.run_until(10.0)
        session.set("plant", "damping.u", 0.9)
        before = session.snapshot()
        session.run_until()
        first = session.result()
        session.restore(before)      # and on, bit for bit as before

At any time the rows up to the last complete one are fixed, and every slave stands at `time_s`,
the point after it. What is set takes effect there.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self, get_args

import numpy as np

from cosim.errors import CosimError, InputError
from cosim.fmu import FmuSlave
from cosim.master.ending import ending_of
from cosim.master.engine import (
    Adjustment,
    Engine,
    EngineName,
    Halt,
    build,
    choose,
    fill_in,
    make_program,
)
from cosim.master.initial import initialise
from cosim.master.journal import Journal, Observer
from cosim.master.pacing import Pace
from cosim.master.run import Ending, Run
from cosim.master.snapshot import Snapshot, fingerprint
from cosim.master.stations import Station
from cosim.master.system import LogLevel, System
from cosim.master.wiring import wire
from cosim.network import LinkState

_STRETCH_S = 0.05
_LONGEST = 1 << 16
_LEVELS = get_args(LogLevel)

Condition = Callable[["Session"], bool]


class _Stretch:
    """How many points a stretch has: what takes about `_STRETCH_S`."""

    def __init__(self) -> None:
        self.points = 1

    def took(self, points: int, seconds: float) -> None:
        """Take note of how long the last stretch took."""
        share = min(8.0, _STRETCH_S / max(seconds, 1e-9))
        self.points = max(1, min(_LONGEST, int(points * share)))


class Session:
    """A run of a system from its start on; use as a context manager.

    Parameters
    ----------
    system : what runs.
    observers : look on; the trace is one.
    engine : "python", "compiled", or "auto": compiled where it pays (`choose`).

    Raises
    ------
    InputError : a system that cannot be wired, a parameter that does not exist, an engine that
        is not installed. (From `__enter__`: the FMUs are loaded there.)
    ComponentError : an FMU that cannot be loaded or initialised.
    """

    def __init__(
        self, system: System, observers: Sequence[Observer] = (), *, engine: EngineName = "auto"
    ) -> None:
        self.system = system
        self._observers = observers
        self._wiring = wire(system)
        texts = any(
            column.port.kind == "string"
            for station in self._wiring.stations
            for column in (*station.output_columns, *station.input_columns)
        )
        self._course = self._wiring.course
        self._delays = self._wiring.columns_of_delays(system)
        self._choice = choose(engine, self._course.points_ns.size, texts=texts)
        self._journal = Journal(observers)
        self._stack = ExitStack()
        self._stretch = _Stretch()
        self._adjustments: dict[int, Adjustment] = {}
        self._may_go_back = False
        self._in_turns = system.algorithm == "gauss-seidel"
        self._complete = 0
        self._ending: Ending | None = None
        self._reason: str | None = None
        self._halt: Halt | None = None
        self._engine: Engine
        self.initial_passes = 0

    def __enter__(self) -> Self:
        try:
            for name, component in self.system.components.items():
                note = functools.partial(_note, self._journal, name, component.log_level)
                slave = FmuSlave(
                    component.description, name, note, categories=component.log_categories
                )
                self._stack.enter_context(slave)
                self._wiring.station(name).slave = slave
            self.initial_passes = initialise(self.system, self._wiring)
            for observer in self._observers:
                observer.begin(self._wiring.stations)
            self._rebuild()
        except BaseException as error:
            if isinstance(error, CosimError):
                self._journal.note("master", "error", error.text())
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the slaves, and hand on what they say last."""
        try:
            self._stack.close()
        finally:
            self._journal.close()
            # what it has would keep the session, and the session the rows
            place = self._journal.where()
            self._journal.where = lambda: place

    @property
    def time_ns(self) -> int:
        """Where the slaves stand [ns]."""
        return int(self._course.points_ns[min(self._complete, self._course.count - 1)])

    @property
    def time_s(self) -> float:
        """Where the slaves stand [s]."""
        return self.time_ns / 1e9

    @property
    def rows(self) -> int:
        """How many rows are complete."""
        return self._complete

    @property
    def ended(self) -> bool:
        """Whether the end is reached, or the run cannot go on."""
        return self._ending is not None

    def step(self, points: int = 1) -> None:
        """Go on by so many communication points, or to the end."""
        self._go(most=points)

    def run_until(
        self,
        seconds: float | None = None,
        *,
        stop: Condition | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Go on until the slaves stand at a point at or after `seconds`; None: to the end.

        Parameters
        ----------
        stop : looked at after every row; true ends the call (the session can go on).
        pace : holds the run back to the clock on the wall.

        Returns
        -------
        stopped : whether `stop` ended it.
        """
        return self._go(None if seconds is None else round(seconds * 1e9), stop=stop, pace=pace)

    def read(self, component: str, variable: str) -> Any:
        """The value of any variable, as the slave has it now."""
        slave = self._station(component).slave
        return slave.read([variable])[variable]

    def value(self, component: str, variable: str) -> Any:
        """The value of an output or connected input in the last complete row."""
        if self._complete == 0:
            raise InputError(
                "no row is complete yet",
                where=f"{component}.{variable}",
                hint="step() first, or read() what the slave has",
            )
        station = self._station(component)
        k = int(station.beat.last[self._complete - 1])
        for columns, rows in (
            (station.output_columns, station.outputs),
            (station.input_columns, station.inputs(self._complete)),
        ):
            for j, column in enumerate(columns):
                if column.name == variable:
                    return station.values(rows[k : k + 1, j : j + 1], [column])[0][0]
        known = [c.name for c in (*station.output_columns, *station.input_columns)]
        raise InputError.unknown("signal", variable, known, where=f"component {component!r}")

    def set(self, component: str, variable: str, value: Any) -> None:
        """Set a tunable parameter, or an input that nothing is connected to.

        Raises
        ------
        InputError : what cannot be set now, or a connected input.
        """
        station = self._station(component)
        if any(column.name == variable for column in station.input_columns):
            raise InputError(
                "this input is connected: what is set is overwritten at the next point",
                where=f"{component}.{variable}",
                hint="override() it, or set what drives it",
            )
        station.slave.write({variable: value})

    def override(self, component: str, variable: str, value: float) -> None:
        """From now on, `value` in place of an output or connected input."""
        self._adjust(component, variable, Adjustment(0.0, value))

    def bias(self, component: str, variable: str, offset: float, factor: float = 1.0) -> None:
        """From now on, factor * value + offset in place of an output or connected input."""
        self._adjust(component, variable, Adjustment(factor, offset))

    def release(self, component: str, variable: str) -> None:
        """From now on, an output or connected input as it comes."""
        self._adjust(component, variable, None)

    def reset(self, component: str) -> None:
        """Put one component back to how it started, parameters and all; its time goes on.

        Raises
        ------
        ComponentError : its FMU cannot be reset.
        """
        station = self._station(component)
        end = float(self.system.timetable.points_ns[-1]) / 1e9
        station.slave.reset()
        station.slave.initialise(station.component.parameters, self.time_s, end)

    def note(self, level: str, name: str, message: str) -> None:
        """Say something to the observers, at the point where the slaves stand."""
        before = self._journal.where
        self._journal.where = lambda: (self._complete, self.time_ns)
        self._journal.note(name, level, message)
        self._journal.where = before

    def link_state(self, link: str) -> LinkState:
        """State of a packet link at the last complete row, arrays of shape (1,)."""
        return self._course.state(link, self._complete - 1, self._complete)

    @property
    def row_time_ns(self) -> int:
        """Instant of the last complete row [ns]."""
        return int(self._course.points_ns[max(self._complete - 1, 0)])

    def snapshot(self, *, portable: bool = False) -> Snapshot:
        """The whole run as it stands: every slave's state, the rows, what is overridden.

        `portable` : states as bytes, for `Snapshot.save` and for other sessions.

        Raises
        ------
        InputError : a component whose FMU cannot save its state, or serialise it, named.
        """
        self._check_going()
        found = Snapshot.take(
            fingerprint(self.system, self._wiring),
            self._wiring,
            self._complete,
            dict(self._adjustments),
            portable=portable,
        )
        if not self._may_go_back:  # from here on, slaves are told so at each step
            self._may_go_back = True
            self._rebuild()
        return found

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot, of this session or of another one of the same system.

        Raises
        ------
        InputError : a snapshot of another system; an observer, such as a trace, that has seen
            rows which would come about anew.
        """
        snapshot.check(fingerprint(self.system, self._wiring))
        self._journal.rewind(snapshot.complete)
        snapshot.put_back(self._wiring)
        self._complete = snapshot.complete
        self._adjustments = dict(snapshot.adjustments)
        self._ending = self._reason = self._halt = None
        self._rebuild()

    def result(self) -> Run:
        """What has happened so far; "stopped" for a run that has not ended by itself."""
        points = self._course.points_ns[: self._complete]
        return Run(
            self._ending or "stopped",
            self._reason if self._ending else f"stopped at t = {self.time_s:g} s",
            points,
            self._wiring.stations,
            self._choice,
            self._course.schedules(int(points[-1]) if points.size else 0),
        )

    def _go(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Condition | None = None,
        pace: Pace | None = None,
    ) -> bool:
        self._check_open()
        points, begun = self._course.points_ns, self._complete
        while self._ending is None:
            first, last = self._complete, self._course.count
            if until_ns is not None:
                last = int(np.searchsorted(points[:last], until_ns))
            if most is not None:
                last = min(last, begun + most)
            if first >= last:
                return False
            longest = 1 if stop is not None else self._stretch.points
            if pace is not None:
                longest = min(longest, pace.wait(points[: self._course.count], first))
            self._advance(first, min(last, first + longest))
            if pace is not None:
                pace.done(points[: self._course.count], first, self._complete)
            if stop is not None and self._complete > first and stop(self):
                return True
        return False

    def _advance(self, first: int, last: int) -> None:
        began = time.perf_counter()
        horizon = self._course.horizon
        if first == horizon:
            last = first + 1
            halt = self._cross(horizon)
        else:
            last = min(last, horizon)
            halt = self._engine.advance(first, last)
        if self._ending is None:
            self._complete = last if halt is None else halt.complete
        if halt is not None:
            self._halt = halt
            self._ending, self._reason = ending_of(self.system, self._wiring, halt)
            if self._in_turns and halt.what != "range" and halt.complete > halt.k:
                fill_in(self._program, self._wiring.stations, halt)
        elif self._ending is None and self._complete > self._course.final:
            self._ending = "finished"
        # what is said in a step from a point out of range is void, like the step
        self._journal.hand_on(self._complete, said_after=halt is None or halt.what != "range")
        self._stretch.took(last - first, time.perf_counter() - began)
        if self._ending is not None:
            self._conclude()

    def _cross(self, k: int) -> Halt | None:
        """A point at which a message is sent whose delay what is sent there decides."""
        halt = self._engine.send(k)
        if halt is not None:
            return halt
        row = self._wiring.rows[k]
        outside = ~(np.abs(row[: self._wiring.outputs]) <= self.system.divergence)
        if not outside.any():
            try:
                self._course.resolve(k, row, self._delays)
            except InputError as error:
                self._ending, self._reason = "failed", error.text()
                return None
        horizon = self._course.horizon
        self._wiring.lay_out(k, horizon)
        self._engine.known(k, horizon)
        return self._engine.leave(k)

    def _conclude(self) -> None:
        points, halt = self._course.points_ns, self._halt
        level = {"finished": "info", "stopped": "info"}.get(self._ending or "", "error")
        last = halt.k if self._ending == "failed" and halt else max(self._complete - 1, 0)
        place = (self._complete, int(points[last]))
        self._journal.where = lambda: place
        self._journal.note("master", level, self._reason or "the end is reached")

    def _adjust(self, component: str, variable: str, by: Adjustment | None) -> None:
        column = self._column(component, variable)
        if by is None:
            self._adjustments.pop(column, None)
        else:
            self._adjustments[column] = by
        self._rebuild()

    def _column(self, component: str, variable: str) -> int:
        station = self._station(component)
        first = self._wiring.first_output(station)
        for columns, start in (
            (station.output_columns, first),
            (station.input_columns, station.input_column),
        ):
            for j, column in enumerate(columns):
                if column.name == variable and column.port.kind == "string":
                    raise InputError("a text cannot be overridden", where=f"{component}.{variable}")
                if column.name == variable:
                    return start + j
        known = [c.name for c in (*station.output_columns, *station.input_columns)]
        raise InputError.unknown(
            "output or connected input", variable, known, where=f"component {component!r}"
        )

    def _station(self, component: str) -> Station:
        if component not in self.system.components:
            raise InputError.unknown("component", component, self.system.components)
        return self._wiring.station(component)

    def _rebuild(self) -> None:
        for station in self._wiring.stations:
            for number, route in enumerate(station.routes):
                if any(int(column) in self._adjustments for column in route.targets):
                    station.move(number, self._complete)
        self._program = make_program(
            self.system, self._wiring, self._adjustments, may_go_back=self._may_go_back
        )
        self._engine = build(self._choice.name, self._program)
        self._journal.where = self._where

    def _where(self) -> tuple[int, int]:
        k, complete = self._engine.where()
        return k + complete, int(self._course.points_ns[k])

    def _check_open(self) -> None:
        if not hasattr(self, "_engine"):
            raise InputError("the session is not open", where="Session", hint="with Session(...)")

    def _check_going(self) -> None:
        self._check_open()
        if self._ending in ("failed", "diverged"):
            raise InputError(
                "the run cannot go on: nothing is left to save", where="Session", got=self._reason
            )


def _note(
    journal: Journal, name: str, least: LogLevel, level: str, message: str, _category: str
) -> None:
    """Take down what a component says, unless it is asked for less."""
    if _LEVELS.index(level) >= _LEVELS.index(least):
        journal.note(name, level, message)
