"""Measurement age: time since the measurement behind the command in force was taken.

A design "for any age up to d" is about this age. It includes the link to the controller, the
wait for its sample instant and its communication step, the step that the coupling adds, the
link back, and the hold until the next command arrives.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import Algorithm, ComponentInstance, Route, Run
from cosim.scenario.measure import Measure, Recent, after, sample_period_ns

Integers = NDArray[np.int64]
NONE_IN_USE = -1


class MeasuredAges(NamedTuple):
    """Ages of the measurements behind the commands in force, over a run.

    Attributes
    ----------
    least_ns, greatest_ns : over all instants [ns].
    in_use_ns : least and greatest age at the instants at which a measurement comes into use [ns].
        The measurement of t = 0 counts neither here nor for the least age: it stands for all
        before it, since the state is constant there. None where no other came into use.
    first_ns : the first of these instants [ns].
    alike : of parallel links, the measurements in use were always equally old.
    interrupted : after the first one, there was a time without a measurement in use.
    """

    least_ns: int | None
    greatest_ns: int
    in_use_ns: tuple[int, int] | None
    first_ns: int
    alike: bool
    interrupted: bool = False


class AgeMeasure(Measure[MeasuredAges | None]):
    """The measurement ages over the run; None if no measurement came into use.

    Intervals in which no measurement is in use yet, or a link's substitute replaces it, do not
    count. Of several parallel links, the oldest measurement counts for every age but the least.

    Parameters
    ----------
    watch : is called with points [ns] and the age at the end of the interval before each [ns];
        -1 where no measurement was in use.
    states : inputs of the controller whose ages are measured; None: of all.
    """

    def __init__(
        self,
        plant: str,
        controller: str,
        algorithm: Algorithm = "jacobi",
        watch: Callable[[Integers, Integers], None] | None = None,
        states: Collection[str] | None = None,
    ) -> None:
        self._plant, self._controller, self._algorithm = plant, controller, algorithm
        self._states = states
        self._watch = watch
        self._paths: list[_Path] = []
        self._points: Integers | None = None
        self._found: MeasuredAges | None = None
        self._taken = NONE_IN_USE  # when the measurement in use was taken

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the ways from the plant to the controller and back."""
        by_name = {s.name: s for s in instances}
        if self._plant not in by_name or self._controller not in by_name:
            return
        plant, controller = by_name[self._plant], by_name[self._controller]
        down = [r for r in plant.routes if r.source == self._controller]
        up = [
            r for r in controller.routes if r.source == self._plant and self._tells(controller, r)
        ]
        for back in down:
            at_once = self._algorithm == "jacobi" and _feedthrough(controller, back)
            self._paths += [_Path(controller, forth, back, at_once=at_once) for forth in up]
        self._instance = controller

    def _tells(self, controller: ComponentInstance, route: Route) -> bool:
        """Whether a route brings one of the states."""
        first, columns = controller.input_column, controller.input_columns
        names = {columns[k - first].name for k in route.targets.tolist()}
        return self._states is None or not names.isdisjoint(self._states)

    def add(self, first: int, last: int) -> None:
        """Take the intervals that end at the points."""
        if not self._paths:
            return
        points = after(self._points, self._instance.comm_points.points_ns[first:last])
        self._points = points[-1:].copy()
        taken = np.stack([path.add(first, last) for path in self._paths])[:, :-1]
        there = (taken >= 0).all(axis=0)
        oldest = np.where(there, taken.min(axis=0, initial=points[-1]), NONE_IN_USE)
        newest = taken.max(axis=0, initial=NONE_IN_USE)
        if self._watch is not None and there.size:
            self._watch(points[1:], np.where(there, points[1:] - oldest, NONE_IN_USE))
        before = np.concatenate(([self._taken], oldest))[:-1]
        self._taken = int(oldest[-1]) if oldest.size else self._taken
        known = self._found
        if known is not None and not there.all():
            self._found = known = known._replace(interrupted=True)
        if not there.any():
            return
        comes = (points[:-1] - oldest)[(oldest > 0) & (oldest != before)].tolist()
        young = (points[:-1] - newest)[oldest > 0].tolist()
        oldest_age = int((points[1:] - oldest)[there].max())
        if known is not None:
            comes += known.in_use_ns or ()
            young += () if known.least_ns is None else (known.least_ns,)
        self._found = MeasuredAges(
            least_ns=min(young, default=None),
            greatest_ns=max(oldest_age, known.greatest_ns if known else 0),
            in_use_ns=(min(comes), max(comes)) if comes else None,
            first_ns=known.first_ns if known else int(points[:-1][there][0]),
            alike=bool((oldest == newest)[there].all()) and (known is None or known.alike),
            interrupted=known.interrupted if known else _is_interrupted(np.asarray(there)),
        )

    def result(self, run: Run) -> MeasuredAges | None:
        """Return the ages."""
        del run
        return self._found


