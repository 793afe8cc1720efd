"""How far a run has come, and its end on request."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.core import Progress
from cosim.master import Observer, System
from cosim.scenario.interrupt import DeferredInterrupt


class ProgressObserver(Observer):
    """An observer that tells how far a run is, and ends it on Ctrl-C between two steps."""

    def __init__(
        self,
        system: System,
        what: str,
        report_progress: Progress | None,
        interruption: DeferredInterrupt,
    ) -> None:
        self._points = system.comm_schedule.points_ns.size
        self._what, self._report_progress, self._interruption = what, report_progress, interruption

    def begin(self, instances: Sequence[Any]) -> None:
        """Nothing has been done yet."""
        del instances
        self.rows_complete(0, 0)

    def rows_complete(self, first: int, last: int) -> None:
        """Rows up to `last` are done."""
        del first
        self._interruption.raise_if_requested()
        if self._report_progress is not None:
            self._report_progress(self._what, last / self._points)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Log lines go to the trace; nothing to do here."""
