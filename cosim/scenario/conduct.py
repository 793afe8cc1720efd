"""One run of a system: it says how far it is, keeps to a pace, and can be interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from cosim.core import Progress
from cosim.master import EngineName, Observer, Pace, Run, Session, System
from cosim.scenario.drive import Driver, Rows
from cosim.scenario.interrupt import Interruptible
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event
from cosim.scenario.watch import Watcher


@dataclass(frozen=True)
class Flown:
    """A run, whether events changed more in it than the traffic of links, and how often each."""

    run: Run
    touched: bool = False
    happened: tuple[int, ...] = ()


def conduct(
    system: System,
    what: str,
    tell: Progress,
    engine: EngineName,
    *observers: Observer,
    living: ExitStack,
    events: Sequence[Event] = (),
    pace: Pace | None = None,
) -> Flown:
    """Run a system from its start to its end, or to where an event stops it.

    Parameters
    ----------
    what, tell : what the progress is called, and who is told.
    living : ends the slaves when it is closed, which is for when the run is on disk: some FMUs
        end the process with them.

    Raises
    ------
    InputError, ComponentError : see `Session`.
    """
    with Interruptible() as wish:
        watcher = Watcher(system, what, tell, wish)
        rows = Rows(RunScope(system))
        session = living.enter_context(Session(system, [*observers, watcher, rows], engine=engine))
        driver = Driver(system, events, rows)
        run = driver.drive(session, pace)
        session.hand_on()
        if driver.stopped is not None and run.ending in ("stopped", "finished"):
            run = replace(run, ending="stopped", reason=driver.stopped)
        return Flown(run, driver.touched, tuple(driver.happened))
