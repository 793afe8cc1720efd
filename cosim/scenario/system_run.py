"""Run a system once, with events, progress reports and interruption."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from cosim.core import Progress
from cosim.master import EngineName, Observer, Pace, Run, Session, System
from cosim.scenario.event_driver import EventDriver, LatestValues
from cosim.scenario.interrupt import DeferredInterrupt
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event


class ProgressObserver(Observer):
    """Reports the progress of a run, and ends it on Ctrl-C between two steps."""

    reads_inputs = False

    def __init__(
        self, system: System, what: str, report_progress: Progress, interruption: DeferredInterrupt
    ) -> None:
        self._points = system.comm_schedule.points_ns.size
        self._what, self._report_progress, self._interruption = what, report_progress, interruption

    def begin(self, instances: object) -> None:
        """Report the start."""
        del instances
        self.rows_complete(0, 0)

    def rows_complete(self, first: int, last: int) -> None:
        """Report that rows up to `last` are done."""
        del first
        self._interruption.raise_if_requested()
        self._report_progress(self._what, last / self._points)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Do nothing: log lines go to the trace."""


@dataclass(frozen=True)
class CompletedRun:
    """A run, whether events changed more than the traffic of links, and how often each happened."""

    run: Run
    altered_by_events: bool = False
    event_counts: tuple[int, ...] = ()


def run_system(
    system: System,
    what: str,
    report_progress: Progress,
    engine: EngineName,
    *observers: Observer,
    living: ExitStack,
    events: Sequence[Event] = (),
    pace: Pace | None = None,
) -> CompletedRun:
    """Run a system from its start to its end, or to where an event stops it.

    Parameters
    ----------
    what, report_progress : name of the run in progress reports, and their receiver.
    living : ends the slaves when it is closed; close it when the run is on disk, since some FMUs
        end the process with them.

    Raises
    ------
    InputError, ComponentError : see `Session`.
    """
    with DeferredInterrupt() as interruption:
        watcher = ProgressObserver(system, what, report_progress, interruption)
        rows = LatestValues(RunScope(system))
        session = living.enter_context(Session(system, [*observers, watcher, rows], engine=engine))
        driver = EventDriver(system, events, rows)
        run = driver.drive(session, pace)
        session.deliver()
        if driver.stopped is not None and run.status in ("stopped", "finished"):
            run = replace(run, status="stopped", reason=driver.stopped)
        return CompletedRun(run, driver.altered_by_events, tuple(driver.event_counts))
