"""Ages of measurements that carry the time at which they were taken, each by its own.

A controller with an observer has an input `stamp.NAME` per measurement. It takes a packet with a
newer stamp at its communication points, unless that is older than it allows, and holds it until the
next one. The age in use is the time since the stamp, so that links, waiting and holds are all in
it. Before the first one the time since the start counts as its age: the state is constant before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.age import MeasuredAges, ages_at, ages_with
from cosim.scenario.measure import Fold, MeasuredRun, measure, sample_period_ns
from cosim.scenario.signal_reader import Block, own_points
from cosim.scenario.stamps import OutputStamps, stamps_read

Integers = NDArray[np.int64]


class PacketsInUse:
    """Which packets a controller with an observer has in use, interval by interval.

    Parameters
    ----------
    controller : name of the component that receives the stamps.
    names : of the measurements.
    """

    def __init__(self, run: MeasuredRun, controller: str, names: Sequence[str]) -> None:
        instance = run.instances[controller]
        self._stamps = run.reader(controller, [f"stamp.{name}" for name in names])
        self._start_ns = instance.comm_points.start_ns  # stamps are times of the components
        oldest = [instance.component.start_of(f"age.{name}", np.inf) for name in names]
        self._oldest_s = np.array(oldest, float) * (1 + 1e-12) + 1e-9
        self._in_use = np.full((1, len(names)), -1)

    def add(self, block: Block) -> tuple[Integers, Integers]:
        """Return the controller's own points after the last one before the block [ns], (n,).

        And the stamps in use before the first interval between them and in each [ns], (n, names);
        -1 where there was none.
        """
        times, stamps = self._stamps.at_own(block)
        begins = times[:-1, None]
        taken = np.round(stamps[:-1] * 1e9).astype(np.int64) - self._start_ns
        taken = np.where((begins - taken) / 1e9 > self._oldest_s, -1, taken)
        used = np.maximum.accumulate(np.concatenate((self._in_use, taken)), axis=0)
        self._in_use = used[-1:]
        return times, used


@measure
def stamped_ages(
    run: MeasuredRun,
    controller: str,
    names: Sequence[str],
    watch: Callable[[Integers, Integers], None] | None = None,
) -> Fold[dict[str, MeasuredAges | None]]:
    """Measure the ages of stamped measurements, by name; None where none came into use.

    Parameters
    ----------
    controller : name of the component that receives the stamps.
    names : of the measurements.
    watch : is called with points [ns] and the ages at the end of the interval before each [ns],
        (n, names).
    """
    packets = PacketsInUse(run, controller, names)
    ages: dict[str, MeasuredAges | None] = dict.fromkeys(names)
    while block := (yield):
        times, used = packets.add(block)
        for name, stamps in zip(names, used.T, strict=True):
            ages[name] = ages_with(ages[name], times, stamps[1:], stamps[1:], int(stamps[0]))
        if watch is not None:
            watch(times[1:], times[1:, None] - np.maximum(used[1:], 0))
    return {
        name: each and each._replace(greatest_ns=max(each.greatest_ns, each.first_ns))
        for name, each in ages.items()
    }


@measure
def command_age(run: MeasuredRun, controller: str, plant: str) -> Fold[int | None]:
    """Measure the greatest time from the estimate behind a command to the end of its use [ns].

    None where no command came into use. It is the age that a design with an observer allows for
    between its estimate and the actuators: `command_age`.
    """
    instance, greatest = run.instances[controller], -1
    routes = [r for r in run.instances[plant].routes if r.source == controller]
    commands, period_ns = OutputStamps(instance), sample_period_ns(instance.component) or 1
    while block := (yield):
        points, own = run.points_ns(block), own_points(instance, block)
        times = run.comm_points.points_ns[own]
        # at an own point, from the estimate there, if a sample instant came since the one before
        commands.add(own, times[1:], np.diff(times // period_ns) > 0)
        for route in routes:
            taken = stamps_read(route, slice(block.first, block.last - 1), commands.by_row)
            greatest = max(greatest, int(ages_at(points[1:], taken).max(initial=-1)))
    return None if greatest < 0 else greatest
