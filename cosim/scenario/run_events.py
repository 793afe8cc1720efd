"""Collect the events of a run while its rows come about: for its log, and counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.trace.outcome import EventCount, EventKind, RunEvent

Integers = NDArray[np.int64]

MOST_LINES = 400
"""Most lines in the log of one kind of event of one subject; further ones are counted only."""


class EventCollector:
    """Collects events: each for the log, and how often each happened.

    start_ns : time of the components at the beginning of the run [ns].
    """

    def __init__(self, start_ns: int = 0) -> None:
        self._start_ns = start_ns
        self._pending: list[RunEvent] = []
        self._episodes: list[Episodes] = []
        self._counts: dict[tuple[str, str], EventCount] = {}
        self._totals_ns: dict[tuple[str, str], int] = {}

    def episodes(
        self, kind: EventKind, subject: str, begins: str, ends: str, level: str = "warning"
    ) -> Episodes:
        """Return what makes events of the stretches of the run in which something is the case.

        begins, ends : what the lines say when one begins, and when it is over.
        """
        self._episodes.append(Episodes(self, RunEvent(0, level, kind, subject, begins), ends))
        return self._episodes[-1]

    def close(self, end_ns: int) -> None:
        """Count the episodes that still last at the end of the run."""
        for each in self._episodes:
            each.close(end_ns)

    def begun(self, event: RunEvent) -> None:
        """Take an event that happens, or begins, at its instant."""
        count = self.count(event)
        if count == MOST_LINES:
            event = replace(event, message=f"{event.message}; from now on this is counted only")
        if count <= MOST_LINES:
            self._pending.append(event)

    def ended(self, event: RunEvent, lasted_ns: int, *, line: bool = True) -> None:
        """Take the end of what has lasted so long; `line` : whether it is a line of the log."""
        key = event.kind, event.subject
        self._totals_ns[key] = self._totals_ns.get(key, 0) + lasted_ns
        if line and self._counts[key].count <= MOST_LINES:
            self._pending.append(event)

    def count(self, event: RunEvent) -> int:
        """Count an event whose line is in the log already; return how often it has happened."""
        key = event.kind, event.subject
        known = self._counts.get(key)
        if known is None:
            what = event.kind, event.subject, event.level, event.message
            known = EventCount(*what, count=0, first_s=(event.time_ns + self._start_ns) / 1e9)
        self._counts[key] = replace(known, count=known.count + 1)
        return known.count + 1

    def take(self, until_ns: int) -> list[RunEvent]:
        """Return the events up to an instant [ns] that were not returned before, in order."""
        taken = [event for event in self._pending if event.time_ns <= until_ns]
        self._pending = [event for event in self._pending if event.time_ns > until_ns]
        return sorted(taken, key=lambda event: event.time_ns)

    def counts(self) -> tuple[EventCount, ...]:
        """Return what happened, how often and how long, by when it first did, then by kind."""
        found = []
        for key, count in self._counts.items():
            total_ns = self._totals_ns.get(key)
            found.append(replace(count, total_s=None if total_ns is None else total_ns / 1e9))
        return tuple(sorted(found, key=lambda each: (each.first_s, each.kind, each.subject)))


class Episodes:
    """Makes events of the stretches of a run in which something is the case.

    Parameters
    ----------
    begins : an event like those to be made, at any instant.
    ends : what the line says when it is over.
    """

    def __init__(self, collector: EventCollector, begins: RunEvent, ends: str) -> None:
        self._collector, self._begins, self._ends = collector, begins, ends
        self._since: int | None = None

    def add(self, points_ns: Integers, there: NDArray[np.bool_]) -> None:
        """Take the next points of the run [ns], and whether it is the case there."""
        before = np.concatenate(([self._since is not None], there[:-1]))
        for k in np.flatnonzero(there != before).tolist():
            self._change(int(points_ns[k]))

    def close(self, end_ns: int) -> None:
        """Count what still lasts at the end of the run."""
        if self._since is not None:
            event = replace(self._begins, time_ns=end_ns)
            self._collector.ended(event, end_ns - self._since, line=False)
            self._since = None

    def _change(self, time_ns: int) -> None:
        if self._since is None:
            self._since = time_ns
            self._collector.begun(replace(self._begins, time_ns=time_ns))
            return
        over = replace(self._begins, time_ns=time_ns, level="info", message=self._ends)
        self._collector.ended(over, time_ns - self._since)
        self._since = None
