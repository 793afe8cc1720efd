"""What a recording tells of the parameters of a model of losses, and what it does not.

A probability has an interval from the standard error of its logit, so that it stays between 0 and
1; one that is estimated as 0 or 1 has one on the other side. A recording does not tell a parameter
if the interval contains nearly every probability, if another parameter can make up for it, or if
the model explains no more than one with fewer states does, by chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_CONFIDENCE = 1.96
_TOO_WIDE = 3.0
"""Half the interval of a logit that tells nothing: odds known to a factor of twenty each way."""
_TOO_LONG = 0.5
"""Length of the interval of what is estimated as 0 or 1 that tells nothing."""


@dataclass(frozen=True)
class Parameter:
    """A fitted probability.

    Attributes
    ----------
    name : as in a link's `loss` where it has the name there.
    value : of greatest likelihood.
    low, high : 95 % interval; None where the model gives the value, or the data do not tell it.
    identified : whether the data tell it.
    """

    name: str
    value: float
    low: float | None
    high: float | None
    identified: bool


def parameter(name: str, value: float, error: float) -> Parameter:
    """Return a parameter with its interval.

    error : standard error; NaN of a value that the model gives, infinite of one that the data
        cannot tell.
    """
    if math.isnan(error):
        return Parameter(name, value, None, None, identified=True)
    half = _CONFIDENCE * error
    if value in (0.0, 1.0):
        if half > _TOO_LONG:
            return Parameter(name, value, None, None, identified=False)
        return Parameter(
            name, value, max(0.0, value - half), min(1.0, value + half), identified=True
        )
    half /= value * (1.0 - value)
    if half > _TOO_WIDE:
        return Parameter(name, value, None, None, identified=False)
    odds = value / (1.0 - value)
    low, high = odds * math.exp(-half), odds * math.exp(half)
    return Parameter(name, value, low / (1.0 + low), high / (1.0 + high), identified=True)


def share_error(count: float, of: float) -> float:
    """Return the standard error of a share.

    Where all or none are counted it is that of the exact interval (Clopper and Pearson).
    """
    if of <= 0.0:
        return math.inf
    if 0.0 < count < of:
        share = count / of
        return math.sqrt(share * (1.0 - share) / of)
    return float(1.0 - 0.025 ** (1.0 / of)) / _CONFIDENCE
