"""Subset simulation: a small probability as a product of larger ones (Au and Beck 2001).

Two independent populations descend to the event (`descent`); the estimate is their mean. There is
an interval only if they, and an exploration from far out, agree (`search`).
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from cosim.study.rare_events import RareEstimate, Reals
from cosim.study.search import search


def subset_simulation(
    dimensions: int, samples: int, levels: int, seed: int, rough: NDArray[np.bool_] | None = None
) -> Generator[Reals, Reals, RareEstimate]:
    """Estimate a probability by subset simulation.

    samples : points of each level of both populations together, a multiple of 10.
    levels : most levels.
    rough : dimensions in which the metric is not continuous, such as seeds; every second move
        keeps them.
    """
    rng = tuple(np.random.default_rng([seed, 0, k]) for k in range(3))
    found = yield from search(rng, dimensions, samples, levels, rough)
    if found.disagreement is None:
        return found.estimate
    return found.estimate.refused(found.disagreement)
