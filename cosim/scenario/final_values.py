"""The outputs of all components at the last point of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.scenario.measure import Measure


class LastOutputs(Measure[dict[str, dict[str, float]]]):
    """Component -> output -> value at the last point reached; empty without a point."""

    def __init__(self) -> None:
        self._instances: Sequence[ComponentInstance] = ()
        self._rows: dict[str, NDArray[np.float64]] = {}

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Note the components."""
        self._instances = instances

    def add(self, first: int, last: int) -> None:
        """Keep the outputs at the last point of each component."""
        for instance in self._instances:
            row = int(instance.own_points.last[last - 1])
            if row >= first:
                self._rows[instance.name] = instance.outputs[row].copy()

    def result(self, run: Run) -> dict[str, dict[str, float]]:
        """Return the outputs, in the order of the components' instances."""
        del run
        return {
            instance.name: {
                column.name: float(value)
                for column, value in zip(
                    instance.output_columns, self._rows[instance.name], strict=True
                )
            }
            for instance in self._instances
            if instance.name in self._rows
        }
