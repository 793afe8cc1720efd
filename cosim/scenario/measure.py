"""Measures: quantities of a run that are computed while its rows come about.

A measure is one function, a fold over the run: what stands before its loop finds what it reads,
each turn of the loop takes a block of rows, and what stands after it is the result.

    @measure
    def longest_step(run: MeasuredRun) -> Fold[int]:
        longest = 0
        while block := (yield):
            longest = max(longest, int(np.diff(run.points_ns(block)).max(initial=0)))
        return longest

A block begins with the last point of the block before, so that its intervals are whole, and the
last own point of every component before it is still readable: a measure keeps sums, not rows. So
its result does not depend on where one block ends and the next begins; sums are made in order,
point by point. A whole run that has kept its rows is one block (`measured`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from functools import wraps
from typing import (
    Any,
    Concatenate,
    Generic,
    ParamSpec,
    TypeAlias,
    TypeVar,
    TypeVarTuple,
)

import numpy as np
from numpy.typing import NDArray

from cosim.master import Component, ComponentInstance, Observer, Run
from cosim.scenario.signal_reader import Block, SignalReader

P = ParamSpec("P")
R = TypeVar("R")
Ts = TypeVarTuple("Ts")
D = TypeVar("D", np.int64, np.float64)
Integers = NDArray[np.int64]

ROWS_AT_ONCE = 8192
"""Most rows in a block: enough to be fast, few enough to stay in the cache."""


Fold: TypeAlias = Generator[None, Block | None, R]


class MeasuredRun:
    """A run while it goes, for its measures.

    Attributes
    ----------
    instances : by name.
    comm_points : the points of the run.
    reads_inputs : whether a measure reads inputs in the rows; known when the measures have begun.
    end : the run, after its last block.
    """

    end: Run

    def __init__(self, instances: Sequence[ComponentInstance]) -> None:
        self.instances = {instance.name: instance for instance in instances}
        self.comm_points = instances[0].comm_points
        self.reads_inputs = False
        self._shared: dict[Any, Any] = {}

    def points_ns(self, block: Block) -> Integers:
        """Return a copy of the points of a block [ns]: theirs is given back."""
        return self.comm_points.points_ns[block.first : block.last].copy()

    def reader(
        self, component: str, names: Sequence[str], *, recorded: bool = False
    ) -> SignalReader:
        """Return a reader of signals; unconnected inputs, and parameters, are at their start.

        recorded : all of them must be outputs or connected inputs; an `InputError` for another.
        """
        reader = SignalReader(self.instances[component], names, recorded=recorded)
        self.reads_inputs |= reader.reads_inputs
        return reader

    def shared(self, make: Callable[[MeasuredRun, *Ts], R], *args: *Ts) -> R:
        """Return what is made of the run once for all measures that ask for the same."""
        key = make, *map(id, args)
        if key not in self._shared:  # with its arguments, whose identities others must not have
            self._shared[key] = make(self, *args), args
        made: R = self._shared[key][0]
        return made


class Measure(Generic[R]):
    """One quantity of a run: a fold that has not begun, goes on, or has ended.

    start : begins the fold.
    """

    def __init__(self, start: Callable[[MeasuredRun], Fold[R]]) -> None:
        self._start = start

    def begin(self, run: MeasuredRun) -> None:
        """Begin, before the first block."""
        self._run, self._ended = run, False
        self._fold = self._start(run)
        self.add(None)

    def add(self, block: Block | None) -> None:
        """Take a block, unless the result is known already; None: there are no more."""
        if self._ended:
            return
        try:
            self._fold.send(block)
        except StopIteration as end:
            self._ended, self._result = True, end.value

    def result(self, run: Run) -> R:
        """Return the quantity; all points that the run has reached have been added."""
        self._run.end = run
        self.add(None)
        result: R = self._result
        return result


def measure(fold: Callable[Concatenate[MeasuredRun, P], Fold[R]]) -> Callable[P, Measure[R]]:
    """Make a fold that takes the run first a function that returns a measure of the rest."""

    @wraps(fold)
    def with_arguments(*args: P.args, **given: P.kwargs) -> Measure[R]:
        return Measure(lambda run: fold(run, *args, **given))

    return with_arguments


def measured(run: Run, quantity: Measure[R]) -> R:
    """Return the quantity of a whole run that has kept its rows."""
    quantity.begin(MeasuredRun(run.instances))
    if run.count:
        quantity.add(Block(0, 0, run.count))
    return quantity.result(run)


class Measures(Observer):
    """An observer that passes rows to measures, `ROWS_AT_ONCE` at a time.

    Parameters
    ----------
    at_once : whether to pass each row as soon as it is complete, rather than many together.
    """

    def __init__(self, measures: Sequence[Measure[Any]], *, at_once: bool = False) -> None:
        self._measures = measures
        self._at_once = at_once
        self._run: MeasuredRun | None = None
        self._complete = self._new = 0

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Begin the measures."""
        self._run = MeasuredRun(instances)
        for each in self._measures:
            each.begin(self._run)
        self.reads_inputs = self._run.reads_inputs

    @property
    def unread(self) -> int:
        """The first row that must remain readable, with what routes read from it on.

        The next block's first intervals begin at the own points before it.
        """
        if self._run is None or not self._new:
            return 0
        own = (instance.own_points for instance in self._run.instances.values())
        return min(int(points.last[self._new - 1]) for points in own)

    def rows_complete(self, first: int, last: int) -> None:
        """Take the rows first to last - 1."""
        del first
        self._complete = last
        fewest = 1 if self._at_once else ROWS_AT_ONCE
        while last - self._new >= fewest:
            self._add(min(last, self._new + ROWS_AT_ONCE))

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Do nothing: log lines go to the trace."""

    def complete(self, run: Run) -> None:
        """Pass the last rows to the measures, as soon as the run has ended."""
        if self._run is None:  # its components did not start
            self.begin(run.instances)
        if self._complete > self._new:
            self._add(self._complete)

    def _add(self, last: int) -> None:
        block = Block(max(self._new - 1, 0), self._new, last)
        for each in self._measures:
            each.add(block)
        self._new = last


def sample_period_ns(controller: Component) -> int:
    """Return the time between the sample instants of a controller [ns]; 0: at every point."""
    return round(float(controller.start_of("sample_time", 0.0)) * 1e9)


def samples_in(times: Integers, period_ns: int) -> Integers:
    """Return how many sample instants each step between times contains, without its end, (n - 1,).

    Without a period (0) it is one: each step takes its inputs at its beginning.
    """
    if not period_ns:
        return np.ones(times.size - 1, np.int64)
    return np.diff(-(-times // period_ns))


def hold(before: NDArray[D], values: NDArray[D], comes: NDArray[np.bool_]) -> NDArray[D]:
    """Return values, each held until the next one that comes; `before`, (1, ...), is held first."""
    place = np.maximum.accumulate(np.where(comes, np.arange(1, len(values) + 1), 0))
    return np.concatenate((before, values))[place]
