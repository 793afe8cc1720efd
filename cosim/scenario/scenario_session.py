"""Sessions that execute the events of their scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, Self

from cosim.core import CosimError, InputError
from cosim.master import (
    EngineName,
    Observer,
    Pace,
    Run,
    RunStatus,
    Session,
    Snapshot,
    System,
    one_thread_at_a_time,
)
from cosim.scenario.event_driver import EventDriver, LatestValues, ended_by_event
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event, Machine


class ScenarioSession(Session):
    """A session in which the events of a scenario happen at their times and conditions.

    An event at the time of the session has happened when a call returns; one that ends the run
    ends the session. What events override can be overridden by the caller, and the other way
    round: the last one counts.

    of_session : more arguments of `Session`.
    """

    def __init__(
        self,
        system: System,
        events: Sequence[Event | Machine] = (),
        observers: Sequence[Observer] = (),
        *,
        engine: EngineName = "auto",
        **of_session: Any,
    ) -> None:
        super().__init__(system, observers, engine=engine, **of_session)
        self._events = events
        self._driver: EventDriver | None = None

    def __enter__(self) -> Self:
        super().__enter__()
        try:
            rows = LatestValues(RunScope(self.system), self.instances)
            self._driver = EventDriver(self.system, self._events, rows)
            self._driver.execute_due(self)
        except BaseException as error:
            self._break_off(error)
            raise
        return self

    @property
    def status(self) -> RunStatus | Literal["running"] | None:
        """How the run stands; "stopped" also where an event has ended it."""
        found = super().status
        return "stopped" if found == "running" and self._stopped is not None else found

    @property
    def end_reason(self) -> str:
        """Why the run does not go on, in words."""
        return self._stopped or super().end_reason

    @property
    def _stopped(self) -> str | None:
        return self._driver.stopped if self._driver is not None else None

    @one_thread_at_a_time
    def go_on(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Callable[[Session], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue as `Session.go_on`, through the events on the way."""
        if self._driver is None:
            raise InputError("the session is not open", where="Session", hint="with open_session")
        return self._driver.advance(self, until_ns, most=most, stop=stop, pace=pace)

    def run_so_far(self, *, complete: bool = False, whole: bool = True) -> Run:
        """Return the run so far, as `Session.run_so_far`; an event that ended it is the reason."""
        stopped = self._stopped
        run = super().run_so_far(complete=complete or stopped is not None, whole=whole)
        return ended_by_event(run, stopped)

    @one_thread_at_a_time
    def snapshot(self, *, portable: bool = False) -> Snapshot:
        """Save the present state of the run as `Session.snapshot`, with that of the events."""
        found = super().snapshot(portable=portable)
        return found if self._driver is None else replace(found, events=self._driver.state())

    @one_thread_at_a_time
    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot as `Session.restore`, with the events as they were.

        Raises
        ------
        InputError : also a snapshot of a session with other events.
        """
        if self._driver is None:
            super().restore(snapshot)  # which refuses it
            return
        before = self._driver.state()
        self._driver.restore(snapshot.events)
        try:
            super().restore(snapshot)
        except CosimError:
            self._driver.restore(before)
            raise
