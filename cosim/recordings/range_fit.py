"""How losses and delays depend on the range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.special
import scipy.stats
from numpy.typing import NDArray

from cosim.network import Recording

Floats = NDArray[np.float64]

LEVEL = 0.01
"""Probability with which a dependence is told where there is none."""
_STEPS = 100
_LEAST_ROWS = 20


@dataclass(frozen=True)
class RangeDependence:
    """Loss and delay over the range, or over the size of messages.

    Attributes
    ----------
    of : "range" or "size".
    least, greatest : of the range [m].
    intercept, slope : of the logit of the loss: log(p / (1 - p)) = intercept + slope range.
    slope_error : standard error of the slope; neighbours in time may be alike (sums over blocks
        of about the root of the number of messages: Liang, Zeger, Biometrika 73 (1986) 13).
    p_value : of the slope being 0.
    offset_s, speed : delay = offset + range / speed [s, m/s], by least squares; None without
        times, or where the delay does not grow, or no more than by chance.
    explained : share of the variance of the delay that this explains.
    """

    of: str
    least: float
    greatest: float
    intercept: float
    slope: float
    slope_error: float
    p_value: float
    offset_s: float | None
    speed: float | None
    explained: float | None


def range_dependence(recording: Recording) -> list[RangeDependence]:
    """Return how a recording depends on what it says of range and size, where these vary.

    Nothing where the losses are told apart by it without exception, since no slope is greatest
    then, or where nothing or everything was lost.
    """
    found = []
    for name, values in (("range", recording.range_m), ("size", recording.size)):
        ended = recording.ended
        if values is None or np.ptp(values[ended]) <= 0.0 or ended.sum() < _LEAST_ROWS:
            continue
        line = _logistic(values[ended], recording.lost[ended])
        if line is not None:
            delay = _delay_line(recording, values) if name == "range" else (None, None, None)
            low, high = float(values[ended].min()), float(values[ended].max())
            found.append(RangeDependence(name, low, high, *line, *delay))
    return found


def _logistic(x: Floats, lost: NDArray[np.bool_]) -> tuple[float, float, float, float] | None:
    """Return intercept, slope, its standard error and p-value, by maximum likelihood (Newton)."""
    middle, scale = float(x.mean()), float(x.std())
    design = np.column_stack([np.ones(x.size), (x - middle) / scale])
    if not lost.any() or lost.all():
        return None
    beta = np.array([np.log(lost.mean() / (1.0 - lost.mean())), 0.0])
    for _ in range(_STEPS):
        p = scipy.special.expit(design @ beta)
        curve = design.T @ (design * (p * (1.0 - p))[:, None])
        if np.linalg.cond(curve) > 1e10:
            return None
        move = np.linalg.solve(curve, design.T @ (lost - p))
        beta = beta + move
        if np.abs(move).max() < 1e-10:
            break
    else:
        return None
    scores = design * (lost - p)[:, None]
    length = max(1, int(np.sqrt(x.size)))
    blocks = np.add.reduceat(scores, np.arange(0, x.size, length), axis=0)
    inverse = np.linalg.inv(curve)
    error = float(np.sqrt((inverse @ (blocks.T @ blocks) @ inverse)[1, 1]))
    p_value = float(2.0 * scipy.stats.norm.sf(abs(beta[1]) / error)) if error > 0 else 0.0
    slope = float(beta[1]) / scale
    return float(beta[0]) - slope * middle, slope, error / scale, p_value


def _delay_line(
    recording: Recording, values: Floats
) -> tuple[float | None, float | None, float | None]:
    there = recording.arrived
    if recording.delay_ns is None or there.sum() < _LEAST_ROWS or np.ptp(values[there]) <= 0.0:
        return None, None, None
    delay = recording.delay_ns[there] / 1e9
    line = scipy.stats.linregress(values[there], delay)
    if line.slope <= 0.0 or line.pvalue > LEVEL:
        return None, None, None
    return float(line.intercept), float(1.0 / line.slope), float(line.rvalue**2)
