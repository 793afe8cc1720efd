"""The timeline of a report: limits, silences, failed assertions, warnings, in order of time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.trace import foxglove
from cosim.trace.report import traffic
from cosim.trace.report.parameters import Settings
from cosim.trace.report.series import WILD, Recording, Series
from cosim.trace.report.verdict import BAD, GOOD, OPEN, Check

LOG_LINES = 40
_LEVELS = {number: word for word, number in foxglove.LEVELS.items()}


@dataclass(frozen=True)
class Line:
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


def log_of(recording: Recording) -> list[Line]:
    """Return the last lines of the log, oldest first."""
    table = recording.log
    if table is None or not {"level", "name", "message"} <= set(table.columns):
        return []
    t = recording.seconds(table.log_time_ns)
    return [
        Line(
            float(t[i]),
            _LEVELS.get(int(table["level"][i]), "unknown"),
            str(table["name"][i]),
            str(table["message"][i]),
        )
        for i in range(len(table))[-LOG_LINES:]
    ]


def timeline_of(
    recording: Recording,
    settings: Settings,
    links: Sequence[traffic.LinkFigures],
    log: Sequence[Line],
    assertions: Sequence[Check],
    metrics: Mapping[str, Any],
) -> list[TimelineEntry]:
    """List limits reached, silences, values that are not finite, failed assertions and warnings."""
    moments = [*_limits(recording, settings), *_beyond_numbers(recording)]
    moments += [TimelineEntry(t, OPEN, what) for link in links for t, what in traffic.moments(link)]
    moments += [
        TimelineEntry(check.at, BAD, f"{check.what}: {check.why}")
        for check in assertions
        if check.tone == BAD and check.at is not None
    ]
    moments += [
        TimelineEntry(line.t, BAD if line.level in {"error", "fatal"} else OPEN, _log_text(line))
        for line in log
        if line.level not in {"info", "debug"}
    ]
    designed = metrics.get("designed_age_s")
    if isinstance(designed, int | float):
        moments += _too_old(recording, links, float(designed))
    return sorted(moments, key=lambda m: (m.t, m.tone != GOOD, m.what))


def _log_text(line: Line) -> str:
    return f"{line.name}: {line.message}" if line.name else line.message


def _limits(recording: Recording, settings: Settings) -> Iterator[TimelineEntry]:
    """Yield when each command first stood at its limit."""
    for series in _outputs(recording):
        bound = settings.limit(series.component, series.name)
        if bound is None:
            continue
        at_limit = np.flatnonzero(np.abs(series.values) >= bound * (1 - 1e-12))
        if at_limit.size:
            amount = f"{bound:g} {series.unit or ''}".strip()
            what = f"{series.full_name} is at its limit of {amount}"
            yield TimelineEntry(float(series.t[at_limit[0]]), BAD, what)


def _beyond_numbers(recording: Recording) -> Iterator[TimelineEntry]:
    """Yield when an output was first not finite, or beyond 1e12."""
    for series in _outputs(recording):
        wild = np.flatnonzero(~np.isfinite(series.values) | (np.abs(series.values) > WILD))
        if wild.size:
            what = f"{series.full_name} is {series.values[wild[0]]:.3g}"
            yield TimelineEntry(float(series.t[wild[0]]), BAD, what)


def _outputs(recording: Recording) -> list[Series]:
    return [series for series in recording.series if series.direction == "output"]


def _too_old(
    recording: Recording, links: Sequence[traffic.LinkFigures], designed: float
) -> Iterator[TimelineEntry]:
    """Yield when the message of a single link was first older than the loop was designed for."""
    for link in links:
        if designed <= 0 or link.largest_age_s is None or link.largest_age_s <= designed:
            continue
        since = recording.links[link.name].too_old_ns
        if since is not None:
            what = f"{link.name}: its message in use is older than the {designed:g} s designed for"
            yield TimelineEntry(float(recording.seconds(np.array(since))), BAD, what)
