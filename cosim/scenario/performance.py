"""Measured gain of a run from w to z = D x + D1 w + D2 u, Eq. (7) of the paper.

Inputs are held between communication points, so integrals of w'w are exact; z'z is integrated
by the trapezoidal rule in each interval, both ends with the held u and w of the interval.
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
    """The variables of the plant that are x, u and w of Eq. (7).

    `input_map` (m, m) maps the plant's inputs to u: for the vehicle, forces to accelerations.
    """

    state: tuple[str, ...]
    control: tuple[str, ...]
    disturbance: tuple[str, ...]
    input_map: NDArray[np.float64]


def binding_for(run: Run, plant: str, system: DelaySystem) -> Binding | None:
    """Bind a plant by the names of its variables; None if they are not those of a known plant."""
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
    """Return sqrt(int z'z / int w'w) over the run; None without a disturbance, or without z."""
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
    """Return rows @ matrix.T in a fixed order of operations: that of a BLAS varies by processor."""
    columns = [total(a * rows[:, j] for j, a in enumerate(row)) for row in matrix.tolist()]
    wide = [np.broadcast_to(column, len(rows)) for column in columns]
    return np.column_stack(wide) if wide else np.zeros((len(rows), 0))


def _integral(h: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return the sum of h |values|^2, added in order: the order of `sum` may vary."""
    parts = np.cumsum(h[:, None] * values * values)
    return float(parts[-1]) if parts.size else 0.0


def _signals(run: Run, component: str, names: Sequence[str]) -> NDArray[np.float64]:
    """Return values at the points reached, (k, len(names)); unconnected inputs at their start."""
    instance = next(s for s in run.instances if s.name == component)
    parameters, ports = instance.component.parameters, instance.component.description.ports
    recorded = {c.name for c in (*instance.output_columns, *instance.input_columns)}
    count = run.points_ns.size
    columns = [
        run.signal(component, name)
        if name in recorded
        else np.full(count, parameters.get(name, ports[name].start or 0.0))
        for name in names
    ]
    return np.column_stack(columns) if columns else np.zeros((count, 0))
