"""Hand each complete row of a run to a function, while the run goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.core import InputError, is_inside
from cosim.master import ComponentInstance, Observer

_Place = tuple[ComponentInstance, int]
"""A component, and the number of an output of it."""


class Row:
    """The values at one communication point: `row["plant.x[1]"]`, `row["plant.x"]`, `row.t`.

    It holds while the function is called that got it; what is to be kept is taken out.

    Attributes
    ----------
    t : time [s].
    """

    def __init__(self, t: float, number: int, outputs: Mapping[str, _Place]) -> None:
        self.t = t
        self._number, self._outputs = number, outputs

    def __repr__(self) -> str:
        return f"<Row t = {self.t:g} s: {len(self._outputs)} outputs>"

    def __getitem__(self, name: str) -> Any:
        """Return the value of an output, or of a group of them an array of doubles, (outputs,)."""
        if name in self._outputs:
            return self._value(self._outputs[name])
        inside = [place for known, place in self._outputs.items() if is_inside(known, name)]
        if not inside:
            raise InputError.unknown("output", name, self._outputs, where="row")
        return np.array([self._value(place) for place in inside])

    def __iter__(self) -> Iterator[str]:
        return iter(self._outputs)

    def _value(self, place: _Place) -> float:
        instance, column = place
        own = instance.own_points
        number = self._number if own.always else own.last[self._number]
        return float(instance.outputs[number, column])


class RowObserver(Observer):
    """Calls a function with each row of a run, in order.

    on_row : takes a `Row`; what it raises ends the run.
    """

    reads_inputs = False

    def __init__(self, on_row: Callable[[Row], object]) -> None:
        self._on_row = on_row

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the places of the outputs."""
        self._points = instances[0].comm_points
        self._outputs: dict[str, _Place] = {
            f"{instance.name}.{column.name}": (instance, k)
            for instance in instances
            for k, column in enumerate(instance.output_columns)
        }

    def rows_complete(self, first: int, last: int) -> None:
        """Call the function with each row."""
        times = self._points.points_ns[first:last]
        for number, time_ns in enumerate(times.tolist(), first):
            self._on_row(Row(self._points.at_s(time_ns), number, self._outputs))

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Leave lines of the log to others."""
