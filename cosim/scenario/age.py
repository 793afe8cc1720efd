"""Measurement age: time since the measurement behind the command in force was taken.

A design "for any age up to d" is about this age. It includes the link to the controller, the
wait for its sample instant and its communication step, the step that the coupling adds, the
link back, and the hold until the next command arrives.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import Algorithm, ComponentInstance, Route, Run

NONE_IN_USE = -1
Integers = NDArray[np.int64]


def measurement_age_ns(
    run: Run, plant: str, controller: str, algorithm: Algorithm = "jacobi"
) -> Integers:
    """Return the largest age in each interval [t_k, t_{k+1}) [ns], int64 (points - 1,).

    `NONE_IN_USE` (-1) where no measurement is in use yet, or a link's substitute replaces it.
    Of several parallel links, the oldest measurement counts.
    """
    by_name = {s.name: s for s in run.instances}
    points = run.points_ns
    ages = np.full(max(points.size - 1, 0), NONE_IN_USE, np.int64)
    if plant not in by_name or controller not in by_name or ages.size == 0:
        return ages
    instance = by_name[controller]
    down = [r for r in by_name[plant].routes if r.source == controller]
    up = [r for r in instance.routes if r.source == plant]
    missing = np.zeros(ages.size, bool)
    for back in down:
        at_once = algorithm == "jacobi" and _feedthrough(instance, back)
        read = np.arange(points.size) if at_once else _read_row(instance, points)
        for forth in up:
            origin = _origin_ns(back, forth, read, points)
            missing |= origin < 0
            ages = np.maximum(ages, points[1:] - origin)
    ages[missing | (not (down and up))] = NONE_IN_USE
    return ages


def _feedthrough(controller: ComponentInstance, back: Route) -> bool:
    """Whether all commands on this route are known to depend on inputs of the same point."""
    first = min(
        group.column
        for group in (*controller.outputs_without_feedthrough, *controller.outputs_with_feedthrough)
    )
    ports = [controller.output_columns[int(c) - first].port for c in back.columns]
    return all(port.feedthrough and port.feedthrough_declared for port in ports)


def _read_row(controller: ComponentInstance, points: Integers) -> Integers:
    """For each row, the point whose inputs the controller's outputs depend on; -1: none.

    Results of a step appear at its end; only steps that contain a sample instant use inputs.
    """
    own = controller.own_points.own[controller.own_points.own < points.size]
    times = points[own]
    parameters = controller.component.parameters
    port = controller.component.description.ports.get("sample_time")
    default = port.start if port is not None else 0.0
    period = round(float(parameters.get("sample_time", default or 0.0)) * 1e9)
    steps = np.arange(max(own.size - 1, 0))
    if period > 0:
        # step j, from own point j to j+1, samples when it contains a multiple of the period
        first = -(-times[:-1] // period) * period
        steps = np.maximum.accumulate(np.where(first < times[1:], steps, -1))
    read = np.full(points.size, -1, np.int64)
    read[own[1:]] = np.where(steps >= 0, own[np.maximum(steps, 0)], -1)
    return read


def _origin_ns(back: Route, forth: Route, read: Integers, points: Integers) -> Integers:
    """Return when the measurement behind the plant's input was taken, per interval; -1: none."""
    command = np.minimum(back.in_step.row[: points.size - 1], points.size - 1)
    inputs = np.where(command >= 0, read[np.maximum(command, 0)], -1)
    row = np.where(inputs >= 0, forth.in_step.row[np.maximum(inputs, 0)], -1)
    origin: Integers = np.where(row >= 0, points[np.clip(row, 0, points.size - 1)], -1)
    return origin
