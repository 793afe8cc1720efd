"""Run a system once, with events, progress reports and interruption."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import ClassVar

from cosim.core import Progress
from cosim.master import (
    ComponentInstance,
    EngineName,
    Observer,
    Pace,
    PaceFigures,
    Run,
    Session,
    Supervisor,
    System,
)
from cosim.scenario.event_driver import EventDriver, LatestValues, ended_by_event
from cosim.scenario.interrupt import DeferredInterrupt
from cosim.scenario.run_series import RunSeries
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event, Machine


class ProgressObserver(Observer):
    """Reports the progress of a run, and ends it on Ctrl-C between two steps."""

    reads_inputs = False

    def __init__(
        self,
        system: System,
        what: str,
        report_progress: Progress,
        interruption: DeferredInterrupt | None = None,
    ) -> None:
        self._end_ns = system.comm_schedule.end_ns
        self._what, self._report_progress, self._interruption = what, report_progress, interruption

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Report the start."""
        self._points_ns = instances[0].comm_points.points_ns if instances else None
        self.rows_complete(0, 0)

    def rows_complete(self, first: int, last: int) -> None:
        """Report that rows up to `last` are done."""
        del first
        if self._interruption is not None:
            self._interruption.raise_if_requested()
        now = int(self._points_ns[last - 1]) if last and self._points_ns is not None else 0
        self._report_progress(self._what, now / self._end_ns)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Do nothing: log lines go to the trace."""


@dataclass(frozen=True)
class EventResults:
    """What the events of a run did (`EventDriver`), and how its pace was kept (`Pace.figures`)."""

    stopped: str | None = None
    altered: tuple[str, ...] = ()
    event_counts: tuple[int, ...] = ()
    pace: PaceFigures | None = None


@dataclass(frozen=True)
class DriveEvents:
    """Runs a session from its start to its end, or to where an event stops it."""

    events: Sequence[Event | Machine] = ()
    pace: Pace | None = None
    result: ClassVar[type] = EventResults

    def __call__(self, session: Session) -> EventResults:
        """Run it."""
        rows = LatestValues(RunScope(session.system), session.instances)
        driver = EventDriver(session.system, self.events, rows)
        driver.drive(session, self.pace)
        counts = tuple(driver.event_counts)
        figures = None if self.pace is None else self.pace.figures
        return EventResults(driver.stopped, tuple(driver.altered), counts, figures)


@dataclass(frozen=True)
class CompletedRun:
    """A run, what events changed but the traffic of links, and how often each happened."""

    run: Run
    altered: tuple[str, ...] = ()
    event_counts: tuple[int, ...] = ()


def run_system(
    system: System,
    what: str,
    report_progress: Progress,
    engine: EngineName,
    *observers: Observer,
    living: ExitStack,
    events: Sequence[Event | Machine] = (),
    pace: Pace | None = None,
    supervisor: Supervisor | None = None,
    keep: bool = True,
    call_limit: float | None = None,
    series: RunSeries | None = None,
) -> CompletedRun:
    """Run a system from its start to its end, or to where an event stops it.

    Parameters
    ----------
    what, report_progress : name of the run in progress reports, and their receiver.
    living : ends the slaves when it is closed; close it when the run is on disk, since some FMUs
        end the process with them.
    supervisor : executes the run in its child process; None: in this process.
    keep : whether the run keeps its rows.
    call_limit : of one call of an isolated slave in this process [s]; None: no limit.
    series : the run is one of these, in this process; its rows are valid until the next one of
        this name, whatever `keep` says.

    Raises
    ------
    InputError, ComponentError : see `Session`.
    """
    conduct = DriveEvents(events, pace)
    if supervisor is not None:
        watcher = ProgressObserver(system, what, report_progress)
        conducted = supervisor.run(
            system,
            [*observers, watcher],
            conduct,
            living=living,
            engine=engine,
            keep=keep,
        )
        run, found = conducted.run, conducted.found or EventResults()
        if pace is not None and found.pace is not None:
            pace.take(found.pace)
    else:
        with DeferredInterrupt() as interruption:
            watcher = ProgressObserver(system, what, report_progress, interruption)
            watching = [*observers, watcher]
            if series is not None and series.takes(system):
                session = series.open(what, system, watching, engine)
                living.callback(session.release_observers)
            else:
                session = living.enter_context(
                    Session(system, watching, engine=engine, keep=keep, call_limit=call_limit)
                )
            found = conduct(session)
            session.deliver()
            run = session.run_so_far(complete=True, whole=series is None)
    run = ended_by_event(run, found.stopped)
    return CompletedRun(run, found.altered, found.event_counts)
