"""Saturation of the commands of a run, and whether it was a limit cycle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.scenario.measure import Measure, after, measured
from cosim.scenario.run_events import Episodes, EventCollector, close_all
from cosim.scenario.signal_reader import SignalReader
from cosim.trace import RunEvent

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


def saturation(run: Run, controller: str) -> Saturation | None:
    """Return the saturation of a controller's commands; None if it has no limits."""
    return measured(run, SaturationMeasure(controller))


class SaturationMeasure(Measure[Saturation | None]):
    """The saturation of a controller's commands; None without limits, or without a step.

    With a collector, each command that reaches its limit is an event, and when it leaves it.

    A limit cycle is a status of a run that has reached its end; its last quarter is therefore
    known from the start.
    """

    def __init__(self, controller: str, collector: EventCollector | None = None) -> None:
        self._controller, self._collector = controller, collector
        self._episodes: list[Episodes] = []
        self._reader: SignalReader | None = None
        self._points: NDArray[np.int64] | None = None
        self._commands: NDArray[np.float64] | None = None
        self._names: list[str] = []
        self._all, self._late = _Time(), _Time()

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the commands that have limits."""
        instance = next((s for s in instances if s.name == self._controller), None)
        if instance is None:
            return
        ports = instance.component.description.ports
        limit_of = limits_of(ports)
        self._names = list(limit_of)
        if not self._names:
            return
        start_of = instance.component.start_of
        self._bounds = np.array([start_of(limit_of[n], 0.0) for n in self._names])
        self._reader = SignalReader(instance, self._names)
        self.reads_inputs = self._reader.reads_inputs
        self._largest = np.zeros(len(self._names))
        self._sides: list[NDArray[np.float64]] = [np.zeros(0) for _ in self._names]
        self._reversals = [0] * len(self._names)
        self._instance = instance
        if self._collector is not None:
            for name, bound in zip(self._names, self._bounds.tolist(), strict=True):
                words = f"at its limit of {bound:g} {ports[name].unit or ''}".rstrip()
                subject = f"{self._controller}.{name}"
                begins = RunEvent(0, "warning", "saturation", subject, words)
                self._episodes.append(Episodes(self._collector, begins, "below its limit again"))
        self._last_quarter_ns = instance.comm_points.end_ns * 3 // 4

    def add(self, first: int, last: int) -> None:
        """Take the commands at the points; each lasts to the next point."""
        if self._reader is None:
            return
        block = self._reader.read(first, last)
        self._largest = np.maximum(self._largest, np.abs(block).max(axis=0))
        now = self._instance.comm_points.points_ns[first:last]
        for j, episodes in enumerate(self._episodes):
            episodes.add(now, self._at_limit(block[:, j], self._bounds[j]))
        commands = after(self._commands, block)
        points = after(self._points, now)
        self._commands, self._points = commands[-1:].copy(), points[-1:].copy()
        commands, duration = commands[:-1], np.diff(points)
        at_limit = self._at_limit(commands, self._bounds)
        anywhere: NDArray[np.bool_] = np.logical_or.reduce(at_limit, axis=1)
        self._all.add(duration, anywhere)
        late = int(np.searchsorted(points[:-1], self._last_quarter_ns))
        self._late.add(duration[late:], anywhere[late:])
        for j in range(len(self._names) if anywhere[late:].any() else 0):
            reached = commands[late:, j][at_limit[late:, j]]
            sides = np.concatenate((self._sides[j], np.sign(reached)))
            self._reversals[j] += int(np.count_nonzero(np.diff(sides)))
            self._sides[j] = sides[-1:].copy()

    @staticmethod
    def _at_limit(commands: NDArray[np.float64], bounds: Any) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = np.abs(commands) >= bounds * (1 - 1e-12)
        return found

    def result(self, run: Run) -> Saturation | None:
        """Return the saturation of the run."""
        close_all(self._episodes, run.end_ns)
        if self._reader is None or self._all.total_ns == 0:
            return None
        cycling = self._late.share > 0.5 and max(self._reversals) >= _REVERSALS
        return Saturation(
            fraction=self._all.share,
            largest=dict(zip(self._names, self._largest.tolist(), strict=True)),
            limit_cycle=run.status == "finished" and cycling,
        )


class _Time:
    """How long commands were at their limits, in exact nanoseconds."""

    def __init__(self) -> None:
        self.total_ns = self._at_limit_ns = 0

    def add(self, duration: NDArray[np.int64], at_limit: NDArray[np.bool_]) -> None:
        self.total_ns += int(duration.sum())
        self._at_limit_ns += int(duration[at_limit].sum())

    @property
    def share(self) -> float:
        return float(self._at_limit_ns) / float(self.total_ns) if self.total_ns else 0.0
