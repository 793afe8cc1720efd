"""One run of a system: it says how far it is, keeps to a pace, and can be interrupted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim.master import EngineName, Observer, Pace, Run, Session, System
from cosim.scenario.drive import Driver, Rows
from cosim.scenario.interrupt import Interruptible
from cosim.scenario.prepare import Progress
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Event


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
    events: Sequence[Event] = (),
    pace: Pace | None = None,
) -> Flown:
    """Run a system from its start to its end, or to where an event stops it.

    Parameters
    ----------
    what, tell : what the progress is called, and who is told.

    Raises
    ------
    InputError, ComponentError : see `Session`.
    """
    with Interruptible() as wish:
        watcher = _Watcher(system, lambda share: tell(what, share), wish)
        rows = Rows(RunScope(system))
        with Session(system, [*observers, watcher, rows], engine=engine) as session:
            driver = Driver(system, events, rows)
            run = driver.drive(session, pace)
        if driver.stopped is not None and run.ending in ("stopped", "finished"):
            run = replace(run, ending="stopped", reason=driver.stopped)
        return Flown(run, driver.touched, tuple(driver.happened))


class _Watcher(Observer):
    """Reports how far a run has come, and ends it on request."""

    def __init__(self, system: System, tell: Callable[[float], None], wish: Interruptible) -> None:
        self._wish = wish
        self._points = system.timetable.points_ns.size
        self._tell = tell

    def begin(self, stations: Sequence[Any]) -> None:
        del stations
        self._tell(0.0)

    def span(self, first: int, last: int) -> None:
        del first
        self._wish.obey()
        self._tell(last / self._points)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Log lines go to the trace; nothing to do here."""
