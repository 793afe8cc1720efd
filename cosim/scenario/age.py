"""How old the measurements are that act on the plant: the whole way round.

At each instant the command in force was computed from a measurement taken earlier; the time
since is what a design "for any age up to d" is about. It holds the link to the controller,
the wait for its sample instant, the step that the coupling adds, the link back, and the hold
until the next command arrives.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import Run
from cosim.master.routes import Route
from cosim.master.stations import Station

NONE_IN_USE = -1


def measurement_age_ns(run: Run, plant: str, controller: str) -> NDArray[np.int64]:
    """Largest age within each interval [t_k, t_{k+1}) [ns], int64 (points - 1,).

    `NONE_IN_USE` (-1) where no measurement acts yet, or a link's substitute stands in for
    one. Where several links lie side by side, the oldest counts.
    """
    by_name = {s.name: s for s in run.stations}
    points = run.points_ns
    ages = np.full(max(points.size - 1, 0), NONE_IN_USE, np.int64)
    if plant not in by_name or controller not in by_name or ages.size == 0:
        return ages
    down = [r for r in by_name[plant].routes if r.source == controller]
    up = [r for r in by_name[controller].routes if r.source == plant]
    if not down or not up:
        return ages
    sampled = _sampled_row(by_name[controller], points)
    missing = np.zeros(ages.size, bool)
    for back in down:
        for forth in up:
            origin = _origin_ns(back, forth, sampled, points)
            missing |= origin < 0
            ages = np.maximum(ages, points[1:] - origin)
    ages[missing] = NONE_IN_USE
    return ages


def _sampled_row(controller: Station, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each row, the row whose inputs the controller's outputs there come from; -1: none."""
    parameters = controller.component.parameters
    port = controller.component.description.ports.get("sample_time")
    default = port.start if port is not None else 0.0
    period = round(float(parameters.get("sample_time", default or 0.0)) * 1e9)
    rows = np.arange(points.size) - 1  # what is computed in a step is seen at its end
    if period <= 0:
        return rows
    # step j, from point j to j+1, samples when it contains a multiple of the period
    first = -(-points[:-1] // period) * period
    samples = first < points[1:]
    latest = np.maximum.accumulate(np.where(samples, np.arange(points.size - 1), -1))
    return np.append([-1], latest)


def _origin_ns(
    back: Route, forth: Route, sampled: NDArray[np.int64], points: NDArray[np.int64]
) -> NDArray[np.int64]:
    """When the measurement behind the plant's input was taken, per interval; -1: none."""
    intervals = points.size - 1
    command = back.row[:intervals]
    inputs = np.where(command >= 0, sampled[np.maximum(command, 0)], -1)
    row = np.where(inputs >= 0, forth.row[np.maximum(inputs, 0)], -1)
    origin: NDArray[np.int64] = np.where(row >= 0, points[np.maximum(row, 0)], -1)
    return origin
