"""Stamps: the instants at which values were taken that act later, by routes and components."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.master import Algorithm, ComponentInstance, Reserved, Route
from cosim.scenario.measure import MeasuredRun, hold, sample_period_ns, samples_in
from cosim.scenario.signal_reader import Block, own_points

Integers: TypeAlias = NDArray[np.int64]

NONE_IN_USE = -1


def stamps_read(route: Route, points: Integers | slice, stamps: Integers) -> Integers:
    """Return the stamps, given by row, of what a route reads at points; -1 where it reads none."""
    row = route.in_step.row[points]
    return np.where(row >= 0, stamps[row], NONE_IN_USE)


class OutputStamps:
    """The stamp behind the outputs of a component, by row of its own points.

    Memory is that of the rows which routes still read.
    """

    def __init__(self, instance: ComponentInstance) -> None:
        self._points = instance.comm_points
        self._reserved = Reserved((self._points.most,), np.int64)
        self.by_row: Integers = self._reserved.array
        self.by_row[0] = NONE_IN_USE

    def put(self, rows: Integers, stamps: Integers) -> None:
        """Set the stamps at some own points, and forget those that no route reads any more."""
        self.by_row[rows] = stamps
        self._reserved.give_back(self._points.oldest)

    def add(self, own: Integers, stamps: Integers, comes: NDArray[np.bool_]) -> None:
        """Take steps between own points: a stamp comes with the result of some, or is kept."""
        self.put(own[1:], hold(self.by_row[own[:1]], stamps, comes))


class _Way(NamedTuple):
    """A route to the controller and one back to the plant, and the stamps of what that one reads.

    at_once : commands depend on the inputs of their own point, and so does what the plant reads.
    """

    forth: Route
    back: Route
    commands: OutputStamps
    at_once: bool


class FeedbackStamps:
    """When the measurements behind the plant's inputs were taken, over each way there and back."""

    def __init__(self, run: MeasuredRun, plant: str, controller: str, algorithm: Algorithm) -> None:
        self._ways: list[_Way] = []
        self._controller = instance = run.instances[controller]
        self._period_ns = sample_period_ns(instance.component)
        for back in (r for r in run.instances[plant].routes if r.source == controller):
            at_once = algorithm == "jacobi" and _feedthrough(instance, back)
            self._ways += [
                _Way(forth, back, OutputStamps(instance), at_once)
                for forth in instance.routes
                if forth.source == plant
            ]
        self._block: Block | None = None

    def ways(self, states: Collection[str] | None = None) -> list[int]:
        """Return which ways bring one of these inputs of the controller; None: all of them."""
        if states is None:
            return [*range(len(self._ways))]
        first, columns = self._controller.input_column, self._controller.input_columns
        targets = ({columns[k - first].name for k in way.forth.targets} for way in self._ways)
        return [k for k, names in enumerate(targets) if not names.isdisjoint(states)]

    def in_use(self, block: Block, ways: list[int]) -> tuple[Integers, Integers]:
        """Return by interval when the oldest and the newest measurement in use was taken [ns].

        The oldest is -1 where there is none over one of the ways, of which there is at least one.
        """
        if self._block != block:
            self._block, self._taken = block, np.stack([self._by(block, way) for way in self._ways])
        taken = self._taken[ways]
        there = (taken >= 0).all(axis=0)
        return np.where(there, taken.min(axis=0), NONE_IN_USE), taken.max(axis=0)

    def _by(self, block: Block, way: _Way) -> Integers:
        forth, back, commands, at_once = way
        own, points = own_points(self._controller, block), self._controller.comm_points.points_ns
        if at_once:
            commands.put(own, stamps_read(forth, own, points))
        else:  # results of a step appear at its end; only steps with a sample instant use inputs
            sampled = samples_in(points[own], self._period_ns) > 0
            commands.add(own, stamps_read(forth, own[:-1], points), sampled)
        return stamps_read(back, slice(block.first, block.last - 1), commands.by_row)


def _feedthrough(controller: ComponentInstance, back: Route) -> bool:
    """Whether all commands on this route are known to depend on inputs of the same point."""
    first = controller.output_column
    ports = [controller.output_columns[int(c) - first].port for c in back.columns]
    return all(port.feedthrough and port.feedthrough_declared for port in ports)
