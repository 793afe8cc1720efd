"""Signals of one component at the points of a run, read block by block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class Block(NamedTuple):
    """The points first to last - 1 of a run, of which those from `new` on are new: at least one.

    `first` is the last point of the block before; in the first block it is `new`.
    """

    first: int
    new: int
    last: int


class SignalReader:
    """Reads signals at the points; between own points they keep their values.

    Parameters
    ----------
    instance : the component.
    names : of the signals, elements of arrays included. Unconnected inputs, and parameters, are at
        their start.
    recorded : all of them must be outputs or connected inputs.

    Attributes
    ----------
    reads_inputs : whether any of the signals is an input.

    Raises
    ------
    InputError : there is no such signal.
    """

    def __init__(
        self, instance: ComponentInstance, names: Sequence[str], *, recorded: bool = False
    ) -> None:
        self._instance = instance
        columns = {c.name for c in (*instance.output_columns, *instance.input_columns)}
        read = [recorded or name in columns for name in names]
        start_of = instance.component.start_of
        values = [0.0 if there else start_of(n, 0.0) for n, there in zip(names, read, strict=True)]
        self._constants = None if all(read) else np.array(values, np.float64)
        self._places = np.flatnonzero(read)
        places = [instance.place(names[j]) for j in self._places.tolist()]
        self._columns = np.array([column for column, _ in places], np.intp)
        self.reads_inputs = any(column.port.causality == "input" for _, column in places)

    def read(self, block: Block) -> Reals:
        """Return the values at the points of a block, (n, names)."""
        own, points = self._instance.own_points, slice(block.first, block.last)
        return self._values(points if own.always else own.last[points])

    def at_own(self, block: Block) -> tuple[Integers, Reals]:
        """Return the own points of a block, after the last one before [ns], and the values."""
        always = self._instance.own_points.always
        rows = slice(block.first, block.last) if always else own_points(self._instance, block)
        return self._instance.comm_points.points_ns[rows], self._values(rows)

    def _values(self, rows: slice | Integers) -> Reals:
        values = self._instance.rows[rows].take(self._columns, axis=1)
        if self._constants is None:
            return values
        every = np.tile(self._constants, (len(values), 1))
        every[:, self._places] = values
        return every


def own_points(instance: ComponentInstance, block: Block) -> Integers:
    """Return a component's own points in a block, after the last one before, int64 (n,)."""
    own = instance.own_points
    return own.own_between(int(own.last[block.first]), block.last)


class History:
    """Values by instant, as far back as somebody asks for them."""

    def __init__(self) -> None:
        self.times: NDArray[Any] = np.zeros(0, np.int64)
        self.values: Reals = np.zeros((0, 0))

    def add(self, times: NDArray[Any], values: Reals) -> None:
        """Add instants, ascending, of which the first is known already."""
        if self.times.size:
            self.times = np.concatenate((self.times, times[1:]))
            self.values = np.concatenate((self.values, values[1:]))
        else:  # the memory of a run's points is given back
            self.times, self.values = times.copy(), values.copy()

    def at(self, instants: NDArray[Any]) -> tuple[Reals, NDArray[np.bool_]]:
        """Return the values at instants, and which of these lie between two that are known.

        There values are on a line; before the first instant they are constant.
        """
        last = self.times.size - 1
        place = np.clip(np.searchsorted(self.times, instants, side="right") - 1, 0, last)
        found, between = self.values[place], self.times[place] != instants
        if between.any():
            after = np.minimum(place + 1, last)
            span = np.where(after > place, self.times[after] - self.times[place], 1)
            share = np.clip((instants - self.times[place]) / span, 0.0, 1.0)
            moved = found + share[:, None] * (self.values[after] - found)
            found = np.where(between[:, None], moved, found)
        return found, between

    def forget(self, before: Any) -> None:
        """Forget what is not needed for any instant from this one on."""
        kept = int(np.searchsorted(self.times, before, side="right")) - 2
        kept = min(kept, self.times.size - 1)
        if kept > 0:
            self.times, self.values = self.times[kept:].copy(), self.values[kept:].copy()
