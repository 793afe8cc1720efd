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

from cosim.master import ComponentInstance
from cosim.models import STATE, TABLE_1, DelaySystem, thrust_map, total
from cosim.scenario.designed_plant import DesignedPlant, LinearSignals
from cosim.scenario.measure import Fold, Measure, MeasuredRun, measure
from cosim.scenario.signal_reader import Block, SignalReader

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


class VectorReader(NamedTuple):
    """Reads one of the vectors of Eq. (7)."""

    group: LinearSignals
    signals: SignalReader

    def read(self, block: Block) -> NDArray[np.float64]:
        """Return its entries at the points of a block, (n, entries)."""
        deviation = self.signals.read(block) - np.array(self.group.trim)
        return deviation if self.group.map is None else times(deviation, self.group.map)


def vectors_of(
    run: MeasuredRun, plant: str, system: DelaySystem, seen_as: DesignedPlant | None = None
) -> list[VectorReader] | None:
    """Return what reads x, u and w of a plant in a run; None of a plant that is not known."""
    binding = binding_for(run.instances[plant], system, seen_as)
    if binding is None:
        return None
    return [VectorReader(group, run.reader(plant, group.names)) for group in binding]


class MeasuredGain(NamedTuple):
    """The gain of a run, and the energy of its disturbance; None where it is not known."""

    gain: float | None = None
    energy_in: float | None = 0.0


@measure
def measured_gain(
    run: MeasuredRun,
    plant: str,
    system: DelaySystem,
    seen_as: DesignedPlant | None = None,
    noise: Measure[Any] | None = None,
) -> Fold[MeasuredGain]:
    """Measure sqrt(int z'z / int w'w) over the run.

    None without a disturbance or without z, of a plant that is not known, and of a failed run; and
    where measurements have a noise that the design has not.

    Parameters
    ----------
    plant : name of the plant.
    system : the system it was designed as.
    seen_as : how the plant is seen as that system, where the design knows.
    noise : a measure of the same points whose result has the `energy` of the noise of an
        observer's measurements, which is a disturbance as w is; None where that is not known.
    """
    vectors = vectors_of(run, plant, system, seen_as)
    if vectors is None or not system.has_performance:
        return MeasuredGain()
    energy_in = begins = ends = 0.0
    while block := (yield):
        h = np.diff(run.points_ns(block)) / 1e9
        x, u, w = (vector.read(block) for vector in vectors)
        direct = (times(w, system.D1) + times(u, system.D2))[:-1]
        z = times(x, system.D)
        energy_in = _with_squares(energy_in, h, w[:-1])
        begins = _with_squares(begins, h, z[:-1] + direct)
        ends = _with_squares(ends, h, z[1:] + direct)
    of_noise = 0.0 if noise is None else noise.result(run.end).energy
    if of_noise is None:
        return MeasuredGain(energy_in=None)
    energy_in += of_noise
    if run.end.status == "failed" or energy_in == 0.0:
        return MeasuredGain(energy_in=energy_in)
    gain = math.sqrt(0.5 * (begins + ends) / energy_in)
    return MeasuredGain(gain if math.isfinite(gain) else None, energy_in)


def _with_squares(integral: float, h: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return an integral with h |values|^2, added in order: the order of `sum` may vary.

    h : lengths of intervals [s], (n,); values : in them, (n, m).
    """
    with np.errstate(over="ignore"):  # no gain is measured where the sum is infinite
        parts = (h[:, None] * values * values).ravel()
    return float(np.cumsum(np.concatenate(([integral], parts)))[-1])


def times(rows: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows @ matrix.T in a fixed order of operations: that of a BLAS varies by processor."""
    columns = [total(a * rows[:, j] for j, a in enumerate(row)) for row in matrix.tolist()]
    wide = [np.broadcast_to(column, len(rows)) for column in columns]
    return np.column_stack(wide) if wide else np.zeros((len(rows), 0))
