"""Interactive runs: step by step, with variables read and set, saved and restored.

    with Session(system) as session:
        session.run_until(10.0)
        session.set("plant", "damping.u", 0.9)
        before = session.snapshot()
        session.run_until()
        first = session.result()
        session.restore(before)      # continues bit for bit as before

At any time the rows up to the last complete one are fixed, and every slave is at `time_s`, the
point after it. Values are those at `time_s`, and what is set takes effect there.

What a call may do depends on the state of the session: loading, running, ended, failed, closed;
docs/reference/outcomes.md has the table. The call in which a session fails raises, and so does
every later one. Results own their rows, and are valid after the session.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    Self,
    get_args,
)

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError, CosimError, InputError
from cosim.fmu import FmuSlave
from cosim.master.adjustments import Adjustment
from cosim.master.component_instance import ComponentInstance
from cosim.master.engine import EngineChoice, EngineName, choose_engine
from cosim.master.event_instance import EventInstance
from cosim.master.event_systems import slave_options
from cosim.master.guards import Guards
from cosim.master.initialisation import Initialisation
from cosim.master.loop import Loop
from cosim.master.observers import Observer, ObserverDispatch
from cosim.master.order import receiving_order
from cosim.master.pacing import Pace
from cosim.master.parts import LogLevel
from cosim.master.run import Run, RunStatus
from cosim.master.session_base import SessionBase, one_thread_at_a_time
from cosim.master.snapshot import Snapshot, fingerprint
from cosim.master.structure import can_be_reset, same_structure
from cosim.master.system import System
from cosim.master.wire import wire
from cosim.master.wiring import Wiring
from cosim.network import LinkState
from cosim.trace.outcome import Cause

if TYPE_CHECKING:
    from cosim.fmu import SlaveProcess

_LEVELS = get_args(LogLevel)
_MOST_KEPT = 20_000_000
Condition = Callable[["Session"], bool]


class Session(SessionBase):
    """A run of a system that the caller controls; use as a context manager.

    Parameters
    ----------
    system : the system to run.
    observers : receive rows and log lines, such as a `TraceRecorder`.
    engine : "kernel", "python", or "auto": the kernel where it can be (`choose_engine`).
    keep : whether all rows stay in memory, for `result` and `snapshot`; else only those that may
        still be read, and the run can be of any length.
    wiring, dispatch, word : those of a process that watches this one
        (`cosim.master.supervision`); by default the session's own.
    call_limit : of one call of an isolated slave during the run [s of wall-clock time]; None: no
        limit.
    process_started : called with each process of an isolated slave, before it loads anything.

    Raises
    ------
    InputError : a system with an algebraic loop, a parameter that does not exist, an engine that
        is not installed, isolated components on a system that has no way to isolate them. (From
        `__enter__`: the FMUs are loaded there.)
    ComponentError : an FMU that cannot be loaded or initialised.
    """

    def __init__(
        self,
        system: System,
        observers: Sequence[Observer] = (),
        *,
        engine: EngineName = "auto",
        keep: bool = True,
        wiring: Wiring | None = None,
        dispatch: ObserverDispatch | None = None,
        word: NDArray[np.int64] | None = None,
        call_limit: float | None = None,
        process_started: Callable[[SlaveProcess], None] | None = None,
    ) -> None:
        super().__init__(system)
        self._call_limit, self._process_started = call_limit, process_started
        self._observers = observers
        self._wiring = wiring or wire(system)
        self._word, self._keep = word, keep
        if keep and self._wiring.comm_points.most > _MOST_KEPT:
            raise InputError(
                "the run has too many points to keep all of its rows",
                where="Session",
                expected=f"at most {_MOST_KEPT}",
                got=str(self._wiring.comm_points.most),
                hint="a longer step, a shorter run, or keep=False: observers receive the rows",
            )
        texts = any(
            column.port.kind in ("string", "binary")
            for instance in self._wiring.instances
            for column in (*instance.output_columns, *instance.input_columns)
        )
        self._comm_points = self._wiring.comm_points
        events = system.has_events
        self._choice = choose_engine(engine, texts=texts, events=events, threads=system.threads)
        self._in_event_mode: dict[int, EventInstance] = {}
        self._dispatch = dispatch or ObserverDispatch(observers)
        self._dispatch.points = self._comm_points
        self._stack = ExitStack()
        self._loop: Loop | None = None
        self._initialisation = Initialisation(self._wiring)
        self.initial_passes = 0

    def __enter__(self) -> Self:
        try:
            processes = self._start_processes()
            alone = sum(one.has_events for one in self.system.components.values()) == 1
            for name, component in self.system.components.items():
                note = functools.partial(_note, self._dispatch, name, component.log_level)
                slave = FmuSlave(
                    component.description,
                    name,
                    note,
                    categories=component.log_categories,
                    process=processes.get(name),
                    options=slave_options(component, alone=alone),
                )
                self._stack.enter_context(slave)
                self._wiring.instance(name).slave = slave
            self._in_event_mode = {
                number: EventInstance(number, instance)
                for number, instance in enumerate(self._wiring.instances)
                if instance.component.has_events
            }
            self._begin_run()
            self._loop = Loop(
                *(self.system, self._wiring, self._dispatch, self._choice, self._word),
                self._in_event_mode,
                keep=self._keep,
            )
        except BaseException as error:
            self._break_off(error)
            raise
        return self

    def _begin_run(self) -> None:
        events = self._in_event_mode.values()
        self.initial_passes = self._initialisation.run(self.system, events)
        for observer in self._observers:
            observer.begin(self._wiring.instances)

    def _break_off(self, error: BaseException) -> None:
        if isinstance(error, CosimError):
            self._dispatch.note("master", "error", error.text())
        self.close()

    @one_thread_at_a_time
    def begin_again(self, system: System, observers: Sequence[Observer] = ()) -> None:
        """Begin another run from its start, with the same slaves; its rows replace those there are.

        Parameters
        ----------
        system : one that `can_begin_again` says this of.
        observers : of the new run, in place of those so far.

        Raises
        ------
        InputError, ComponentError : as `__enter__`; the session is closed then.
        """
        loop = self._opened()
        self.system, self._observers = system, observers
        self._named.clear()
        try:
            self._dispatch.begin(observers)
            self._wiring.begin_again(system)
            for instance in self._wiring.instances:
                instance.slave.reset()
            self._begin_run()
            loop.begin_again(system)
        except BaseException as error:
            self._break_off(error)
            raise

    def can_begin_again(self, system: System) -> bool:
        """Whether `begin_again` is a new session of a system, bit for bit.

        It is where the systems differ only in start values, driven signals and what links do to
        messages, and all slaves can be reset to what a new one is.
        """
        slaves = [instance.slave for instance in self._wiring.instances] if self.opened else []
        return (
            bool(slaves)
            and self._keep
            and all(slave.phase == "stepping" for slave in slaves)
            and can_be_reset(system)
            and (self.system.form is system.form or same_structure(self.system, system))
            and receiving_order(self.system) == receiving_order(system)
        )

    def _start_processes(self) -> dict[str, SlaveProcess]:
        """Start the processes of isolated slaves, before an FMU is loaded in this one."""
        processes = {}
        for name, component in self.system.components.items():
            if component.isolate:
                from cosim.fmu import SlaveProcess  # noqa: PLC0415 - few components are isolated

                process = SlaveProcess(name, component.description, call_limit=self._call_limit)
                self._stack.callback(process.close)
                processes[name] = process
        for process in processes.values():
            process.wait_until_ready()
            if self._process_started is not None:
                self._process_started(process)
        return processes

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Terminate the slaves and deliver their last log lines."""
        with self.in_use:  # a call of another thread returns first
            self._closed = True
            try:
                if self._loop is not None:
                    self._loop.close()
                self._stack.close()
            finally:
                self.release_observers()
                # the function refers to the session, which would keep the rows in memory
                place = self._dispatch.where()
                self._dispatch.where = lambda: place

    def release_observers(self) -> None:
        """Deliver the last log lines to the observers; they receive nothing more."""
        self._dispatch.close()

    @property
    def opened(self) -> bool:
        """Whether its slaves are initialised."""
        return self._loop is not None

    @property
    def end_failure(self) -> ComponentError | None:
        """What ended the process of an isolated slave as it was terminated or freed."""
        slaves = (vars(instance).get("slave") for instance in self._wiring.instances)
        return next((s.end_failure for s in slaves if s is not None and s.end_failure), None)

    @property
    def engine(self) -> EngineChoice:
        """The engine that executes it, and why it was chosen."""
        return self._choice

    @property
    def instances(self) -> Sequence[ComponentInstance]:
        """The component instances, in the order in which they receive."""
        return self._wiring.instances

    @property
    def time_ns(self) -> int:
        """The time of the run [ns]; it begins at 0, also where the slaves' time does not."""
        return 0 if self._loop is None else self._loop.time_ns

    @property
    def rows(self) -> int:
        """The number of complete rows."""
        return 0 if self._loop is None else self._loop.complete

    @property
    def reason(self) -> str | None:
        """As `Run.reason`; None while it runs."""
        return None if self._loop is None else self._loop.reason

    @property
    def cause(self) -> Cause | None:
        """As `Run.cause`; None while it runs."""
        return None if self._loop is None else self._loop.cause

    @property
    def status(self) -> RunStatus | Literal["running"] | None:
        """How the run stands: "running", or as `Run.status`; None before it is loaded."""
        return None if self._loop is None else self._loop.status or "running"

    @one_thread_at_a_time
    def step(self, points: int = 1) -> None:
        """Continue by so many communication points, or to the end.

        Raises
        ------
        ComponentError : the run fails here, or has failed.
        InputError : it has ended, or the session is not open.
        """
        self._check_running()
        self.go_on(most=points)
        self.check_not_failed()

    @one_thread_at_a_time
    def run_until(
        self,
        seconds: float | None = None,
        *,
        stop: Condition | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue to the first point at or after `seconds` (None: the end).

        Parameters
        ----------
        stop : evaluated after every row; true ends the call (the session can continue).
        pace : slows the run down to wall-clock time.

        Returns
        -------
        stopped : whether `stop` ended the call.

        Raises
        ------
        ComponentError : the run fails on the way, or has failed.
        InputError : it has ended before, or the session is not open.
        """
        self.check_can_run_until(seconds)
        until = self.instant_ns(seconds)
        stopped = not self.ended and self.go_on(until, stop=stop, pace=pace)
        self.check_not_failed()
        return stopped

    def check_can_run_until(self, seconds: float | None) -> None:
        """Raise what `run_until` raises before it begins."""
        until = self.instant_ns(seconds)
        reached = self.status == "finished" if until is None else until <= self.time_ns
        self._check_running(or_ended=reached)

    @one_thread_at_a_time
    def go_on(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Condition | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue to an instant, by `most` points, or to the end; for those who look at `status`.

        As `run_until` and `step`, but for an end or a failure, which raise nothing.
        """
        return self.advance(until_ns, most=most, stop=stop, pace=pace)

    @one_thread_at_a_time
    def advance(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Condition | None = None,
        guards: Guards | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue as `go_on`, without events; `guards` end it behind a row that misses one."""
        look = None if stop is None else functools.partial(stop, self)
        return self._opened().run(until_ns, most=most, stop=look, guards=guards, pace=pace)

    @one_thread_at_a_time
    def read(self, component: str, variable: str) -> Any:
        """Return the present value of any variable, read from the slave."""
        self._alive()
        slave = self._instance(component).slave
        with self._called():
            return slave.read([variable])[variable]

    @one_thread_at_a_time
    def value(self, component: str, variable: str) -> Any:
        """Return the value of an output or connected input at `time_s`.

        What is exchanged only when the run continues has the value of the last complete row: inputs
        under Gauss-Seidel, and at a point that decides the delay of a message whatever is not
        sent there.
        """
        loop, instance = self._alive(), self._instance(component)
        number, column = instance.place(variable)
        row = loop.complete - (not loop.exchange(number))
        self._wiring.make_whole(row + 1)
        k = int(instance.own_points.last[max(row, 0)])
        return instance.values(instance.rows[k : k + 1, number : number + 1], [column])[0][0]

    @one_thread_at_a_time
    def set(self, component: str, variable: str, value: Any) -> None:
        """Set a tunable parameter, or an input that is not connected.

        Raises
        ------
        InputError : a variable that cannot be set now, or a connected input.
        """
        loop, instance = self._alive(), self._instance(component)
        if any(column.name == variable for column in instance.input_columns):
            raise InputError(
                "this input is connected: its value would be overwritten at the next point",
                where=f"{component}.{variable}",
                hint="override() it, or set its source",
            )
        with self._called():
            instance.slave.write({variable: value})
        for one in self._in_event_mode.values():
            one.event_needed |= one.instance is instance  # what is set may be an event
        loop.forget_exchange()

    def override(self, component: str, variable: str, value: float) -> None:
        """Replace an output or connected input by `value`, until it is released."""
        self._adjust(component, variable, Adjustment(0.0, value))

    def bias(self, component: str, variable: str, offset: float, factor: float = 1.0) -> None:
        """Replace an output or connected input by factor * value + offset, until released."""
        self._adjust(component, variable, Adjustment(factor, offset))

    def release(self, component: str, variable: str) -> None:
        """End the override or bias of an output or connected input."""
        self._adjust(component, variable, None)

    @one_thread_at_a_time
    def set_event_value(self, name: str, value: float) -> None:
        """Set a value that holds from now on: `LINK.delay` [ns], `LINK.loss`, a machine's mode.

        NaN ends it. The link must be adjustable (`PacketLink.adjustable`).
        """
        loop = self._alive()
        self._comm_points.event_values.set(name, self.time_ns, value)
        if name in self.system.modes:
            self._wiring.change_mode(name, loop.complete)
            loop.forget_exchange()

    @one_thread_at_a_time
    def reset(self, component: str) -> None:
        """Reset one component to its start values and parameters, at the present time.

        Raises
        ------
        ComponentError : its FMU cannot be reset.
        """
        loop, instance = self._alive(), self._instance(component)
        end = self._comm_points.at_s(self.system.comm_schedule.end_ns)
        with self._called():
            instance.slave.reset()
            instance.slave.set_start(instance.component.parameters)
            instance.slave.enter_initialisation(self.time_s, end)
            for one in self._in_event_mode.values():
                if one.instance is instance:
                    one.prepare(Fraction(self.time_ns, 10**9))
            instance.slave.exit_initialisation()
        loop.forget_exchange()

    def note(self, level: str, name: str, message: str, *, time_ns: int | None = None) -> None:
        """Log a message to the observers, at the time of the slaves or at another one [ns]."""
        before = self._dispatch.where
        place = self.rows, self.time_ns if time_ns is None else time_ns
        self._dispatch.where = lambda: place
        self._dispatch.note(name, level, message)
        self._dispatch.where = before

    def deliver(self) -> None:
        """Deliver the log lines since the last row to the observers."""
        self._dispatch.deliver(self.rows)

    def link_state(self, link: str) -> LinkState:
        """Return the state of a packet link at the last complete row, arrays of shape (1,)."""
        self._alive()
        return self._comm_points.state(link, self.rows - 1, self.rows)

    def make_rows_whole(self) -> None:
        """Make the complete rows whole: inputs are copied into them when they are asked for."""
        self._wiring.make_whole(self.rows)

    @property
    def row_time_ns(self) -> int:
        """The time of the run at the last complete row [ns]."""
        return int(self._comm_points.points_ns[max(self.rows - 1, 0)])

    @one_thread_at_a_time
    def snapshot(self, *, portable: bool = False) -> Snapshot:
        """Save the present state of the run: of every slave, the rows, the overrides.

        `portable` : states as bytes, for `Snapshot.save` and for other sessions.

        Raises
        ------
        InputError : a component whose FMU cannot save its state, or serialise it, named.
        """
        loop = self._alive()
        self._check_without_events()
        self._check_kept("there is no snapshot of a run whose rows are not kept")
        if loop.status == "diverged":
            raise InputError(
                "the run cannot go on: there is no state to save", where="Session", got=loop.reason
            )
        with self._called():
            found = Snapshot.take(
                fingerprint(self.system, self._wiring),
                self._wiring,
                loop.complete,
                loop.adjustments.all(),
                portable=portable,
            )
        loop.table.no_way_back[0] = 0  # FMI: each step must announce this to the slaves
        return found

    @one_thread_at_a_time
    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot, of this session or of another one of the same system.

        Raises
        ------
        InputError : a snapshot of another system; an observer, such as a trace, that has
            received rows which would be computed anew.
        ComponentError : the run has failed, and with it a component.
        """
        loop = self._opened()
        if self._dead():
            self.check_not_failed()
        snapshot.check(fingerprint(self.system, self._wiring))
        self._dispatch.rewind(snapshot.complete)
        with self._called():
            snapshot.restore_into(self._wiring)
        loop.go_back(snapshot.complete, snapshot.adjustments)

    def result(self, *, complete: bool = False) -> Run:
        """Return the run so far; its status is "stopped" if it has not ended by itself.

        Its rows are its own. It includes the values at `time_s`, where they are known before the
        run continues (see `value`); `complete` : rows that are complete only, as the observers
        have them.
        """
        return self.run_so_far(complete=complete).owned()

    @one_thread_at_a_time
    def run_so_far(self, *, complete: bool = False, whole: bool = True) -> Run:
        """Return `result` with the rows of the session, which it writes over when it goes on.

        whole : as in `Run.of`.
        """
        loop = self._opened()
        known = not complete and loop.exchange(self._wiring.rows.shape[1] - 1)
        return loop.result(loop.complete + known, whole=whole)

    @one_thread_at_a_time
    def _adjust(self, component: str, variable: str, by: Adjustment | None) -> None:
        loop, column = self._alive(), self._column(component, variable)
        loop.adjust(column, by)

    def _column(self, component: str, variable: str) -> int:
        number, column = self._instance(component).place(variable, "output or connected input")
        if column.port.kind in ("string", "binary", "clock"):
            what = {"string": "a text", "binary": "bytes", "clock": "the tick of a Clock"}
            where = f"{component}.{variable}"
            raise InputError(f"{what[column.port.kind]} cannot be overridden", where=where)
        return number

    def _check_without_events(self) -> None:
        if self._in_event_mode:
            raise InputError(
                "there is no snapshot of a run whose components have events",
                where="Session",
                got=", ".join(one.instance.name for one in self._in_event_mode.values()),
                hint="event_mode = false for these components",
            )

    def _check_kept(self, what: str) -> None:
        if not self._keep:
            raise InputError(what, where="Session", hint="Session(..., keep=True)")

    def _instance(self, component: str) -> ComponentInstance:
        if component not in self.system.components:
            raise InputError.unknown("component", component, self.system.components)
        return self._wiring.instance(component)

    def _opened(self) -> Loop:
        self.check_open()
        assert self._loop is not None  # noqa: S101 - it is open
        return self._loop

    def _alive(self) -> Loop:
        loop = self._opened()
        self.check_not_failed()
        return loop

    def _check_running(self, *, or_ended: bool = False) -> None:
        self._alive()
        if self.ended and not or_ended:
            raise InputError(
                "the run has ended",
                where="Session",
                got=self.end_reason,
                hint="ask session.ended before going on; restore() goes back to a snapshot",
            )

    @property
    def end_reason(self) -> str:
        """Why the run does not go on, in words."""
        loop = self._opened()
        return loop.reason or f"the end is reached at t = {self.time_s:g} s"

    def _dead(self) -> ComponentInstance | None:
        """Return a component that can only be closed."""
        found = (one for one in self.instances if one.slave.phase in ("failed", "closed"))
        return next(found, None)

    @contextmanager
    def _called(self) -> Iterator[None]:
        """Note that the run has failed where a call of a component kills it."""
        try:
            yield
        except ComponentError as error:
            if (dead := self._dead()) is not None:
                self._opened().fail(error, dead.name)
            raise


def simulate(
    system: System, observers: Sequence[Observer] = (), *, engine: EngineName = "auto"
) -> Run:
    """Run a system from 0 to its end, or to where it diverges or fails.

    Parameters
    ----------
    engine : "kernel", "python", or "auto": the kernel where it can be (`choose_engine`).

    Raises
    ------
    InputError, ComponentError : as `Session`.
    """
    with Session(system, observers, engine=engine) as session:
        session.go_on()
        return session.run_so_far()


def _note(
    dispatch: ObserverDispatch, name: str, least: LogLevel, level: str, message: str, _category: str
) -> None:
    """Log a message of a component, unless it is below its log level."""
    if _LEVELS.index(level) >= _LEVELS.index(least):
        dispatch.note(name, level, message)
