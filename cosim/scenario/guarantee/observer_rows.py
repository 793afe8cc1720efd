"""What a controller with an observer is told, shows and commands: read once for all its laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.measurement_ages import PacketsInUse
from cosim.scenario.performance import elements
from cosim.scenario.signal_reader import OwnRows

if TYPE_CHECKING:
    from cosim.hinf import Result
    from cosim.models import Measurement

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class ObserverBlock(NamedTuple):
    """Rows at the controller's own points, after the last one of the block before.

    Attributes
    ----------
    times : the points [ns], (n,).
    y : the measurements at the inputs, less their trim, (n, values).
    estimate, innovation, command, applied : the outputs of these names, (n, k).
    set_point : of the estimate; no column where the controller has none.
    safe : whether the watchdog holds a safe value, (n,).
    packets : as of `PacketsInUse.add`.
    """

    times: Integers
    y: Reals
    estimate: Reals
    innovation: Reals
    command: Reals
    applied: Reals
    set_point: Reals
    safe: NDArray[np.bool_]
    packets: tuple[Integers, Integers, Integers] | None


class ObserverRows:
    """Reads a controller with an observer block by block; several laws may ask for one block.

    Attributes
    ----------
    y, estimate, innovation, command, applied, set_point : names of the variables.
    stamps : those of the measurements.
    """

    def __init__(self, loop: DesignedLoop, design: Result) -> None:
        n, m = design.system.B.shape
        names = [one.name for one in design.measurements]
        self.y = [name for one in loop.measurements for name in one.inputs]
        self.stamps = [one.stamp for one in loop.measurements]
        self.estimate, self.applied = elements("estimate", n), elements("applied", m)
        self.innovation = [f"innovation.{name}" for name in self.y]
        self.command = list(loop.commands.values())
        self.set_point = elements("reference", n)
        self._packets = PacketsInUse(names)
        self._asked: tuple[int, int] | None = None
        self._instance: ComponentInstance | None = None

    def begin(self, instance: ComponentInstance) -> None:
        """Find the columns; outputs that the controller does not have have none."""
        if self._instance is instance:
            return
        self._instance, self._asked = instance, None
        ports, start_of = instance.component.description.ports, instance.component.start_of
        groups = (
            *(self.estimate, self.innovation, self.command),
            *(self.applied, self.set_point, ["watchdog"]),
        )
        present = ([name for name in group if name in ports] for group in groups)
        self._rows = OwnRows(instance, self.y, *present)
        self._packets.begin(instance)
        self._trims = np.array([start_of(f"trim.{name}", 0.0) for name in self.y], float)

    def read(self, first: int, last: int) -> ObserverBlock:
        """Return the rows at the own points among first to last - 1."""
        if self._asked != (first, last):
            times, (y, *outputs) = self._rows.read(first, last)
            estimate, innovation, command, applied, set_point, watchdog = outputs
            safe = np.asarray((watchdog != 0).any(axis=1))
            self._block = ObserverBlock(
                *(times, y - self._trims, estimate, innovation, command, applied, set_point, safe),
                self._packets.add(first, last),
            )
            self._asked = (first, last)
        return self._block


def columns_of(measurements: Sequence[Measurement]) -> Iterator[tuple[Measurement, slice]]:
    """Yield measurements, each with the columns of its values among those of all."""
    first = 0
    for one in measurements:
        yield one, slice(first, first + len(one.C))
        first += len(one.C)
