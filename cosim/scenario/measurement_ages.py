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

from cosim.master import ComponentInstance, Run
from cosim.scenario.age import Lookup, MeasuredAges
from cosim.scenario.measure import Measure, Recent, after, sample_period_ns
from cosim.scenario.signal_reader import reader_of

Integers = NDArray[np.int64]


class PacketsInUse:
    """Which packets a controller with an observer has in use, interval by interval.

    Parameters
    ----------
    names : of the measurements.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._begins: Integers | None = None
        self._last = self._in_use = np.full((1, len(self._names)), -1)

    def begin(self, controller: ComponentInstance) -> None:
        """Find the stamps, and the ages beyond which a packet is ignored."""
        self._instance = controller
        self._reader = reader_of(controller, [f"stamp.{name}" for name in self._names])
        self._start_ns = controller.comm_points.start_ns  # stamps are times of the components
        oldest = [controller.component.start_of(f"age.{name}", np.inf) for name in self._names]
        self._oldest_s = np.array(oldest, float) * (1 + 1e-12) + 1e-9

    def add(self, first: int, last: int) -> tuple[Integers, Integers, Integers] | None:
        """Return the intervals that end at the controller's points among these; None of none.

        They are their beginnings and ends [ns], (n,), and the stamps in use before the first of
        them and in each [ns], (n + 1, names); -1 where there was none.
        """
        stamps = self._reader.read(first, last)
        own = self._instance.own_points.own_between(first, last)
        if not own.size:
            return None
        times = self._instance.comm_points.points_ns[own]
        taken = np.round(stamps[own - first] * 1e9).astype(np.int64) - self._start_ns
        begins = after(self._begins, times)
        if self._begins is not None:
            taken = np.concatenate((self._last, taken))
        # the inputs of the last point are in use in an interval that has not ended yet
        self._last, self._begins = taken[-1:].copy(), times[-1:].copy()
        starts, ends, taken = begins[:-1], begins[1:], taken[:-1]
        if not ends.size:
            return None
        taken = np.where((starts[:, None] - taken) / 1e9 > self._oldest_s, -1, taken)
        used = np.maximum.accumulate(np.concatenate((self._in_use, taken)), axis=0)
        self._in_use = used[-1:].copy()
        return starts, ends, used


class StampedAges(Measure[dict[str, MeasuredAges | None]]):
    """The ages of stamped measurements over a run, by name; None where none came into use.

    Parameters
    ----------
    controller : name of the component that receives the stamps.
    names : of the measurements.
    watch : is called with points [ns] and the ages at the end of the interval before each [ns],
        (n, names).
    """

    def __init__(
        self,
        controller: str,
        names: Sequence[str],
        watch: Callable[[Integers, Integers], None] | None = None,
    ) -> None:
        self._controller, self._names, self._watch = controller, tuple(names), watch
        self._packets = PacketsInUse(names)
        self._ages = [_Ages() for _ in names]
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the stamps."""
        self._packets.begin(next(s for s in instances if s.name == self._controller))

    def add(self, first: int, last: int) -> None:
        """Take the intervals that end at the points."""
        found = self._packets.add(first, last)
        if found is None:
            return
        starts, ends, used = found
        for j, ages in enumerate(self._ages):
            ages.add(starts, ends, used[:, j])
        if self._watch is not None:
            self._watch(ends, ends[:, None] - np.maximum(used[1:], 0))

    def result(self, run: Run) -> dict[str, MeasuredAges | None]:
        """Return the ages."""
        del run
        return {name: ages.found for name, ages in zip(self._names, self._ages, strict=True)}


class _Ages:
    """The ages of one measurement, interval by interval."""

    def __init__(self) -> None:
        self.found: MeasuredAges | None = None
        self._greatest = 0

    def add(self, starts: Integers, ends: Integers, used: Integers) -> None:
        """Take intervals, and the stamps in use before the first of them and in each [ns]."""
        now, before = used[1:], used[:-1]
        self._greatest = max(self._greatest, int((ends - np.maximum(now, 0)).max()))
        comes = (starts - now)[(now > before) & (now > 0)]
        there = now >= 0
        if not there.any():
            return
        known = self.found
        new = comes.tolist()
        least = new + ([] if known is None or known.least_ns is None else [known.least_ns])
        new += [] if known is None else list(known.in_use_ns or ())
        self.found = MeasuredAges(
            least_ns=min(least, default=None),
            greatest_ns=self._greatest,
            in_use_ns=(min(new), max(new)) if new else None,
            first_ns=known.first_ns if known else int(starts[there][0]),
            alike=True,
        )


class CommandAge(Measure[int | None]):
    """The greatest time from the estimate behind a command to the end of its use [ns].

    None where no command came into use. It is the age that a design with an observer allows for
    between its estimate and the actuators: `command_age`.
    """

    def __init__(self, controller: str, plant: str) -> None:
        self._controller, self._plant = controller, plant
        self._points: Integers | None = None
        self._greatest: int | None = None
        self._routes: list[Lookup] = []

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the ways of the commands."""
        plant = next((s for s in instances if s.name == self._plant), None)
        if plant is None:
            return
        self._instance = next(s for s in instances if s.name == self._controller)
        self._routes = [Lookup(r) for r in plant.routes if r.source == self._controller]
        self._recent, self._computed = Recent(), -1
        self._period = sample_period_ns(self._instance.component)
        self._own: Integers | None = None

    def add(self, first: int, last: int) -> None:
        """Take the intervals that end at the points."""
        if not self._routes:
            return
        self._recent.add(self._instants(first, last), self._instance)
        points = after(self._points, self._instance.comm_points.points_ns[first:last])
        self._points = points[-1:].copy()
        for route in self._routes:
            taken = route.add(first, last, self._recent)[:-1]
            there = taken >= 0
            if there.any():
                oldest = int((points[1:] - taken)[there].max())
                self._greatest = max(oldest, self._greatest or 0)

    def _instants(self, first: int, last: int) -> Integers:
        """Return for each row when its command was computed [ns]; -1 between own points.

        At an own point, from the estimate there, if a sample instant came since the one before.
        """
        own = self._instance.own_points.own_between(first, last)
        found = np.full(last - first, -1, np.int64)
        if not own.size:
            return found
        times = self._instance.comm_points.points_ns[own]
        before = np.concatenate((times[:1] if self._own is None else self._own, times[:-1]))
        self._own = times[-1:].copy()
        period = self._period or 1
        computed = np.where(times // period > before // period, times, -1)
        computed = np.maximum.accumulate(np.concatenate(([self._computed], computed)))[1:]
        self._computed = int(computed[-1])
        found[own - first] = computed
        return found

    def result(self, run: Run) -> int | None:
        """Return the age."""
        del run
        return self._greatest
