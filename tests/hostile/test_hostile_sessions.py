"""The table through sessions: the failure is raised, again by every later call, nothing is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile import eventful
from hostile.expected import RUN_CALLS, Row, rows
from hostile.judged import departures
from hostile.runs import run_row
from shared import sampled, share_of

SAMPLE = (
    Row("garbage", "get", "3.0"),  # written over what the child tells of itself, too
    Row("hang-deaf", "terminate", "3.0"),
    Row("segfault", "step", "2.0"),
    Row("exit-0", "free", "3.0"),
)


@pytest.mark.parametrize("row", sampled(SAMPLE, 2), ids=lambda row: row.name)
def test_fault_is_raised_and_nothing_is_lost_or_left(tmp_path: Path, row: Row) -> None:
    """A few rows of the table."""
    assert departures(run_row(row, tmp_path, door=0)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "row", share_of([r for r in rows() if r.call in RUN_CALLS][::5]), ids=lambda row: row.name
)
def test_every_fifth_row_point_by_point(tmp_path: Path, row: Row) -> None:
    """As to the end at once, which `python -m tests.hostile.table` tries."""
    if row.fault == "leak-slowly":
        pytest.skip("the limit of memory is met in any call of the session")
    assert departures(run_row(row, tmp_path, door=1)) == []


@pytest.mark.slow
@pytest.mark.parametrize("row", share_of([*eventful.rows()][::3]), ids=lambda row: row.name)
def test_every_third_row_of_events(tmp_path: Path, row: eventful.Row) -> None:
    """Of event mode, Clocks and C++."""
    assert eventful.departures(eventful.run_row(row, tmp_path, door=0)) == []
