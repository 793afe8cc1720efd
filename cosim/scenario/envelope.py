"""The largest magnitudes of signals of one component over a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.gain import Problem
from cosim.scenario.measure import Fold, MeasuredRun, measure

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


Watch = Callable[[NDArray[np.int64], NDArray[np.float64]], None]
"""Is called with points [ns] and magnitudes at them, (n, names)."""


@measure
def largest_magnitudes(
    run: MeasuredRun,
    component: str,
    names: Sequence[str],
    watch: Watch | None = None,
    centres: Sequence[float] | None = None,
) -> Fold[dict[str, float]]:
    """Measure name -> largest |value|, NaN where there was one; empty without a point.

    Parameters
    ----------
    component : name of the component.
    names : its outputs or connected inputs; an `InputError` for any other, at the beginning.
    centres : what is subtracted from the values; without them nothing.
    """
    reader = run.reader(component, names, recorded=True)
    largest: NDArray[np.float64] | None = None
    while block := (yield):
        values = reader.read(block)
        magnitudes = np.abs(values if centres is None else values - np.array(centres))
        if watch is not None:
            watch(run.points_ns(block), magnitudes)
        here = magnitudes.max(axis=0)
        largest = here if largest is None else np.maximum(largest, here)
    return {} if largest is None else dict(zip(names, largest.tolist(), strict=True))