def _is_interrupted(there: NDArray[np.bool_]) -> bool:
    """Whether there is a time without a measurement after the first one."""
    return bool(np.count_nonzero(there) < there.size - int(np.argmax(there)))


def _feedthrough(controller: ComponentInstance, back: Route) -> bool:
    """Whether all commands on this route are known to depend on inputs of the same point."""
    first = min(
        group.column
        for group in (*controller.outputs_without_feedthrough, *controller.outputs_with_feedthrough)
    )
    ports = [controller.output_columns[int(c) - first].port for c in back.columns]
    return all(port.feedthrough and port.feedthrough_declared for port in ports)


class _Path:
    """The way of a measurement over one route to the controller and one back to the plant."""

    def __init__(
        self, controller: ComponentInstance, forth: Route, back: Route, *, at_once: bool
    ) -> None:
        self._controller = controller
        self._computed = None if at_once else _Computed(controller)
        self._received, self._commanded = Lookup(forth), Lookup(back)
        self._recent = Recent()

    def add(self, first: int, last: int) -> Integers:
        """Return when the measurement behind the plant's input was taken, as `Lookup.add`."""
        points = self._controller.comm_points.points_ns
        received = self._received.add(first, last, points)
        if self._computed is None:
            behind = received[-(last - first) :]
        else:
            behind = self._computed.add(first, last, received)
        self._recent.add(behind, self._controller)
        return self._commanded.add(first, last, self._recent)


class Lookup:
    """What the rows that a route reads have in a table of instants [ns]."""

    def __init__(self, route: Route) -> None:
        self._route = route
        self._before: Integers | None = None
        self._awaited = False

    def add(self, first: int, last: int, table: Integers | Recent) -> Integers:
        """Return the instants of the rows read from the point before the first to the last.

        -1 where none is read. The first block has no point before it. A receiver that steps after
        its sender reads the row of the next point: that of the last point is -1, and is the right
        one in the next block.
        """
        row = self._route.in_step.row[first:last]
        there = (row >= 0) & (row < last)
        found = np.full(last - first, NONE_IN_USE, np.int64)
        found[there] = table[row[there]]
        if self._awaited:
            self._before = table[np.array([first])]
        found = after(self._before, found)
        self._before, self._awaited = found[-1:].copy(), bool(row[-1] >= last)
        return found


class _Computed:
    """When the measurement behind the outputs of a sampled controller was taken.

    Results of a step appear at its end; only steps that contain a sample instant use inputs.
    """

    def __init__(self, controller: ComponentInstance) -> None:
        self._controller = controller
        self._period = sample_period_ns(controller.component)
        self._own = -1
        self._begun: Integers | None = None
        self._received: Integers | None = None
        self._behind = np.array([NONE_IN_USE])

    def add(self, first: int, last: int, received: Integers) -> Integers:
        """Return it for each row of the block [ns]; -1: none, or not the controller's own point.

        `received` : when what the controller received was taken, as of `Lookup.add`.
        """
        own = self._controller.own_points.own_between(first, last)
        if 0 <= self._own == first - 1:
            self._received = received[:1].copy()
        behind = np.full(last - first, NONE_IN_USE, np.int64)
        if not own.size:
            return behind
        inputs = after(self._received, received[-(last - first) :][own - first])
        times = after(self._begun, self._controller.comm_points.points_ns[own])
        begins, ends = times[:-1], times[1:]
        place = np.arange(1, times.size)
        if self._period > 0:
            # a step samples when it contains a multiple of the period
            multiple = -(-begins // self._period) * self._period
            place = np.maximum.accumulate(np.where(multiple < ends, place, 0))
        results = np.concatenate((self._behind, inputs))[place]
        behind[own[own.size - results.size :] - first] = results
        self._own, self._begun, self._received = int(own[-1]), times[-1:].copy(), inputs[-1:].copy()
        self._behind = np.concatenate((self._behind, results))[-1:]
        return behind
