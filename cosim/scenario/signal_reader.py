"""Signals of one component at the points of a run, read block by block."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance

Reals = NDArray[np.float64]


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
        rows, own = self._instance.rows, self._instance.own_points.last[first:last]
        if np.array_equal(own, np.arange(first, last)):
            values = rows[first:last].take(self._columns, axis=1)
        else:
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
