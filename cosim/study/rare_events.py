"""Probabilities of rare events: what an estimator asks for and what it finds.

An estimator is a generator. It yields points of independent standard normal numbers, (points,
dimensions), is sent by how much the metric of each is beyond its bound, (points,), and returns a
`RareEstimate`. Who evaluates the points does not matter to it: a study, or a function in a test.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Evaluations = Generator[Reals, Reals, Any]


@dataclass(frozen=True)
class Level:
    """One level of subset simulation.

    Attributes
    ----------
    beyond : by how much the metric is beyond its bound in the event of this level; 0 in the last.
    share : of the points of this level that are in the event.
    acceptance : share of accepted moves of the chains; None in the first level.
    correlation : by how much chains increase the variance of the share: 0 for independent points.
    deviation : relative standard deviation of the share.
    """

    beyond: float
    share: float
    acceptance: float | None
    correlation: float
    deviation: float


@dataclass(frozen=True)
class RareEstimate:
    """The estimate of a small probability.

    Attributes
    ----------
    probability : None if there is no estimate; `reason` says why.
    deviation : its coefficient of variation, chains included.
    logarithm : centre of the interval of the logarithm.
    freedom : degrees of freedom of the interval: independent families of chains, or the effective
        sample size, less one.
    levels : of the subset simulation, or of the pilot; those of the population with more.
    effective : effective sample size, for importance sampling.
    reason : why there is no estimate.
    populations : what each of the independent populations found.
    exploration : what an exploration from far out found; None where there was none.
    regions : of the event that do not hang together; None where nothing tells.
    """

    probability: float | None
    deviation: float | None
    logarithm: float
    freedom: float
    levels: tuple[Level, ...]
    effective: float | None = None
    reason: str | None = None
    populations: tuple[float, ...] = ()
    exploration: float | None = None
    regions: int | None = None

    def refused(self, reason: str) -> RareEstimate:
        """Return this without an estimate, and why."""
        return replace(self, probability=None, deviation=None, reason=reason)

    def interval(self, confidence: float) -> tuple[float, float]:
        """Return the interval of the probability: Student's, of its logarithm."""
        from scipy import stats  # noqa: PLC0415 - loading it takes half a second

        if self.deviation is None:
            return 0.0, 1.0
        half = float(stats.t.ppf(0.5 + 0.5 * confidence, self.freedom)) * self.deviation
        return math.exp(self.logarithm - half), math.exp(min(self.logarithm + half, 0.0))

    def to_json(self, confidence: float) -> dict[str, Any]:
        """Return the object that `--json` prints; `effective` as `effective_samples`."""
        low, high = self.interval(confidence)
        known = self.probability is not None
        return {
            "probability": self.probability,
            "low": low if known else None,
            "high": high if known else None,
            "confidence": confidence,
            "deviation": self.deviation,
            "effective_samples": self.effective,
            "reason": self.reason,
            "populations": list(self.populations),
            "exploration": self.exploration,
            "regions": self.regions,
            "levels": [
                {k: v if v is None or math.isfinite(v) else None for k, v in asdict(level).items()}
                for level in self.levels
            ],
        }


def estimated(evaluations: Evaluations, function: Callable[[Reals], Reals]) -> RareEstimate:
    """Return the estimate of an estimator whose points are evaluated by a function."""
    try:
        points = next(evaluations)
        while True:
            points = evaluations.send(function(points))
    except StopIteration as end:
        found: RareEstimate = end.value
        return found
