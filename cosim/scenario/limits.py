"""Saturation of the commands of a run, and whether it was a limit cycle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.run_events import Episodes, EventCollector

_SHARED = {
    "force.x": "limit.force",
    "force.y": "limit.force",
    "force.z": "limit.force",
    "moment.z": "limit.moment",
}
"""Limits of the vehicle's commands; any other command has its own, `limit.` and its name."""

_REVERSALS = 4


def limits_of(ports: Iterable[str]) -> dict[str, str]:
    """Return command -> the parameter that is its limit, among the variables of a controller."""
    known = set(ports)
    limit_of = {name: _SHARED.get(name, f"limit.{name}") for name in ports}
    return {name: limit for name, limit in limit_of.items() if limit in known}


def bounds_of(instance: ComponentInstance, commands: Sequence[str]) -> NDArray[np.float64]:
    """Return the greatest magnitude of each command of a controller; inf without a limit."""
    limits, start_of = limits_of(instance.component.description.ports), instance.component.start_of
    bounds = [start_of(limits[name], np.inf) if name in limits else np.inf for name in commands]
    return np.array(bounds, float)


@dataclass(frozen=True)
class Saturation:
    """Saturation of the commands of one run.

    Attributes
    ----------
    fraction : share of the time in which at least one command was at its limit.
    largest : command name -> largest magnitude [N, N m].
    limit_cycle : the run reached its end, in its last quarter commands were at their limits more
        than half of the time, and one of them went from one limit to the other at least four
        times: the limits, not the feedback, bound the motion.
    """

    fraction: float
    largest: dict[str, float]
    limit_cycle: bool


@measure
def measured_saturation(
    run: MeasuredRun, controller: str, collector: EventCollector | None = None
) -> Fold[Saturation | None]:
    """Measure the saturation of a controller's commands; None without limits, or without a step.

    With a collector, each command that reaches its limit is an event, and when it leaves it.

    A limit cycle is a status of a run that has reached its end; its last quarter is therefore
    known from the start.
    """
    instance = run.instances[controller]
    limit_of = limits_of(instance.component.description.ports)
    if not limit_of:
        return None
    start_of, names = instance.component.start_of, list(limit_of)
    bounds = np.array([start_of(limit, 0.0) for limit in limit_of.values()])
    commands = run.reader(controller, names, recorded=True)
    episodes: list[Episodes] = []
    if collector is not None:
        for name, bound in zip(names, bounds.tolist(), strict=True):
            unit = instance.component.description.ports[name].unit or ""
            words = f"at its limit of {bound:g} {unit}".rstrip(), "below its limit again"
            episodes.append(collector.episodes("saturation", f"{controller}.{name}", *words))
    total_ns, at_limit_ns = [0, 0], [0, 0]  # in the whole run, and in its last quarter
    last_quarter_ns = run.comm_points.end_ns * 3 // 4
    largest, sides, reversals = np.zeros(len(names)), [np.zeros(0)] * len(names), [0] * len(names)
    while block := (yield):
        values, points = commands.read(block), run.points_ns(block)
        largest = np.maximum(largest, np.abs(values).max(axis=0))
        at_limit = np.abs(values) >= bounds * (1 - 1e-12)
        for each, there in zip(episodes, at_limit.T, strict=False):
            each.add(points, there)
        duration, at_limit = np.diff(points), at_limit[:-1]
        anywhere: NDArray[np.bool_] = np.logical_or.reduce(at_limit, axis=1)
        begin = int(np.searchsorted(points[:-1], last_quarter_ns))
        for k, part in enumerate((slice(None), slice(begin, None))):
            total_ns[k] += int(duration[part].sum())
            at_limit_ns[k] += int(duration[part][anywhere[part]].sum())
        for j in range(len(names) if anywhere[begin:].any() else 0):
            reached = np.sign(values[begin:-1, j][at_limit[begin:, j]])
            reversals[j] += int(np.count_nonzero(np.diff(np.concatenate((sides[j], reached)))))
            sides[j] = np.concatenate((sides[j], reached))[-1:]
    if total_ns[0] == 0:
        return None
    cycling = at_limit_ns[1] > 0.5 * total_ns[1] and max(reversals) >= _REVERSALS
    return Saturation(
        fraction=at_limit_ns[0] / total_ns[0],
        largest=dict(zip(names, largest.tolist(), strict=True)),
        limit_cycle=run.end.status == "finished" and cycling,
    )
