"""The largest magnitudes of signals of one component over a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run
from cosim.scenario.gain import Problem
from cosim.scenario.measure import Measure
from cosim.scenario.signal_reader import SignalReader

ENVELOPE = {"u": "nu.u", "v": "nu.v", "w": "nu.w", "r": "nu.r", "psi": "eta.psi"}
"""Axis of the envelope of a vehicle -> the signal that it bounds."""


def envelope_bounds(problem: Problem) -> dict[str, tuple[str, float]]:
    """Return by axis the variable that the envelope bounds, and the bound."""
    if problem.plant is not None:
        return {name: (name, bound) for name, (_, bound) in problem.plant.envelope.items()}
    if problem.vehicle is None:
        return {}
    envelope = problem.vehicle.envelope
    return {axis: (name, getattr(envelope, axis)) for axis, name in ENVELOPE.items()}


class LargestMagnitudes(Measure[dict[str, float]]):
    """Name -> largest |value| over the run, NaN where there was one; empty without a point.

    Parameters
    ----------
    component : name of the component.
    names : its outputs or connected inputs; `begin` raises an `InputError` for any other.
    watch : is called with points [ns] and the magnitudes at them, (n, names).
    centres : what is subtracted from the values; without them nothing.
    """

    def __init__(
        self,
        component: str,
        names: Sequence[str],
        watch: Callable[[NDArray[np.int64], NDArray[np.float64]], None] | None = None,
        centres: Sequence[float] | None = None,
    ) -> None:
        self._component, self._names, self._watch = component, names, watch
        self._centres = None if centres is None else np.array(centres)
        self._largest: NDArray[np.float64] | None = None

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the signals."""
        instance = next(s for s in instances if s.name == self._component)
        self._instance = instance
        self._reader = SignalReader(instance, self._names)
        self.reads_inputs = self._reader.reads_inputs

    def add(self, first: int, last: int) -> None:
        """Compare with the values at the points."""
        values = self._reader.read(first, last)
        magnitudes = np.abs(values if self._centres is None else values - self._centres)
        if self._watch is not None:
            self._watch(self._instance.comm_points.points_ns[first:last], magnitudes)
        here = magnitudes.max(axis=0)
        self._largest = here if self._largest is None else np.maximum(self._largest, here)

    def result(self, run: Run) -> dict[str, float]:
        """Return the largest magnitudes."""
        del run
        values = [] if self._largest is None else self._largest.tolist()
        return dict(zip(self._names, values, strict=False))
