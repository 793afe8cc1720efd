"""How the state of a run moved: its error against the set-points, and whether it grew undriven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.models import DelaySystem
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.guarantee.designed_loop import DesignedLoop, set_point_of
from cosim.scenario.measure import Measure
from cosim.scenario.performance import binding_for
from cosim.scenario.signal_reader import reader_of

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """How the state of a run moved.

    Attributes
    ----------
    errors : state, or output of the plant, with a set-point -> its last value less the set-point,
        and the unit; the trim is the set-point of what has no other.
    driven : whether a disturbance acted, or a set-point moved.
    growth : greatest error of the last quarter over that of the first; None without both.
    """

    errors: Mapping[str, tuple[float, str]]
    driven: bool
    growth: float | None


class MotionMeasure(Measure[Motion | None]):
    """The motion of a run; None of a plant that is not known.

    Parameters
    ----------
    loop : of the design.
    system : that the plant was designed as.
    seen_as : how the plant is seen as that system, where the design knows.
    """

    def __init__(
        self, loop: DesignedLoop, system: DelaySystem, seen_as: DesignedPlant | None
    ) -> None:
        self._loop, self._system, self._seen_as = loop, system, seen_as
        self._instance: ComponentInstance | None = None
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find states, set-points and disturbances."""
        by_name = {s.name: s for s in instances}
        plant, controller = by_name.get(self._loop.plant), by_name.get(self._loop.controller)
        if plant is None or controller is None:
            return
        binding = binding_for(plant, self._system, self._seen_as)
        ports = plant.component.description.ports
        if binding is None or not all(x in ports for x in binding.state.names):
            return
        self._instance, self._names = plant, list(binding.state.names)
        self._units = [ports[name].unit or "" for name in self._names]
        self._trim = np.array(binding.state.trim)
        measured = controller.component.description.ports
        given = {
            j: name
            for j, state in enumerate(self._names)
            for name in (f"reference[{j + 1}]", set_point_of(state))
            if name in measured
        }
        self._set_points = [*given]
        disturbances = [x for x in binding.disturbance.names if x in ports]
        self._plant = reader_of(plant, [*self._names, *disturbances])
        self._reference = reader_of(controller, [*given.values()])
        end = plant.comm_points.end_ns
        self._quarter_ns, self._late_ns = end // 4, end * 3 // 4
        self._first = self._last = 0.0
        self._driven = False
        self._error: Reals = np.zeros(len(self._names))
        self._before: Reals | None = None

    def add(self, first: int, last: int) -> None:
        """Take the rows at the points."""
        if self._instance is None:
            return
        rows, n = self._plant.read(first, last), len(self._names)
        error = rows[:, :n] - self._trim
        reference = self._reference.read(first, last)
        error[:, self._set_points] -= reference
        begin = reference[:1] if self._before is None else self._before
        self._before = reference[-1:].copy()
        self._driven |= bool((reference != begin).any()) or bool(rows[:, n:].any())
        self._error = error[-1].copy()
        points = self._instance.comm_points.points_ns[first:last]
        size = np.abs(error).max(axis=1)
        self._first = max(self._first, float(size[points <= self._quarter_ns].max(initial=0.0)))
        self._last = max(self._last, float(size[points >= self._late_ns].max(initial=0.0)))

    def result(self, run: Run) -> Motion | None:
        """Return the motion."""
        del run
        if self._instance is None:
            return None
        names = zip(self._names, self._error.tolist(), self._units, strict=True)
        errors = {name: (value, unit) for name, value, unit in names}
        growth = self._last / self._first if self._first > 0 and self._last > 0 else None
        return Motion(errors, self._driven, growth if growth and np.isfinite(growth) else None)
