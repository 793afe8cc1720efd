"""Sessions that execute the events of their scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Self

from cosim.core import CosimError
from cosim.master import EngineName, Observer, Pace, Run, Session, Snapshot, System
from cosim.scenario.event_driver import EventDriver, LatestValues, ended_by_event
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event, Machine


class ScenarioSession(Session):
    """A session in which the events of a scenario happen at their times and conditions.

    An event at the time of the session has happened when a call returns; one that ends the run
    ends the session. What events override can be overridden by the caller, and the other way
    round: the last one counts.
    """

    def __init__(
        self,
        system: System,
        events: Sequence[Event | Machine] = (),
        observers: Sequence[Observer] = (),
        *,
        engine: EngineName = "auto",
    ) -> None:
        super().__init__(system, observers, engine=engine)
        self._events = events
        self._driver: EventDriver

    def __enter__(self) -> Self:
        super().__enter__()
        rows = LatestValues(RunScope(self.system), self.instances)
        self._driver = EventDriver(self.system, self._events, rows)
        self._driver.execute_due(self)
        return self

    @property
    def ended(self) -> bool:
        """Whether the run is at its end, cannot continue, or was ended by an event."""
        return super().ended or self._driver.stopped is not None

    def step(self, points: int = 1) -> None:
        """Continue by so many communication points, or to the end."""
        target = self.rows + points
        self.run_until(stop=lambda now: now.rows >= target)

    def run_until(
        self,
        seconds: float | None = None,
        *,
        stop: Callable[[Session], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue as `Session.run_until`, through the events on the way."""
        return self._driver.advance(self, self.instant_ns(seconds), stop=stop, pace=pace)

    def result(self, *, complete: bool = False, whole: bool = True) -> Run:
        """Return the run so far, as `Session.result`; an event that ended it is the reason."""
        stopped = self._driver.stopped
        run = super().result(complete=complete or stopped is not None, whole=whole)
        return ended_by_event(run, stopped)

    def snapshot(self, *, portable: bool = False) -> Snapshot:
        """Save the present state of the run as `Session.snapshot`, with that of the events."""
        return replace(super().snapshot(portable=portable), events=self._driver.state())

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot as `Session.restore`, with the events as they were.

        Raises
        ------
        InputError : also a snapshot of a session with other events.
        """
        before = self._driver.state()
        self._driver.restore(snapshot.events)
        try:
            super().restore(snapshot)
        except CosimError:
            self._driver.restore(before)
            raise
