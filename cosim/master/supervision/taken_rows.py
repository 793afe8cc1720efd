"""The complete rows of a run as the parent has taken them: foreign code cannot write to these.

The child tells the sum of the rows with their number, as the loop has found it when each row was
complete. The parent copies the rows, compares the sum of its copies, and reads nothing else from
then on. Before it takes others it looks whether the last one it has is still the same in the
memory of both: what foreign code writes everywhere is in those that are not complete yet, too.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cosim.core import ComponentError
from cosim.master.component_instance import Rows
from cosim.master.reserved import Reserved
from cosim.master.row_sums import signed, sum_of_rows
from cosim.master.wiring import RowMemory

_AT_ONCE: Final = 4096
"""Rows compared at once."""


class TakenRows:
    """The rows of a run, copied from memory that another process writes.

    Parameters
    ----------
    shared : the memory that the other process writes.
    outputs : number of columns that count.

    Attributes
    ----------
    array : as that of the memory; rows that are not taken are 0.
    """

    def __init__(self, shared: RowMemory, outputs: int) -> None:
        self._shared, self._outputs = shared, outputs
        self._own = Reserved(shared.array.shape, np.float64, large_pages=True)
        self.array: Rows = self._own.array
        self._taken = self._checked = self._compared = self._total = 0

    def take(self, complete: int) -> None:
        """Copy the rows that have become complete."""
        self.show(complete)
        self._taken = max(self._taken, complete)

    def show(self, count: int) -> None:
        """Copy rows up to this one as they are now, complete or not; they are taken later.

        The row after them, too: in turns, an input may be of an output at the end of its step.
        """
        rows = slice(self._taken, count + 1)
        self.array[rows] = self._shared.array[rows]

    def check(self, complete: int, row_sum: int | None) -> None:
        """Check the copies up to this row; `row_sum` : the sum of all rows, if it is known.

        Raises
        ------
        ComponentError : the rows are not what they were when they were complete.
        """
        first = self._checked
        if first and not self._same(first - 1, first):
            raise _altered(first - 1, first)
        self.take(complete)
        total = signed(self._total + self._sum(first, complete))
        if row_sum is not None and total != row_sum:
            raise _altered(first, complete)
        if complete > first:
            self._checked, self._total = complete, total

    def agree(self, complete: int, row_sum: int) -> bool:
        """Return whether so many rows, or one more, have this sum: a call ends between the two."""
        one_more = min(complete + 1, len(self.array) - 1)
        self.show(one_more)
        return any(
            signed(self._total + self._sum(self._checked, last)) == row_sum
            for last in (complete, one_more)
        )

    def forget(self) -> None:
        """Forget all rows: those that are kept are taken again, others are computed anew."""
        self._taken = self._checked = self._compared = self._total = 0

    def compare(self, before: int | None = None) -> None:
        """Compare the rows before this one (None: all) with what the memory of both has now.

        Raises
        ------
        ComponentError : a row has changed since it was complete.
        """
        last = self._checked if before is None else min(before, self._checked)
        for first in range(self._compared, last, _AT_ONCE):
            until = min(first + _AT_ONCE, last)
            if not self._same(first, until):
                raise _altered(first, until)
        self._compared = max(self._compared, last)

    def give_back_shared(self, before: int) -> None:
        """Give back the memory of both of the rows before this one, once compared.

        Raises
        ------
        ComponentError : as `compare`.
        """
        self.compare(before)
        self._shared.give_back(before)

    def give_back(self, before: int) -> None:
        """Give back the memory of the rows before this one, here and there, once compared.

        Raises
        ------
        ComponentError : as `compare`.
        """
        self.give_back_shared(before)
        self._own.give_back(before)

    def _same(self, first: int, last: int) -> bool:
        """Return whether the outputs in these rows are the same bits here and there."""
        here, there = (
            rows[first:last, : self._outputs].view(np.int64)
            for rows in (self.array, self._shared.array)
        )
        return np.array_equal(here, there)

    def _sum(self, first: int, last: int) -> int:
        return sum_of_rows(self.array, self._outputs, first, last)


def _altered(first: int, last: int) -> ComponentError:
    return ComponentError(
        "rows that were complete have been changed by a component",
        where="the run",
        got=f"other values somewhere in rows {first} to {last - 1}",
        hint="a fault of an FMU, which writes to memory that is not its own: a component with "
        "isolate = true cannot reach the rows of others",
        kind="altered",
        detail="rows were changed after they were complete",
    )
