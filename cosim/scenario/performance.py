"""Measured gain of a run from w to z = D x + D1 w + D2 u, Eq. (7) of the paper.

Inputs are held between communication points, so integrals of w'w are exact; z'z is integrated
by the trapezoidal rule in each interval, both ends with the held u and w of the interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.models import STATE, TABLE_1, DelaySystem, thrust_map, total
from cosim.scenario.designed_plant import DesignedPlant, LinearSignals
from cosim.scenario.measure import Measure, after
from cosim.scenario.signal_reader import SignalReader, reader_of

FORCES = ("force.x", "force.y", "force.z", "moment.z")
DISTURBANCES = ("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r")
"""Inputs of the vehicle: commands, and accelerations that act on it."""


class Binding(NamedTuple):
    """x, u and w of Eq. (7) as variables of the plant; for the vehicle, u is an acceleration."""

    state: LinearSignals
    control: LinearSignals
    disturbance: LinearSignals


def binding_for(
    instance: ComponentInstance, system: DelaySystem, plant: DesignedPlant | None = None
) -> Binding | None:
    """Bind a plant by the names of its variables; None if they are not those of a known plant.

    plant : says which variables they are, where the design knows.
    """
    ports = instance.component.description.ports
    if plant is not None:
        return Binding(plant.state, plant.control, plant.disturbance)
    if all(name in ports for name in (*STATE, *FORCES, *DISTURBANCES)):
        values = {name: instance.component.start_of(name, 0.0) for name in TABLE_1}
        thrust = np.array(thrust_map(values), dtype=float)
        return Binding(_plain(STATE), _plain(FORCES, thrust), _plain(DISTURBANCES))
    names = equation_names(system, len(system.A))
    if all(name in ports for group in names for name in group):
        return Binding(*map(_plain, names))
    return None


def elements(name: str, count: int) -> tuple[str, ...]:
    """Return the names of an array's elements."""
    return tuple(f"{name}[{i + 1}]" for i in range(count))


def equation_names(
    system: DelaySystem, states: int
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return x, u and w as the variables of a plant that has those of Eq. (7)."""
    m, q = system.B.shape[1], system.C.shape[1]
    return elements("x", states), elements("u", m), elements("w", q)


def _plain(names: Sequence[str], mapped: NDArray[np.float64] | None = None) -> LinearSignals:
    """Return signals that are zero at the trim."""
    return LinearSignals(tuple(names), (0.0,) * len(names), mapped)


class GainMeasure(Measure[float | None]):
    """sqrt(int z'z / int w'w) over the run.

    None without a disturbance or without z, of a plant that is not known, and of a failed run; and
    where measurements have a noise that the design has not.

    Parameters
    ----------
    plant : name of the plant.
    system : the system it was designed as.
    seen_as : how the plant is seen as that system, where the design knows.
    noise : a measure of the same points whose result has the `energy` of the noise of an
        observer's measurements, which is a disturbance as w is; None where that is not known.

    Attributes
    ----------
    energy_in : of the disturbance and the noise, after `result`; None where it is not known.
    """

    def __init__(
        self,
        plant: str,
        system: DelaySystem,
        seen_as: DesignedPlant | None = None,
        noise: Measure[Any] | None = None,
    ) -> None:
        self._plant, self._system, self._seen_as = plant, system, seen_as
        self._noise = noise
        self._readers: tuple[SignalReader, ...] = ()
        self._before: tuple[Any, ...] = (None, None, None, None)
        self._disturbance, self._outset, self._end = _Integral(), _Integral(), _Integral()
        self.energy_in: float | None = 0.0

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Bind the variables of the plant."""
        instance = next((s for s in instances if s.name == self._plant), None)
        binding = None if instance is None else binding_for(instance, self._system, self._seen_as)
        if instance is None or binding is None or not self._system.has_performance:
            return
        self._instance, self._binding = instance, binding
        self._readers = tuple(reader_of(instance, group.names) for group in binding)
        self.reads_inputs = any(reader.reads_inputs for reader in self._readers)

    def add(self, first: int, last: int) -> None:
        """Add the integrals over the intervals that end at the points."""
        if not self._readers:
            return
        x, u, w = (
            vector_of(group, reader.read(first, last))
            for group, reader in zip(self._binding, self._readers, strict=True)
        )
        direct = times(w, self._system.D1) + times(u, self._system.D2)
        here = (
            self._instance.comm_points.points_ns[first:last],
            w,
            times(x, self._system.D),
            direct,
        )
        points, w, z, direct = (
            after(before, block) for before, block in zip(self._before, here, strict=True)
        )
        self._before = tuple(block[-1:].copy() for block in (points, w, z, direct))
        h = np.diff(points) / 1e9
        self._disturbance.add(h, w[:-1])
        self._outset.add(h, z[:-1] + direct[:-1])
        self._end.add(h, z[1:] + direct[:-1])

    def result(self, run: Run) -> float | None:
        """Return the gain."""
        noise = 0.0 if self._noise is None or not self._readers else self._noise.result(run).energy
        if noise is None:
            self.energy_in = None
            return None
        self.energy_in = energy_in = self._disturbance.value + noise
        if run.status == "failed" or energy_in == 0.0:
            return None
        energy_out = 0.5 * (self._outset.value + self._end.value)
        gain = math.sqrt(energy_out / energy_in)
        return gain if math.isfinite(gain) else None


class _Integral:
    """The sum of h |values|^2, added in order: the order of `sum` may vary."""

    def __init__(self) -> None:
        self.value = 0.0

    def add(self, h: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """Continue with values at the beginnings of intervals h [s], (n, m)."""
        with np.errstate(over="ignore"):  # no gain is measured where the sum is infinite
            parts = (h[:, None] * values * values).ravel()
        self.value = float(np.cumsum(np.concatenate(([self.value], parts)))[-1])


def vector_of(group: LinearSignals, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the entries of a vector of the linear model from the values of its variables."""
    deviation = rows - np.array(group.trim)
    return deviation if group.map is None else times(deviation, group.map)


def times(rows: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows @ matrix.T in a fixed order of operations: that of a BLAS varies by processor."""
    columns = [total(a * rows[:, j] for j, a in enumerate(row)) for row in matrix.tolist()]
    wide = [np.broadcast_to(column, len(rows)) for column in columns]
    return np.column_stack(wide) if wide else np.zeros((len(rows), 0))
