"""What a controller with an observer is told, shows and commands: read once for all its laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.measure import MeasuredRun
from cosim.scenario.measurement_ages import PacketsInUse
from cosim.scenario.performance import elements
from cosim.scenario.signal_reader import Block

if TYPE_CHECKING:
    from cosim.hinf import Result
    from cosim.models import Measurement

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class ObserverBlock(NamedTuple):
    """Rows at the controller's own points after the last one before a block.

    Attributes
    ----------
    times : the points [ns], (n,).
    used : the stamps in use before the first interval between them and in each [ns], (n, names).
    y : the measurements at the inputs, less their trim, (n, values).
    estimate, innovation, command, applied : the outputs of these names, (n, k).
    set_point : of the estimate; no column where the controller has none.
    watchdog : not zero where the watchdog holds a safe value, (n, 1).
    """

    times: Integers
    used: Integers
    y: Reals
    estimate: Reals
    innovation: Reals
    command: Reals
    applied: Reals
    set_point: Reals
    watchdog: Reals


class ObserverRows:
    """Reads a controller with an observer block by block; outputs that it lacks have no column.

    Attributes
    ----------
    y, estimate, innovation, command, applied, set_point : names of the variables.
    """

    def __init__(self, run: MeasuredRun, loop: DesignedLoop, design: Result) -> None:
        component, (n, m) = run.instances[loop.controller].component, design.system.B.shape
        self.y = [name for one in loop.measurements for name in one.inputs]
        self.estimate, self.applied = elements("estimate", n), elements("applied", m)
        self.innovation = [f"innovation.{name}" for name in self.y]
        self.command = list(loop.commands.values())
        self.set_point = elements("reference", n)
        outputs = self.estimate, self.innovation, self.command, self.applied, self.set_point
        ports = component.description.ports
        present = ([n for n in names if n in ports] for names in (*outputs, ["watchdog"]))
        groups = self.y, *present
        self._rows = run.reader(loop.controller, [name for group in groups for name in group])
        self._edges = np.cumsum([len(group) for group in groups])[:-1]
        names = [one.name for one in design.measurements]
        self._packets = PacketsInUse(run, loop.controller, names)
        self._trims = np.array([component.start_of(f"trim.{y}", 0.0) for y in self.y], float)
        self._block: Block | None = None

    def read(self, block: Block) -> ObserverBlock:
        """Return the rows at the own points of a block."""
        if self._block != block:
            times, rows = self._rows.at_own(block)
            y, *outputs = np.split(rows, self._edges, axis=1)
            _, used = self._packets.add(block)
            self._block = block
            self._rows_of_block = ObserverBlock(times, used, y - self._trims, *outputs)
        return self._rows_of_block


def columns_of(measurements: Sequence[Measurement]) -> Iterator[tuple[Measurement, slice]]:
    """Yield measurements, each with the columns of its values among those of all."""
    first = 0
    for one in measurements:
        yield one, slice(first, first + len(one.C))
        first += len(one.C)
