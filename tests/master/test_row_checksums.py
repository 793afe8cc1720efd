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
from cosim.master.supervision.taken_rows import TakenRows


class _Memory:
    """Rows that another process writes, and a spare one."""

    def __init__(self, seed: int, rows: int, columns: int) -> None:
        self.array = np.random.default_rng(seed).standard_normal((rows + 1, columns))

    def give_back(self, before: int) -> None:
        """Forget rows."""
        self.array[:before] = 0.0


def test_a_row_is_looked_at_before_the_next_is_taken() -> None:
    """What is written everywhere while row 2 is made is in rows 0 and 1, too."""
    memory = _Memory(1, 4, 3)
    taken = TakenRows(memory, 3)
    taken.check(2, sum_of_rows(memory.array, 3, 0, 2))
    memory.array[:3] = 123.456
    with pytest.raises(ComponentError, match="changed by a component"):
        taken.check(3, None)


def test_what_is_checked_is_read_however_the_memory_of_both_changes() -> None:
    """A row that is altered behind its check is as it was here, and is noticed at the end."""
    memory = _Memory(4, 4, 3)
    before = memory.array.copy()
    taken = TakenRows(memory, 3)
    taken.check(2, sum_of_rows(memory.array, 3, 0, 2))
    memory.array[0, 1] = 123.456
    taken.check(3, sum_of_rows(before, 3, 0, 3))
    assert np.array_equal(taken.array[:3], before[:3])
    taken.compare(0)
    with pytest.raises(ComponentError, match="rows 0 to 2"):
        taken.compare()
    with pytest.raises(ComponentError, match="rows 0 to 1"):
        taken.give_back(2)


def test_a_row_that_is_altered_before_it_is_taken_is_noticed() -> None:
    """Its sum is that of the row when it was complete."""
    memory = _Memory(5, 4, 3)
    whole = sum_of_rows(memory.array, 3, 0, 3)
    memory.array[1, 0] = 123.456
    taken = TakenRows(memory, 3)
    with pytest.raises(ComponentError, match="rows 0 to 2"):
        taken.check(3, whole)


def test_rows_that_are_given_back_are_not_compared_again() -> None:
    """They are gone in the memory of both."""
    memory = _Memory(6, 4, 3)
    taken = TakenRows(memory, 3)
    taken.check(3, sum_of_rows(memory.array, 3, 0, 3))
    taken.give_back(2)
    taken.compare()
    assert not memory.array[:2].any()


def test_a_last_row_that_is_right_is_taken() -> None:
    """One row at a time, two at once, and again after all are forgotten."""
    memory = _Memory(2, 5, 2)
    taken = TakenRows(memory, 2)
    for complete in (1, 2, 4, 4):
        taken.check(complete, sum_of_rows(memory.array, 2, 0, complete))
    taken.forget()
    memory.array[0] = 1.0
    taken.check(1, sum_of_rows(memory.array, 2, 0, 1))
    taken.compare()
    assert (taken.array[0] == 1.0).all()


def test_a_row_that_is_copied_before_it_is_complete_is_taken_as_it_became() -> None:
    """A session's result has values at its time, which the next step may change."""
    memory = _Memory(7, 3, 2)
    taken = TakenRows(memory, 2)
    taken.check(1, sum_of_rows(memory.array, 2, 0, 1))
    taken.show(2)
    assert np.array_equal(taken.array[1], memory.array[1])
    memory.array[1] = 2.0
    taken.check(2, sum_of_rows(memory.array, 2, 0, 2))
    assert (taken.array[1] == 2.0).all()


def test_the_last_row_of_all_agrees() -> None:
    """There is no row after it; a row that is complete while its number is not yet told agrees."""
    memory = _Memory(3, 3, 2)
    taken, rows = TakenRows(memory, 2), memory.array
    assert taken.agree(3, sum_of_rows(rows, 2, 0, 3))
    assert taken.agree(1, sum_of_rows(rows, 2, 0, 2))
    assert not taken.agree(3, sum_of_rows(rows, 2, 0, 2))


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
