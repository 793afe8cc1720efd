"""How the estimate of a mean or share settles as more draws are taken.

What is drawn at once stands together: all runs of one sampled point, or of one replicate, over
the whole grid, are one draw with one mean. Draws are independent, runs of one draw are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.study.columns import Column, StudyColumns
from cosim.study.intervals import student, wilson

Reals = NDArray[np.float64]
_MOST_POINTS = 200


@dataclass(frozen=True)
class Convergence:
    """The estimate from the first draws.

    Attributes
    ----------
    draws : number of draws, increasing, (k,).
    mean, low, high : the estimate and its interval, (k,); NaN ends where there is none.
    method : of the interval, in words.
    """

    draws: NDArray[np.int64]
    mean: Reals
    low: Reals
    high: Reals
    method: str


def convergence_of(
    columns: StudyColumns, metric: Column, confidence: float = 0.95
) -> Convergence | None:
    """Return the running mean over the draws; None where nothing is drawn, or no run has it."""
    if columns.draws is None or metric.kind == "text" or not metric.known.any():
        return None
    draws, values = columns.draws[metric.known], metric.values[metric.known]
    number = np.bincount(draws)
    means = (np.bincount(draws, values) / np.maximum(number, 1))[number > 0]
    n = np.arange(1.0, means.size + 1)
    mean = np.cumsum(means) / n
    if metric.kind == "truth" and np.isin(means, (0.0, 1.0)).all():
        low, high = wilson(mean, n, confidence)
        method = "Wilson"
    else:
        centred = means - means[0]  # the sum of squares of large values with little spread is lost
        total = np.cumsum(centred)
        variance = np.cumsum(centred**2) - total**2 / n
        variance = np.maximum(variance, 0.0) / np.maximum(n - 1.0, 1.0)
        low, high = student(mean, variance, n, confidence)
        if metric.kind == "truth":
            low, high = np.maximum(low, 0.0), np.minimum(high, 1.0)
        method = "Student's t"
    kept = np.unique(np.geomspace(1, means.size, _MOST_POINTS).astype(np.int64))
    kept = np.unique([*kept, means.size]) - 1
    return Convergence(kept + 1, mean[kept], low[kept], high[kept], method)
