"""Rows that were complete are noticed when they are changed, before more rows are taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile.expected import Row
from hostile.judged import departures
from hostile.runs import run_row

from cosim.core import ComponentError
from cosim.master.row_sums import sum_of_rows
from cosim.master.supervision.checksums import Checksums


def test_a_row_is_looked_at_before_the_next_is_taken() -> None:
    """What is written everywhere while row 2 is made is in rows 0 and 1, too."""
    rows = np.random.default_rng(1).standard_normal((4, 3))
    sums = Checksums(3)
    sums.add(rows, 2, sum_of_rows(rows, 3, 0, 2))
    rows[:3] = 123.456
    with pytest.raises(ComponentError, match="changed by a component"):
        sums.add(rows, 3, None)


def test_a_last_row_that_is_right_is_taken() -> None:
    """One row at a time, two at once, and again after all are forgotten."""
    rows = np.random.default_rng(2).standard_normal((5, 2))
    sums = Checksums(2)
    for complete in (1, 2, 4, 4):
        sums.add(rows, complete, sum_of_rows(rows, 2, 0, complete))
    sums.forget()
    rows[0] = 1.0
    sums.add(rows, 1, sum_of_rows(rows, 2, 0, 1))
    assert sums.check(rows) == 1


def test_the_last_row_of_all_agrees() -> None:
    """There is no row after it; a row that is complete while its number is not yet told agrees."""
    rows = np.random.default_rng(3).standard_normal((3, 2))
    sums = Checksums(2)
    assert sums.agree(rows, 3, sum_of_rows(rows, 2, 0, 3))
    assert sums.agree(rows, 1, sum_of_rows(rows, 2, 0, 2))
    assert not sums.agree(rows, 3, sum_of_rows(rows, 2, 0, 2))


@pytest.mark.parametrize(
    ("row", "door"),
    [
        (Row("close-all", "set", "3.0"), "run"),
        (Row("intrude", "set", "3.0"), 1),
        (Row("garbage", "exit", "2.0"), "run"),
    ],
    ids=["cut off after the last row", "altered in a session", "written over before the first row"],
)
def test_rows_of_processes_that_do_harm(tmp_path: Path, row: Row, door: Any) -> None:
    """All rows that are complete are kept, none that is altered, and none that there is not."""
    assert departures(run_row(row, tmp_path, door=door)) == []
