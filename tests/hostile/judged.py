"""Compares what a run with a hostile FMU left with what it must leave."""

from __future__ import annotations

import re

from hostile.expected import HANGS, RUN_CALLS, Expectation, Row, expectation
from hostile.runs import CALL_LIMIT_S, STEPS, Found

_MOST_SECONDS = 60.0  # without an end it would be for ever; a busy machine takes its time
"""For a verdict without a hang; a slow machine is no failure."""


def departures(found: Found, expected: Expectation | None = None) -> list[str]:
    """What is not as expected of the row, in words; empty if all is."""
    row = Row(found.fault, found.call, found.version)
    expected = expected or expectation(row)
    wrong = departures_of_command(found, expected)
    if row.call in RUN_CALLS:
        wrong += _of_trace(found, expected.statuses, whole=expected.whole)
    return wrong


def departures_of_command(found: Found, expected: Expectation) -> list[str]:
    """What is not as expected of the command, whatever its trace says."""
    wrong = []
    if found.code not in expected.codes:
        wrong.append(f"exit code {found.code}, expected {' or '.join(map(str, expected.codes))}")
    wrong += [f"{word!r} is not printed" for word in expected.words if not _in(word, found.printed)]
    if "Traceback" in found.printed:
        wrong.append("a traceback is printed")
    limit = _MOST_SECONDS + (CALL_LIMIT_S if found.fault in HANGS else 0.0)
    if found.seconds > limit:
        wrong.append(f"{found.seconds:.0f} s until the verdict, expected {limit:g} s at most")
    wrong += [f"left: {name}" for name in (*found.files_left, *found.processes_left)]
    return wrong


def _in(word: str, printed: str) -> bool:
    return re.search(word, printed, re.IGNORECASE | re.DOTALL) is not None


def _of_trace(found: Found, statuses: tuple[str, ...], *, whole: bool) -> list[str]:
    wrong = list(found.wrong_rows)
    if found.rows_kept is None:
        return [*wrong, "no trace"] if found.rows_run or whole else wrong
    # the row in which the fault happens may be kept, too: its values are known
    if found.fault in ("intrude", "garbage") and not whole:
        pass  # rows that have been altered, or of which the number is lost, are not kept
    elif not found.rows_run <= found.rows_kept <= min(found.rows_run + 1, STEPS + 1):
        wrong.append(f"{found.rows_kept} rows kept, expected {found.rows_run}")
    if whole and found.rows_kept != STEPS + 1:
        wrong.append(f"{found.rows_kept} rows kept, the run has {STEPS + 1}")
    if not found.finished:
        wrong.append("the trace is not finished")
    if found.finished and statuses and found.status not in statuses:
        wrong.append(f"status {found.status}, expected {' or '.join(statuses)}")
    return wrong
