"""How far a run has come, and its end on request."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.core import Progress
from cosim.master import Observer, System
from cosim.scenario.interrupt import Interruptible


class Watcher(Observer):
    """An observer that tells how far a run is, and ends it on Ctrl-C between two steps."""

    def __init__(
        self, system: System, what: str, tell: Progress | None, wish: Interruptible
    ) -> None:
        self._points = system.timetable.points_ns.size
        self._what, self._tell, self._wish = what, tell, wish

    def begin(self, stations: Sequence[Any]) -> None:
        """Nothing has been done yet."""
        del stations
        self.span(0, 0)

    def span(self, first: int, last: int) -> None:
        """Rows up to `last` are done."""
        del first
        self._wish.obey()
        if self._tell is not None:
            self._tell(self._what, last / self._points)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Log lines go to the trace; nothing to do here."""
