"""Overrides and biases of values on their way: what a session or an event changes in rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cosim.master.component_instance import Rows


class Adjustment(NamedTuple):
    """factor * value + offset in place of a value; factor 0: offset, whatever the value."""

    factor: float
    offset: float

    def of(self, value: float) -> float:
        """Return the adjusted value."""
        return self.offset if self.factor == 0.0 else self.factor * value + self.offset


class Adjustments:
    """The adjustments of a run by column of its rows; both loops read the arrays as they are.

    Attributes
    ----------
    active : whether a column is adjusted, uint8 (values,).
    factor, offset : of each column, (values,).
    count : number of adjusted columns, int64 (1,).
    """

    def __init__(self, values: int) -> None:
        self.active = np.zeros(values, np.uint8)
        self.factor, self.offset = np.ones(values), np.zeros(values)
        self.count = np.zeros(1, np.int64)

    def set(self, column: int, adjustment: Adjustment) -> None:
        """Adjust a column from now on."""
        self.factor[column], self.offset[column] = adjustment
        self.count[0] += not self.active[column]
        self.active[column] = 1

    def release(self, column: int) -> None:
        """Adjust a column no more."""
        self.count[0] -= int(self.active[column])
        self.active[column] = 0

    def all(self) -> dict[int, Adjustment]:
        """Return the adjustments by column."""
        return {
            column: Adjustment(float(self.factor[column]), float(self.offset[column]))
            for column in np.flatnonzero(self.active).tolist()
        }

    def restore(self, adjustments: Mapping[int, Adjustment]) -> None:
        """Replace all adjustments by these."""
        self.active[:] = 0
        self.count[0] = 0
        for column, adjustment in adjustments.items():
            self.set(column, adjustment)

    def apply(self, row: Rows, first: int, count: int) -> None:
        """Adjust the values of a row in columns first to first + count - 1."""
        for column in range(first, first + count):
            if self.active[column]:
                by = Adjustment(float(self.factor[column]), float(self.offset[column]))
                row[column] = by.of(float(row[column]))
