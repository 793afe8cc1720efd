"""The delays that a link can have, fitted to one part of a recording and tested on the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize
import scipy.stats
from numpy.typing import NDArray

from cosim.recordings.statistics import correlation

Floats = NDArray[np.float64]

LEVEL = 0.01
"""Probability with which delays that a model made are refused for it, over both statistics."""
_SHIFT, _FOLLOW = "Kolmogorov-Smirnov", "correlation of each delay with the next"


@dataclass(frozen=True)
class DelayModel:
    """A model of delays and how it fits.

    Attributes
    ----------
    name : "constant", "uniform", "exponential" or "normal".
    delay : the least delay [s].
    width, mean, sigma : of the jitter [s], as `cosim.network.Jitter` has them; 0 where it has none.
    parameters : how many were fitted.
    log_likelihood : natural logarithm of the density per message [1/s], of the part it was fitted
        to; infinite where all delays are equal.
    distance : greatest difference of the distributions of the other part and the model
        (Kolmogorov-Smirnov).
    p_values : of each statistic of the other part, as those of `LossModel`.
    """

    name: str
    delay: float
    width: float
    mean: float
    sigma: float
    parameters: int
    log_likelihood: float
    distance: float
    p_values: dict[str, float]

    @property
    def refused_by(self) -> list[str]:
        """The statistics that refuse the model, the clearest first."""
        refusing = [name for name, p in self.p_values.items() if p < LEVEL / 2]
        return sorted(refusing, key=lambda name: self.p_values[name])


def delay_models(first: Floats, tested: Floats) -> list[DelayModel]:
    """Fit every kind of jitter by maximum likelihood; both parts have at least two delays [s]."""
    least, most = float(first.min()), float(first.max())
    if least == most:
        return [_judged("constant", (least, 0.0, 0.0, 0.0), 1, np.inf, first, tested)]
    extra = first - least
    middle = float(extra.mean())
    mean, sigma, normal = _half_normal(extra)
    spread = float(np.log(most - least))
    return [
        _judged("uniform", (least, most - least, 0.0, 0.0), 2, -spread, first, tested),
        _judged("exponential", (least, 0.0, middle, 0.0), 2, -np.log(middle) - 1.0, first, tested),
        _judged("normal", (least, 0.0, mean, sigma), 3, normal, first, tested),
    ]


def _half_normal(extra: Floats) -> tuple[float, float, float]:
    """Return mean, standard deviation and log-likelihood of a normal that is cut off below 0."""
    scale = float(extra.std())

    def value(x: Floats) -> float:
        mean, sigma = x[0] * scale, float(np.exp(x[1])) * scale
        inside = scipy.stats.norm.logcdf(mean / sigma)
        return -float((scipy.stats.norm.logpdf(extra, mean, sigma) - inside).mean())

    start = np.array([float(extra.mean()) / scale, 0.0])
    # the mean of a link's jitter, before it is cut off, is not negative
    bounds = [(0.0, None), (-8.0, 8.0)]
    found = scipy.optimize.minimize(value, start, method="L-BFGS-B", bounds=bounds)
    return found.x[0] * scale, float(np.exp(found.x[1])) * scale, -float(found.fun)


def _judged(
    name: str,
    values: tuple[float, float, float, float],
    parameters: int,
    log_likelihood: float,
    first: Floats,
    tested: Floats,
) -> DelayModel:
    delay, width, mean, sigma = values
    ordered = np.sort(tested)
    below = _distribution(name, ordered - delay, width, mean, sigma)
    # a constant delay jumps: just before it the model has nothing yet
    just_below = np.where(ordered <= delay, 0.0, below) if name == "constant" else below
    steps = np.arange(ordered.size + 1) / ordered.size
    distance = float(max((steps[1:] - below).max(), (just_below - steps[:-1]).max(), 0.0))
    # the parameters come from a sample as well: as the difference of two samples
    number = first.size * tested.size / (first.size + tested.size)
    follow = correlation(tested)
    near = 1.0 if follow is None else 2.0 * scipy.stats.norm.sf(abs(follow) * np.sqrt(ordered.size))
    return DelayModel(
        name,
        *values,
        parameters,
        float(log_likelihood),
        distance,
        {
            _SHIFT: float(scipy.stats.kstwobign.sf(np.sqrt(number) * distance)),
            _FOLLOW: float(near),
        },
    )


def _distribution(name: str, extra: Floats, width: float, mean: float, sigma: float) -> Floats:
    """Return the share of jitter up to each value."""
    if name == "constant":
        return np.where(extra >= 0.0, 1.0, 0.0)
    extra = np.maximum(extra, 0.0)
    if name == "uniform":
        return np.minimum(extra / width, 1.0)
    if name == "exponential":
        return -np.expm1(-extra / mean)
    cut = scipy.stats.norm.cdf(-mean / sigma)
    return np.asarray((scipy.stats.norm.cdf((extra - mean) / sigma) - cut) / (1.0 - cut))
