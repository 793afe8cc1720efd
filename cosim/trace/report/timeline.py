"""The timeline of a report: what happened during the run, in order of time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.trace.outcome.run_events import counted
from cosim.trace.outcome.run_outcome import BAD, OPEN, RunOutcome
from cosim.trace.report.series import WILD, Recording
from cosim.trace.rows import foxglove

_LEVELS = {number: word for word, number in foxglove.LEVELS.items()}


@dataclass(frozen=True)
class LogLine:
    """A line of the log."""

    t: float
    level: str
    name: str
    message: str


@dataclass(frozen=True)
class TimelineEntry:
    """An entry of the timeline, at a time [s]."""

    t: float
    tone: str
    what: str


def log_of(recording: Recording) -> list[LogLine]:
    """Return the lines of the log, oldest first."""
    table = recording.log
    if table is None or not {"level", "name", "message"} <= set(table.columns):
        return []
    t = recording.seconds(table.log_time_ns)
    return [
        LogLine(
            float(t[i]),
            _LEVELS.get(int(table["level"][i]), "unknown"),
            str(table["name"][i]),
            str(table["message"][i]),
        )
        for i in range(len(table))
    ]


def timeline_of(
    recording: Recording, outcome: RunOutcome, log: Sequence[LogLine]
) -> list[TimelineEntry]:
    """List the events of the run, and values that are not finite.

    What the reason of the run says, and assertions, which have a list of their own, are left out.
    Of a run that left no events, the warnings and errors of its log.
    """
    reason = outcome.reason or ""
    events = outcome.events or counted((x.t, x.level, x.name, x.message) for x in log)
    entries = [
        TimelineEntry(each.first_s, BAD if each.serious else OPEN, each.words)
        for each in events
        if each.kind != "assertion" and each.message not in reason
    ]
    entries += [entry for entry in _beyond_numbers(recording) if entry.what not in reason]
    return sorted(entries, key=lambda entry: entry.t)


def _beyond_numbers(recording: Recording) -> Iterator[TimelineEntry]:
    """Yield when an output was first not finite, or beyond 1e12."""
    for series in recording.series:
        wild = np.flatnonzero(~np.isfinite(series.values) | (np.abs(series.values) > WILD))
        if wild.size and series.direction == "output":
            what = f"{series.full_name} is {series.values[wild[0]]:.3g}"
            yield TimelineEntry(float(series.t[wild[0]]), BAD, what)
