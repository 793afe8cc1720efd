"""One run of a system: it says how far it is, keeps to a pace, and can be interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from cosim.core import Progress
from cosim.master import EngineName, Observer, Pace, Run, Session, System
from cosim.scenario.event_driver import EventDriver, LatestValues
from cosim.scenario.interrupt import DeferredInterrupt
from cosim.scenario.progress_observer import ProgressObserver
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event


@dataclass(frozen=True)
class CompletedRun:
    """A run, whether events changed more in it than the traffic of links, and how often each."""

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
    what, report_progress : what the progress is called, and who is told.
    living : ends the slaves when it is closed, which is for when the run is on disk: some FMUs
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
