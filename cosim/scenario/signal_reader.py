"""Signals of one component at the points of a run, read block by block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class SignalReader:
    """Reads outputs and connected inputs at the points; between own points they keep their values.

    Parameters
    ----------
    instance : the component.
    names : of the signals, elements of arrays included.
    constants : the names in it have these values all the time.

    Attributes
    ----------
    reads_inputs : whether any of the signals is an input.

    Raises
    ------
    InputError : there is no such signal.
    """

    def __init__(
        self,
        instance: ComponentInstance,
        names: Sequence[str],
        constants: dict[str, float] | None = None,
    ) -> None:
        self._instance = instance
        given = constants or {}
        self._constants = [(j, given[name]) for j, name in enumerate(names) if name in given]
        self._places = [j for j, name in enumerate(names) if name not in given]
        found = [instance.place(names[j]) for j in self._places]
        self._columns = np.array([column for column, _ in found], np.intp)
        self._width = len(names)
        self._kept = np.zeros(len(self._places))
        self.reads_inputs = any(column.port.causality == "input" for _, column in found)

    def read(self, first: int, last: int) -> Reals:
        """Return the values at the points first to last - 1, (n, names); blocks come in order."""
        rows = self._instance.rows
        if self._instance.own_points.always:
            values = rows[first:last].take(self._columns, axis=1)
        else:
            own = self._instance.own_points.last[first:last]
            values = rows[np.maximum(own, first)].take(self._columns, axis=1)
            values[own < first] = self._kept
        self._kept = values[-1].copy()
        if not self._constants:
            return values
        found = np.empty((last - first, self._width))
        found[:, self._places] = values
        for j, value in self._constants:
            found[:, j] = value
        return found


def reader_of(instance: ComponentInstance, names: Sequence[str]) -> SignalReader:
    """Return a reader of variables; unconnected inputs, and parameters, are at their start."""
    recorded = {c.name for c in (*instance.output_columns, *instance.input_columns)}
    start_of = instance.component.start_of
    constants = {name: start_of(name, 0.0) for name in names if name not in recorded}
    return SignalReader(instance, names, constants)


class OwnRows:
    """Signals of a component at its own points, each block after the last row of the one before.

    Parameters
    ----------
    groups : names of signals; each group is an array of its own.
    """

    def __init__(self, instance: ComponentInstance, *groups: Sequence[str]) -> None:
        self._instance = instance
        self._reader = reader_of(instance, [name for group in groups for name in group])
        self._edges = np.cumsum([len(group) for group in groups])[:-1]
        self._points: Integers = np.zeros(0, np.int64)
        self._rows: Reals = np.zeros((0, sum(map(len, groups))))

    def read(self, first: int, last: int) -> tuple[Integers, list[Reals]]:
        """Return the own points among first to last - 1 [ns], (n,), and a (n, names) per group.

        Before them stands the last one of the block before, if there was one.
        """
        rows, points = self._reader.read(first, last), self._instance.comm_points.points_ns
        if self._instance.own_points.always:
            points = points[first:last]
        else:
            own = self._instance.own_points.own_between(first, last)
            rows, points = rows[own - first], points[own]
        if self._points.size:
            points = np.concatenate((self._points, points))
            rows = np.concatenate((self._rows, rows))
        self._points, self._rows = points[-1:].copy(), rows[-1:].copy()
        return points, np.split(rows, self._edges, axis=1)


class History:
    """Values by instant, as far back as somebody asks for them."""

    def __init__(self) -> None:
        self.times: NDArray[Any] = np.zeros(0, np.int64)
        self.values: Reals = np.zeros((0, 0))

    def continue_with(self, times: NDArray[Any], values: Reals) -> None:
        """Add a block of `OwnRows`, whose first row is known from the block before."""
        known = min(self.times.size, 1)
        self.add(times[known:], values[known:])

    def add(self, times: NDArray[Any], values: Reals) -> None:
        """Add later instants, ascending."""
        if self.times.size:
            self.times = np.concatenate((self.times, times))
            self.values = np.concatenate((self.values, values))
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
