"""What the measurements of an observer were: C x at their stamps, and noise; its energy.

What a measurement in use says, y, is C x(s) + v, v = diag(noise) w_v, of the time s of its stamp.
The observer holds it until the next one, and so is v: the integral of w_v' w_v is the sum of
|w_v|^2 times how long each was in use.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.first_departure import CLOSE
from cosim.scenario.guarantee.observer_rows import ObserverRows, columns_of
from cosim.scenario.measure import Measure
from cosim.scenario.performance import Binding, binding_for, times, vector_of
from cosim.scenario.signal_reader import History, reader_of

if TYPE_CHECKING:
    from cosim.hinf import Result

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_CHANCE = 6.0
"""Standard deviations beyond which the mean square of a noise is no chance."""


class MeasuredNoise(NamedTuple):
    """The noise of the measurements of a run.

    Attributes
    ----------
    energy : the integral of w_v' w_v; None where a measurement is not C x with the noise of the
        design, its instant lies between communication points, or the plant is not known.
    departures : measurements that are not what the design takes them for, one of each at most.
    """

    energy: float | None
    departures: list[Departure]


class NoiseMeasure(Measure[MeasuredNoise]):
    """The noise of the measurements of a run.

    Parameters
    ----------
    controller, plant : names of the components.
    design : with the measurements.
    rows : of the controller.
    seen_as : how the plant is seen as the system, where the design knows.
    """

    def __init__(
        self,
        controller: str,
        plant: str,
        design: Result,
        rows: ObserverRows,
        seen_as: DesignedPlant | None = None,
    ) -> None:
        self._controller, self._plant = controller, plant
        self._design, self._seen_as = design, seen_as
        self._rows = rows
        self._binding: Binding | None = None
        self._known = True
        self._found: dict[str, Departure] = {}
        self._square = [np.zeros(len(one.C)) for one in design.measurements]
        self._count = [0] * len(design.measurements)
        self._states = History()
        self._rate = [0.0] * len(design.measurements)
        self._energies = [0.0] * len(design.measurements)  # of each, so that blocks do not matter
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the measurements and the state."""
        by_name = {s.name: s for s in instances}
        plant, self._instance = by_name[self._plant], by_name[self._controller]
        self._binding = binding_for(plant, self._design.system, self._seen_as)
        if self._binding is None:
            self._known = False
            return
        self._rows.begin(self._instance)
        self._state = reader_of(plant, self._binding.state.names)

    def add(self, first: int, last: int) -> None:
        """Add the intervals that end at the points."""
        if not self._known or self._binding is None:
            return
        x = vector_of(self._binding.state, self._state.read(first, last))
        self._states.add(self._instance.comm_points.points_ns[first:last], x)
        block = self._rows.read(first, last)
        if block.packets is not None:
            self._add(*block.packets, block.y)
            self._states.forget(int(block.packets[2][-1].min()))

    def _add(self, starts: Integers, ends: Integers, used: Integers, rows: Reals) -> None:
        lasted = (ends - starts) / 1e9
        for j, (_, mine) in enumerate(columns_of(self._design.measurements)):
            comes = np.flatnonzero(used[1:, j] > used[:-1, j])
            rates = np.full(len(starts), self._rate[j])
            if comes.size:  # a block may have no packet
                found = self._rates_of(j, used[comes + 1, j], rows[comes, mine])
                in_force = np.searchsorted(comes, np.arange(len(starts)), side="right") - 1
                rates = np.where(in_force < 0, rates, found[in_force])
            self._rate[j] = float(rates[-1])
            self._energies[j] = float(_continued(self._energies[j], lasted * rates))

    def _rates_of(self, j: int, stamps: Integers, values: Reals) -> Reals:
        """Return |w_v|^2 of measurements that were taken at stamps [ns], and keep what is wrong."""
        each = self._design.measurements[j]
        past, between = self._states.at(stamps)
        if between.any():
            at = int(stamps[np.argmax(between)])
            self._depart(each.name, at, "a measurement of a point of the run", "one between two")
        true = times(past, each.C)
        noise, sizes = values - true, np.array(each.noise)
        silent = sizes == 0.0
        wrong = ~(np.abs(noise) <= CLOSE * (1.0 + np.abs(true))) & silent & ~between[:, None]
        if wrong.any():
            k, i = (int(x) for x in np.argwhere(wrong)[0])
            expected = f"{true[k, i]:.9g}, of the plant at its stamp, without noise"
            self._depart(f"{each.name}[{i + 1}]", int(stamps[k]), expected, f"{values[k, i]:.9g}")
        shares = np.where(silent, 0.0, noise / np.where(silent, 1.0, sizes))
        squares = shares * shares
        self._square[j] = _continued(self._square[j], squares)
        self._count[j] += len(stamps)
        return np.cumsum(squares, axis=1)[:, -1]

    def _depart(self, name: str, stamp: int, expected: str, got: str) -> None:
        self._known = False
        at = self._instance.comm_points.at_s(stamp)
        place = f"{self._controller}.{name}"
        self._found.setdefault(name, Departure(place, expected, got, at))

    def _too_great(self) -> Iterator[Departure]:
        """Yield values whose noise is greater, on the whole, than the design counts with."""
        for each, square, count in zip(
            self._design.measurements, self._square, self._count, strict=True
        ):
            if not count:
                continue
            # of a normal noise of this size the mean square is within this, but for one run in 1e9
            most = 1.0 + _CHANCE * math.sqrt(2.0 / count) + _CHANCE * _CHANCE / count
            for i in np.flatnonzero(square / count > most).tolist():
                size = math.sqrt(square[i] / count) * each.noise[i]
                yield Departure(
                    f"{self._controller}.{each.name}[{i + 1}]",
                    f"noise of {each.noise[i]:g}",
                    f"errors of {size:.4g}, by their mean square",
                )

    def result(self, run: Run) -> MeasuredNoise:
        """Return the energy, and what is no measurement of the design."""
        del run
        found = [*self._found.values(), *self._too_great()]
        return MeasuredNoise(sum(self._energies) if self._known else None, found)


def _continued(known: Any, rows: Reals) -> Any:
    """Return a sum with the rows of a block, added one by one: the same however they are cut."""
    return np.cumsum(np.concatenate((np.array([known]), rows)), axis=0)[-1]
