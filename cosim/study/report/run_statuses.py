"""How the runs of a study ended, and why: counts with shares, and causes with an example each."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from cosim.study.batch import INCOMPLETE
from cosim.study.columns import StudyColumns
from cosim.study.summary import Share, share

FINISHED = "finished"
_MOST_CAUSES = 15
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


@dataclass(frozen=True)
class StatusCount:
    """How many runs have a status; `tone` is "good", "open" or "bad" (a run without a result)."""

    status: str
    tone: str
    found: Share


@dataclass(frozen=True)
class RunCause:
    """A reason that runs have in common, but for the numbers in it; `run` is the first of them."""

    status: str
    tone: str
    reason: str
    count: int
    run: int


def status_counts(columns: StudyColumns, confidence: float) -> list[StatusCount]:
    """Return the number of runs per status, finished ones first, then the most frequent."""
    counts = Counter(columns.statuses)
    order = sorted(counts, key=lambda status: (status != FINISHED, -counts[status], status))
    total = len(columns.statuses)
    return [
        StatusCount(status, tone_of(status), share(counts[status], total, confidence))
        for status in order
    ]


def run_causes(columns: StudyColumns) -> tuple[list[RunCause], int]:
    """Return the most frequent reasons, and how many others there are."""
    found: dict[tuple[str, str], list[int]] = {}
    for place, (status, reason) in enumerate(zip(columns.statuses, columns.reasons, strict=True)):
        if reason:
            alike = _NUMBER.sub("#", reason.splitlines()[0])
            found.setdefault((status, alike), []).append(place)
    ranked = sorted(found.items(), key=lambda item: (-len(item[1]), item[1][0]))
    return list(_causes(columns, ranked[:_MOST_CAUSES])), max(len(ranked) - _MOST_CAUSES, 0)


def _causes(
    columns: StudyColumns, ranked: list[tuple[tuple[str, str], list[int]]]
) -> Iterator[RunCause]:
    for (status, _), places in ranked:
        first = places[0]
        reason = (columns.reasons[first] or "").strip()
        run = int(columns.runs[first])
        yield RunCause(status, tone_of(status), reason, len(places), run)


def tone_of(status: str) -> str:
    """Return "good" for a finished run, "bad" for one without a result, "open" for any other."""
    if status == FINISHED:
        return "good"
    return "bad" if status in INCOMPLETE else "open"
