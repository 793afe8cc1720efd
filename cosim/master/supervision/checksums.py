"""Whether complete rows are still what they were: the process of foreign code can write to them.

The child tells the sum of the rows with their number, as the loop has found it when each row was
complete. The parent compares it before it delivers the rows, and looks at each block again before
it is read for the last time. It looks at the last row of all before it takes others: what foreign
code writes everywhere is in those that are not complete yet, too.
"""

from __future__ import annotations

from collections import deque

from cosim.core import ComponentError
from cosim.master.component_instance import Rows
from cosim.master.row_sums import signed, sum_of_rows


class Checksums:
    """The sums of complete rows, in blocks; `outputs` : number of columns that count."""

    def __init__(self, outputs: int) -> None:
        self._outputs, self._complete, self._total = outputs, 0, 0
        self._blocks: deque[tuple[int, int, int]] = deque()
        self._last = 0

    def add(self, rows: Rows, complete: int, row_sum: int | None) -> None:
        """Add the rows that have become complete; `row_sum` : the sum of all rows, if it is known.

        Raises
        ------
        ComponentError : they are not what they were.
        """
        if self._complete and self._last_of(rows) != self._last:
            raise _altered(self._complete - 1, self._complete)
        first, found = self._complete, self._sum(rows, self._complete, complete)
        if row_sum is not None and signed(self._total + found) != row_sum:
            raise _altered(first, complete)
        if complete > first:
            self._blocks.append((first, complete, found))
            self._complete, self._total = complete, self._total + found
            self._last = self._last_of(rows)

    def agree(self, rows: Rows, complete: int, row_sum: int) -> bool:
        """Return whether so many rows, or one more, have this sum: a call ends between the two."""
        return any(
            signed(self._total + self._sum(rows, self._complete, last)) == row_sum
            for last in (complete, min(complete + 1, len(rows)))
        )

    def forget(self) -> None:
        """Forget all rows: those that are kept are added again, others are computed anew."""
        self._blocks.clear()
        self._complete = self._total = 0

    def check(self, rows: Rows, before: int | None = None) -> int:
        """Check the blocks of rows before this one (None: all), which are not checked again.

        Return the first row that is not checked.

        Raises
        ------
        ComponentError : a row has changed since it was complete.
        """
        while self._blocks and (before is None or self._blocks[0][1] <= before):
            first, last, found = self._blocks.popleft()
            if self._sum(rows, first, last) != found:
                raise _altered(first, last)
        return self._blocks[0][0] if self._blocks else self._complete

    def _last_of(self, rows: Rows) -> int:
        """Return the sum of the last complete row."""
        return self._sum(rows, self._complete - 1, self._complete)

    def _sum(self, rows: Rows, first: int, last: int) -> int:
        return sum_of_rows(rows, self._outputs, first, last)


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
