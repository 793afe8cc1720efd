"""What the measurements of an observer were: C x at their stamps, and noise; its energy.

What a measurement in use says, y, is C x(s) + v, v = diag(noise) w_v, of the time s of its stamp.
The observer holds it until the next one, and so is v: the integral of w_v' w_v is the sum of
|w_v|^2 times how long each was in use.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.first_departure import CLOSE, departed, first_departed
from cosim.scenario.guarantee.observer_rows import ObserverRows, columns_of
from cosim.scenario.measure import Fold, MeasuredRun, hold, measure
from cosim.scenario.performance import elements, times, vectors_of
from cosim.scenario.signal_reader import History

if TYPE_CHECKING:
    from cosim.hinf import Result
    from cosim.models import Measurement

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


@measure
def measured_noise(
    run: MeasuredRun, loop: DesignedLoop, design: Result, seen_as: DesignedPlant | None = None
) -> Fold[MeasuredNoise]:
    """Measure the noise of the measurements of a run.

    Parameters
    ----------
    design : with the measurements.
    seen_as : how the plant is seen as the system, where the design knows.
    """
    vectors = vectors_of(run, loop.plant, design.system, seen_as)
    if vectors is None:
        return MeasuredNoise(None, [])
    rows, states = run.shared(ObserverRows, loop, design), History()
    controller = run.instances[loop.controller]
    noises = [_Noise(one, mine, controller) for one, mine in columns_of(design.measurements)]
    while block := (yield):
        if any(noise.departures for noise in noises):
            continue  # the energy is not known, and other departures follow from the first
        states.add(run.points_ns(block), vectors[0].read(block))
        at = rows.read(block)
        for noise, used in zip(noises, at.used.T, strict=True):
            noise.add(np.diff(at.times) / 1e9, used, at.y, states)
        states.forget(int(at.used[-1].min()))
    departures = [each for noise in noises for each in noise.departures]
    energy = None if departures else sum(noise.energy for noise in noises)
    return MeasuredNoise(energy, [*departures, *(d for n in noises for d in n.too_great())])


class _Noise:
    """The noise of one measurement.

    Attributes
    ----------
    energy : so far.
    departures : what is not a measurement of the design.
    """

    def __init__(self, one: Measurement, columns: slice, controller: ComponentInstance) -> None:
        self._one, self._columns, self._controller = one, columns, controller
        self.energy = 0.0
        self.departures: list[Departure] = []
        self._rate = np.zeros(1)
        self._squares, self._count = np.zeros((1, len(one.C))), 0

    def add(self, lasted: Reals, used: Integers, y: Reals, states: History) -> None:
        """Take intervals, with the stamps in use before the first and in each [ns], and inputs."""
        new = used[1:] > used[:-1]
        rates = np.zeros(len(lasted))
        if new.any():  # a block may have no packet
            rates[new] = self._rates_of(used[1:][new], y[:-1][new, self._columns], states)
        rates = hold(self._rate, rates, new)
        self._rate = np.concatenate((self._rate, rates))[-1:]
        self.energy = float(np.cumsum(np.concatenate(([self.energy], lasted * rates)))[-1])

    def _rates_of(self, stamps: Integers, values: Reals, states: History) -> Reals:
        """Return |w_v|^2 of measurements that were taken at stamps [ns], and keep what is wrong."""
        name, C = self._one.name, self._one.C
        past, between = states.at(stamps)
        if between.any():
            words = "a measurement of a point of the run", "one between two"
            self.departures += departed(self._controller, name, *words, stamps[np.argmax(between)])
        true = times(past, C)
        noise, sizes = values - true, np.array(self._one.noise)
        silent = sizes == 0.0
        wrong = ~(np.abs(noise) <= CLOSE * (1.0 + np.abs(true))) & silent & ~between[:, None]
        self.departures += first_departed(
            *(self._controller, elements(name, len(C)), stamps, (true, values), wrong),
            "of the plant at its stamp, without noise",
        )
        shares = np.where(silent, 0.0, noise / np.where(silent, 1.0, sizes))
        squares = shares * shares
        self._squares = np.cumsum(np.concatenate((self._squares, squares)), axis=0)[-1:]
        self._count += len(stamps)
        return np.cumsum(squares, axis=1)[:, -1]

    def too_great(self) -> Iterator[Departure]:
        """Yield values whose noise is greater, on the whole, than the design counts with."""
        if not self._count:
            return
        # of a normal noise of this size the mean square is within this, but for one run in 1e9
        most = 1.0 + _CHANCE * math.sqrt(2.0 / self._count) + _CHANCE * _CHANCE / self._count
        mean = self._squares[0] / self._count
        for i in np.flatnonzero(mean > most).tolist():
            noise = self._one.noise[i]
            got = f"errors of {math.sqrt(mean[i]) * noise:.4g}, by their mean square"
            name = f"{self._one.name}[{i + 1}]"
            yield from departed(self._controller, name, f"noise of {noise:g}", got)
