"""What the run did to the disturbance: z = D x + D1 w + D2 u of Eq. (7) along the rows.

Inputs are held between communication points, so integrals of w'w are exact; z'z is taken by
the trapezoidal rule within each interval, both ends with the held u and w of the interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.master import Run
from cosim.models import STATE, TABLE_1, DelaySystem, thrust_map, total

_FORCE = ("force.x", "force.y", "force.z", "moment.z")
_DISTURBANCE = ("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r")


@dataclass(frozen=True)
class Binding:
    """Which variables of the plant are x, u and w of Eq. (7).

    `input_map` (m, m) turns the plant's inputs into u: for the vehicle, forces into the
    accelerations that the theory calls u.
    """

    state: tuple[str, ...]
    control: tuple[str, ...]
    disturbance: tuple[str, ...]
    input_map: NDArray[np.float64]


def binding_for(run: Run, plant: str, system: DelaySystem) -> Binding | None:
    """The binding of a plant, from the names of its variables; None if they are others."""
    instance = next((s for s in run.instances if s.name == plant), None)
    if instance is None:
        return None
    ports = instance.component.description.ports
    if all(name in ports for name in (*STATE, *_FORCE, *_DISTURBANCE)):
        values = {
            name: instance.component.parameters.get(name, ports[name].start or 0.0)
            for name in TABLE_1
        }
        return Binding(STATE, _FORCE, _DISTURBANCE, np.array(thrust_map(values), dtype=float))
    (n, m), q = system.B.shape, system.C.shape[1]
    names = (
        tuple(f"x[{i + 1}]" for i in range(n)),
        tuple(f"u[{j + 1}]" for j in range(m)),
        tuple(f"w[{k + 1}]" for k in range(q)),
    )
    if all(name in ports for group in names for name in group):
        return Binding(*names, np.eye(m))
    return None


def measured_gain(run: Run, plant: str, binding: Binding, system: DelaySystem) -> float | None:
    """sqrt(int z'z / int w'w) over the run; None if there was no disturbance, or no z."""
    if not system.has_performance:
        return None
    x = _signals(run, plant, binding.state)
    u = _times(_signals(run, plant, binding.control), binding.input_map)
    w = _signals(run, plant, binding.disturbance)
    h = np.diff(run.points_ns) / 1e9
    energy_in = _integral(h, w[:-1])
    if energy_in == 0.0:
        return None
    direct = _times(w[:-1], system.D1) + _times(u[:-1], system.D2)
    z = _times(x, system.D)
    energy_out = 0.5 * (_integral(h, z[:-1] + direct) + _integral(h, z[1:] + direct))
    gain = math.sqrt(energy_out / energy_in)
    return gain if math.isfinite(gain) else None


def _times(rows: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """rows @ matrix.T in one order of operations: a BLAS has its own on every processor."""
    columns = [total(a * rows[:, j] for j, a in enumerate(row)) for row in matrix.tolist()]
    wide = [np.broadcast_to(column, len(rows)) for column in columns]
    return np.column_stack(wide) if wide else np.zeros((len(rows), 0))


def _integral(h: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Sum of h |values|^2, one after the other: `sum` takes them in an order of its own."""
    parts = np.cumsum(h[:, None] * values * values)
    return float(parts[-1]) if parts.size else 0.0


def _signals(run: Run, component: str, names: Sequence[str]) -> NDArray[np.float64]:
    """Values at the points reached, (k, len(names)); an input nobody drives stays at its start."""
    columns = []
    instance = next(s for s in run.instances if s.name == component)
    count = run.points_ns.size
    for name in names:
        recorded = {c.name for c in (*instance.output_columns, *instance.input_columns)}
        if name in recorded:
            columns.append(run.signal(component, name))
        else:
            start = instance.component.parameters.get(
                name, instance.component.description.ports[name].start or 0.0
            )
            columns.append(np.full(count, start))
    return np.column_stack(columns) if columns else np.zeros((count, 0))
