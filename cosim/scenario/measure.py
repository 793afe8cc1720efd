"""Measures: quantities of a run that are computed while its rows come about.

A measure receives the rows block by block and keeps what it needs of earlier blocks, so that its
result does not depend on where one block ends and the next begins: sums are made in order, point
by point. A whole run that has kept its rows is one block (`measured`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.master import Component, ComponentInstance, Observer, Run

R_co = TypeVar("R_co", covariant=True)
D = TypeVar("D", np.int64, np.float64)

ROWS_AT_ONCE = 8192
"""Most rows in a block: enough to be fast, few enough to stay in the cache."""


class Measure(Protocol[R_co]):
    """One quantity of a run.

    Attributes
    ----------
    reads_inputs : whether it reads inputs in the rows, known after `begin`.
    """

    reads_inputs: bool = False

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Called once, before the first block."""

    def add(self, first: int, last: int) -> None:
        """Take the points first to last - 1, at least one; blocks come in order, without gaps."""

    def result(self, run: Run) -> R_co:
        """Return the quantity; all points that the run has reached have been added."""


def measured(run: Run, measure: Measure[R_co]) -> R_co:
    """Return the quantity of a whole run that has kept its rows."""
    measure.begin(run.instances)
    if run.count:
        measure.add(0, run.count)
    return measure.result(run)


class Measures(Observer):
    """An observer that passes rows to measures, `ROWS_AT_ONCE` at a time.

    Parameters
    ----------
    at_once : whether to pass each row as soon as it is complete, rather than many together.

    Attributes
    ----------
    unread : the first row that its measures have not received: it, and what routes read from it
        on, must remain readable.
    """

    def __init__(self, measures: Sequence[Measure[Any]], *, at_once: bool = False) -> None:
        self._measures = measures
        self._at_once = at_once
        self._begun = False
        self._complete = 0
        self.unread = 0

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Begin the measures."""
        self._begun = True
        for measure in self._measures:
            measure.begin(instances)
        self.reads_inputs = any(measure.reads_inputs for measure in self._measures)

    def rows_complete(self, first: int, last: int) -> None:
        """Take the rows first to last - 1."""
        del first
        self._complete = last
        fewest = 1 if self._at_once else ROWS_AT_ONCE
        while last - self.unread >= fewest:
            self._add(min(last, self.unread + ROWS_AT_ONCE))

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Do nothing: log lines go to the trace."""

    def complete(self, run: Run) -> None:
        """Pass the last rows to the measures, as soon as the run has ended."""
        if not self._begun:  # its components did not start
            self.begin(run.instances)
        if self._complete > self.unread:
            self._add(self._complete)

    def _add(self, last: int) -> None:
        for measure in self._measures:
            measure.add(self.unread, last)
        self.unread = last


def after(before: NDArray[D] | None, block: NDArray[D]) -> NDArray[D]:
    """Return a block after the last entry of the one before, (1, ...); None: the first block."""
    if before is None:
        return block
    return np.concatenate((before, block))


def sample_period_ns(controller: Component) -> int:
    """Return the time between the sample instants of a controller [ns]; 0: at every point."""
    return round(float(controller.start_of("sample_time", 0.0)) * 1e9)


class Recent:
    """Values by row, from the oldest row that routes may still read.

    Values are int64; memory is that of these rows and of as many again.
    """

    def __init__(self) -> None:
        self._values = np.zeros(0, np.int64)
        self._first = self._last = 0

    def add(self, values: NDArray[np.int64], instance: ComponentInstance) -> None:
        """Add the values of the next rows; forget rows that no route reads any more."""
        if self._last - self._first + values.size > self._values.size:
            oldest = min(max(instance.comm_points.oldest, self._first), self._last)
            kept = self._values[oldest - self._first : self._last - self._first]
            self._values = np.zeros(2 * (kept.size + values.size), np.int64)
            self._values[: kept.size] = kept
            self._first = oldest
        begin = self._last - self._first
        self._values[begin : begin + values.size] = values
        self._last += values.size

    def __getitem__(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        found: NDArray[np.int64] = self._values[rows - self._first]
        return found
