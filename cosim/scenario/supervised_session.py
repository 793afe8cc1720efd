"""Sessions whose components live in a child process, as those of a run do.

The session itself (`ScenarioSession`) is in the child; this one asks it, call by call, and has its
rows in memory that both processes map. What a component does to its process is a failure of the
session: a `ComponentError` of that call and of every later one. Limits hold for each call.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from operator import methodcaller
from typing import Any, Concatenate, Literal, NamedTuple, ParamSpec, Self, TypeVar
from weakref import finalize

from cosim.core import ComponentError, InputError
from cosim.master import (
    Adjustment,
    AskedError,
    BrokenOffError,
    ComponentInstance,
    EngineChoice,
    EngineName,
    FollowedSession,
    Limits,
    Observer,
    Pace,
    Run,
    RunStatus,
    Session,
    SessionBase,
    SessionState,
    Snapshot,
    Supervisor,
    System,
    error_of,
    one_thread_at_a_time,
)
from cosim.network import LinkState
from cosim.scenario.interrupt import DeferredInterrupt
from cosim.scenario.scenario_session import ScenarioSession
from cosim.scenario.script import Event, Machine
from cosim.trace.outcome import Cause

Condition = Callable[["SupervisedSession"], bool]
P = ParamSpec("P")
T = TypeVar("T")


def _in_the_child(
    method: Callable[Concatenate[Any, P], T],
) -> Callable[Concatenate[SupervisedSession, P], T]:
    """Return a method of a session as one that is called in the child."""
    result = None if method.__annotations__["return"] == "None" else Any

    @functools.wraps(method)
    def asked(self: SupervisedSession, /, *args: P.args, **kwargs: P.kwargs) -> T:
        found: T = self._ask(methodcaller(method.__name__, *args, **kwargs), result=result)
        return found

    return asked


class SupervisedSession(SessionBase):
    """A session in a child process, with the methods of `ScenarioSession`; a context manager.

    Parameters
    ----------
    events, observers, engine : as for `ScenarioSession`; observers receive rows and log lines in
        this process.
    limits : `call`, `start`, `end` and `memory` of a run; `run` is of one call of the session.

    Raises
    ------
    InputError, ComponentError : as `Session`.
    """

    _how_to_open = "with open_session"

    def __init__(
        self,
        system: System,
        events: Sequence[Event | Machine] = (),
        observers: Sequence[Observer] = (),
        *,
        engine: EngineName = "auto",
        limits: Limits | None = None,
    ) -> None:
        super().__init__(system)
        self._events, self._observers, self._engine = events, observers, engine
        self._limits = limits
        self._interruption = DeferredInterrupt()
        self._opened: ExitStack | None = None
        self._run: FollowedSession
        self._state = SessionState(0, 0, None, None, None, "")
        self._broken: Run | None = None
        self._forgotten: list[int] = []

    def __enter__(self) -> Self:
        make = functools.partial(ScenarioSession, events=self._events)
        with ExitStack() as stack:
            supervisor = Supervisor(self._limits, interruption=self._interruption)
            stack.enter_context(supervisor)
            self._run = supervisor.open(self.system, self._observers, make, engine=self._engine)
            stack.callback(self._run.close)
            with self._interruption:
                try:
                    self._state = self._run.answer().state
                except AskedError as asked:
                    self._interruption.raise_if_requested()
                    raise asked.error from None
                except BrokenOffError as broken:
                    self._break_off(broken)
                    self._interruption.raise_if_requested()
                    raise self._failure() from None
            self._interruption.raise_if_requested()
            self._opened = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Terminate the slaves and end their process; deliver the last log lines."""
        with self.in_use:  # a call of another thread returns first
            self._closed = True
            opened, self._opened = self._opened, None
            if opened is not None:
                opened.close()

    step = _in_the_child(Session.step)

    @one_thread_at_a_time
    def run_until(
        self,
        seconds: float | None = None,
        *,
        stop: Condition | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue to the first point at or after `seconds` (None: the end).

        As `Session.run_until`; `stop` is evaluated in this process, and with it every row is asked
        for alone.
        """
        if stop is None and pace is None:
            return bool(self._ask(methodcaller("run_until", seconds), result=bool))
        self._ask(_check_running, seconds)
        until = self.instant_ns(seconds)
        stopped = self._by_parts(until, stop, pace)
        if self.status == "failed":
            raise self._failure()
        return stopped

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
        with suppress(ComponentError):
            if stop is None and pace is None:
                return bool(self._ask(_go_on, until_ns, most, result=bool))
            return self._by_parts(until_ns, stop, pace)
        self.check_open()
        return False

    def _by_parts(self, until_ns: int | None, stop: Condition | None, pace: Pace | None) -> bool:
        """Continue by as many points at a time as `stop` and `pace` allow."""
        while self.status == "running" and (until_ns is None or self.time_ns < until_ns):
            first, most = self.rows, 1
            if pace is not None:
                with self._interruption:
                    due = pace.wait(
                        self._run.points_ns, first, self._interruption.raise_if_requested
                    )
                self._interruption.raise_if_requested()
                most = due if stop is None else 1
            self._ask(_go_on, until_ns, most)
            if pace is not None:
                pace.done(self._run.points_ns, first, self.rows)
            if stop is not None and self.rows > first and stop(self):
                return True
        return False

    read = _in_the_child(Session.read)
    value = _in_the_child(Session.value)
    set = _in_the_child(Session.set)
    override = _in_the_child(Session.override)
    bias = _in_the_child(Session.bias)
    release = _in_the_child(Session.release)
    set_event_value = _in_the_child(Session.set_event_value)
    reset = _in_the_child(Session.reset)
    note = _in_the_child(Session.note)

    @one_thread_at_a_time
    def link_state(self, link: str) -> LinkState:
        """Return the state of a packet link at the last complete row, arrays of shape (1,)."""
        self._ask(_alive)
        return self._run.link_state(link, self.rows)

    @one_thread_at_a_time
    def snapshot(self, *, portable: bool = False) -> Snapshot:
        """Save the present state of the run; as `Session.snapshot`."""
        if not portable:
            forgotten = tuple(self._forgotten)
            del self._forgotten[:]
            kept: Any = _Kept(self, self._ask(_keep, forgotten, result=int))
            states = dict.fromkeys(self.system.components, kept)
            found = replace(self._run.snapshot(self.rows), states=states)
            finalize(found, self._forgotten.append, kept.number)
            return found
        saved = self._ask(_portable, result=_Saved)
        adjustments = {column: Adjustment(*by) for column, by in saved.adjustments.items()}
        return replace(
            self._run.snapshot(self.rows, whole=True),
            states=saved.states,
            adjustments=adjustments,
            events=saved.events,
        )

    @one_thread_at_a_time
    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot; as `Session.restore`."""
        self.check_open()
        self._check_not_broken()
        self._run.check_snapshot(snapshot)
        kept = next(iter(snapshot.states.values()), None)
        if isinstance(kept, _Kept) and kept.session is not self:
            raise InputError(
                "the snapshot is bound to another session",
                where="Session.restore",
                hint="take it with session.save(portable=True)",
            )
        self._run.rewind(snapshot.complete)
        if isinstance(kept, _Kept):
            self._ask(_restore_kept, kept.number)
        else:
            self._ask(methodcaller("restore", snapshot))
        self._run.go_back(snapshot)

    @one_thread_at_a_time
    def result(self, *, complete: bool = False) -> Run:
        """Return the run so far, with rows of its own; as `Session.result`."""
        self.check_open()
        if self._broken is not None:
            return self._broken
        so_far = self._ask(_so_far, complete, result=_SoFar)
        return self._run.run_so_far(*so_far)

    @property
    def opened(self) -> bool:
        """Whether its slaves are initialised."""
        return self._opened is not None

    @property
    def engine(self) -> EngineChoice:
        """The engine that executes it, and why it was chosen."""
        return self._run.engine

    @property
    def instances(self) -> Sequence[ComponentInstance]:
        """The component instances, in the order in which they receive; their slaves are there."""
        return self._run.instances

    @property
    def time_ns(self) -> int:
        """The time of the run [ns]; it begins at 0, also where the slaves' time does not."""
        return self._state.time_ns

    @property
    def rows(self) -> int:
        """The number of complete rows."""
        return self._state.rows

    @property
    def row_time_ns(self) -> int:
        """The time of the run at the last complete row [ns]."""
        return int(self._run.points_ns[max(self.rows - 1, 0)])

    @property
    def status(self) -> RunStatus | Literal["running"] | None:
        """How the run stands: "running", or as `Run.status`; None before it is loaded."""
        return self._state.status

    @property
    def reason(self) -> str | None:
        """As `Run.reason`; None while it runs."""
        return self._state.reason

    @property
    def cause(self) -> Cause | None:
        """As `Run.cause`; None while it runs."""
        return self._state.cause

    @property
    def end_failure(self) -> ComponentError | None:
        """What ended the child as the components were terminated or freed."""
        found = self._run.end_failure
        return None if found is None or not found[0].failure else error_of(*found)

    @property
    def end_reason(self) -> str:
        """Why the run does not go on, in words."""
        self.check_open()
        return self._state.end_reason

    def _check_not_broken(self) -> None:
        if self._broken is not None:
            raise self._failure()

    @one_thread_at_a_time
    def _ask(self, function: Callable[..., Any], *arguments: Any, result: Any = None) -> Any:
        """Have a function called with the session in the child; return its result.

        Raises
        ------
        CosimError : what it raises; a ComponentError if the child is gone.
        KeyboardInterrupt, SystemExit : after a signal; the session can go on if it has stopped in
            time between two steps.
        """
        self.check_open()
        self._check_not_broken()
        try:
            with self._interruption:
                found, self._state = self._run.ask(function, *arguments, result=result)
        except AskedError as asked:
            self._state = asked.state or self._state
            self._interruption.raise_if_requested()
            raise asked.error from None
        except BrokenOffError as broken:
            self._break_off(broken)
            self._interruption.raise_if_requested()
            raise self._failure() from None
        self._interruption.raise_if_requested()
        return found

    def _break_off(self, broken: BrokenOffError) -> None:
        self._broken = run = self._run.broken_off(broken).owned()
        words = run.reason or broken.words
        self._state = SessionState(run.end_ns, run.count, "failed", words, run.cause, words)


class _Kept(NamedTuple):
    """In place of the state of a component: the child keeps the snapshot under a number."""

    session: SupervisedSession
    number: int


class _Saved(NamedTuple):
    """What a portable snapshot has beside rows and texts, which both processes have."""

    states: dict[str, bytes]
    adjustments: dict[int, tuple[float, float]]
    events: dict[str, Any]


class _SoFar(NamedTuple):
    """Number of rows, status, reason and cause of a run so far."""

    rows: int
    status: RunStatus
    reason: str | None
    cause: Cause | None


# --- what the child is asked to do with its session

_kept: dict[int, Snapshot] = {}


def _go_on(session: Session, until_ns: int | None, most: int | None) -> bool:
    return session.go_on(until_ns, most=most)


def _check_running(session: Session, seconds: float | None) -> None:
    """Raise what `run_until` raises before it begins."""
    session.check_can_run_until(seconds)


def _alive(session: Session) -> None:
    session.check_not_failed()


def _keep(session: Session, forgotten: Sequence[int]) -> int:
    for number in forgotten:
        _kept.pop(number, None)
    found = session.snapshot()
    number = max(_kept, default=0) + 1
    _kept[number] = found
    return number


def _portable(session: Session) -> _Saved:
    found = session.snapshot(portable=True)
    states: Mapping[str, Any] = found.states
    adjustments = {column: (by.factor, by.offset) for column, by in found.adjustments.items()}
    return _Saved(dict(states), adjustments, dict(found.events))


def _restore_kept(session: Session, number: int) -> None:
    session.restore(_kept[number])


def _so_far(session: Session, complete: bool) -> _SoFar:  # noqa: FBT001 - sent by place
    found = session.run_so_far(complete=complete)
    return _SoFar(found.count, found.status, found.reason, found.cause)
