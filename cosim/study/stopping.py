"""Sequential stopping: fly until the interval of a share or a mean is narrow enough.

It is looked at fixed numbers of runs, in the order of their numbers. Every look has the same error
a, and a share has Clopper and Pearson's exact interval (1934), a mean Student's. The interval at
the look that ends the study misses the truth with at most

    sum over the looks k of min(P(look k is narrow and misses), P(look k - 1 is not narrow)),

since a study ends at look k only if it is narrow there and was not before. For a share both terms
are sums of binomial probabilities; for the mean of normal values they follow from the independence
of mean and deviation. a is as large as the sum allows for every truth (every share; every
deviation), the last look counting as narrow: the confidence holds whether the width is reached or
not. For a mean of values that are not normal it holds as far as Student's interval does at the
first look.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, betaincinv, chdtr, chdtri, ndtr, stdtrit

from cosim.core import InputError
from cosim.study.schema import StopPart, Study

Reals = NDArray[np.float64]
GROWTH = 1.3
"""Each look has so many times the runs of the one before."""
_SHARES = 200  # for which the error is computed, even in the logarithm
_DEVIATIONS = 100
_QUANTILES = 200
_HALVINGS = 7


@dataclass(frozen=True)
class Stopping:
    """What a study that stops at a width has reached.

    Attributes
    ----------
    runs, most : runs looked at, and the number at which the study ends in any case.
    missing : how many of these have no value.
    reached : whether the interval is as narrow as asked for.
    value, low, high : share or mean, and its interval at the look that ended the study.
    width : of the interval, as asked for.
    look_confidence : level of the interval of a single look, with which that of the study is
        `confidence` over all looks.
    looks : numbers of runs at which it was looked.
    """

    metric: str
    runs: int
    most: int
    missing: int
    reached: bool
    value: float
    low: float
    high: float
    width: float
    confidence: float
    look_confidence: float
    looks: tuple[int, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        found = asdict(self)
        return {
            k: None if isinstance(v, float) and not math.isfinite(v) else v
            for k, v in found.items()
        }


def looks(first: int, most: int) -> tuple[int, ...]:
    """Return the numbers of runs at which it is looked; the last one is `most`."""
    found = []
    n = first
    while n < most:
        found.append(n)
        n = math.ceil(GROWTH * n)
    return (*found, most)


def stopping(study: Study, values: Sequence[Any], most: int) -> Stopping | None:
    """Return what is reached after the first runs, of which these are the metric's values.

    None before the first look; after it the last look that was passed counts.

    most : number of runs at which the study ends in any case.

    Raises
    ------
    InputError : the metric is neither a number nor true or false.
    """
    part = study.stop
    assert part is not None  # noqa: S101 - the caller asked
    all_looks = looks(part.first, most)
    passed = tuple(n for n in all_looks if n <= len(values))
    if not passed:
        return None
    mine = values[: passed[-1]]
    known = [v for v in mine if v is not None]
    if any(isinstance(v, str) for v in known):
        raise InputError(
            "a text has neither share nor mean",
            where=f"stop.metric = {part.metric}",
            expected="a number, or true and false",
            got=repr(next(v for v in known if isinstance(v, str))),
            hint="give the metric equals = '...'",
        )
    asked = all(isinstance(v, bool) for v in known)
    x = np.array(known, np.float64)
    x = x[np.isfinite(x)]
    error = look_error(all_looks, part, asked)
    value, low, high = (exact_interval if asked else _student)(x, error)
    return Stopping(
        metric=part.metric,
        runs=passed[-1],
        most=most,
        missing=len(mine) - x.size,
        reached=high - low <= part.width,
        value=value,
        low=low,
        high=high,
        width=part.width,
        confidence=part.confidence,
        look_confidence=1.0 - error,
        looks=passed,
    )


def exact_interval(x: Reals, error: float) -> tuple[float, float, float]:
    """Return the share of ones in x, and Clopper and Pearson's interval for it."""
    if x.size == 0:
        return math.nan, 0.0, 1.0
    count = int(x.sum())
    low, high = _clopper_pearson(count, x.size, error)
    return count / x.size, low, high


def _student(x: Reals, error: float) -> tuple[float, float, float]:
    if x.size < 2:
        return math.nan, -math.inf, math.inf
    mean = float(x.mean())
    half = -float(stdtrit(x.size - 1, 0.5 * error)) * float(x.std(ddof=1)) / math.sqrt(x.size)
    return mean, mean - half, mean + half


def _clopper_pearson(count: int, of: int, error: float) -> tuple[float, float]:
    low = float(betaincinv(count, of - count + 1, 0.5 * error)) if count else 0.0
    high = float(betaincinv(count + 1, of - count, 1.0 - 0.5 * error)) if count < of else 1.0
    return low, high


@lru_cache(maxsize=64)
def look_error(all_looks: tuple[int, ...], part: StopPart, asked: bool) -> float:  # noqa: FBT001
    """Return the error of every look with which that of the study is 1 - confidence at most.

    asked : whether the metric is true or false.
    """
    whole = 1.0 - part.confidence
    worst = _worst_share(all_looks, part.width) if asked else _worst_mean(all_looks)
    low, high = whole / len(all_looks), whole  # the sum of all looks; one look
    if worst(high) <= whole:
        return high
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if worst(middle) <= whole else (low, middle)
    return low


def _sum_of_looks(narrow_and_missed: Sequence[Reals], not_narrow: Sequence[Reals]) -> float:
    """Return the sum of the module's docstring for the truth for which it is largest."""
    before = [np.ones_like(not_narrow[0]), *not_narrow]
    pairs = zip(narrow_and_missed, before, strict=False)
    return float(sum(np.minimum(m, b) for m, b in pairs).max())


def _worst_share(all_looks: tuple[int, ...], width: float) -> Callable[[float], float]:
    p = np.geomspace(0.1 / all_looks[-1], 0.5, _SHARES)  # the others by symmetry

    def worst(error: float) -> float:
        missed, not_narrow = [], []
        for n in all_looks:
            last = _narrow_to(n, error, width) if n < all_looks[-1] else n
            below, above = _missing_counts(n, p, error)
            # narrow: 0 ... last, and n - last ... n
            upper = np.minimum(below, last)
            lower = np.maximum(above, n - last)
            found = _cdf(upper, n, p) + 1.0 - _cdf(lower - 1, n, p)
            if last < n / 2:
                found += np.maximum(0.0, _cdf(below, n, p) - _cdf(n - last - 1, n, p))
                found += np.maximum(0.0, _cdf(np.full_like(p, last), n, p) - _cdf(above - 1, n, p))
                still = _cdf(n - last - 1, n, p) - _cdf(last, n, p)
            else:
                found = _cdf(below, n, p) + 1.0 - _cdf(above - 1, n, p)
                still = np.zeros_like(p)
            missed.append(found)
            not_narrow.append(still)
        return _sum_of_looks(missed, not_narrow)

    return worst


def _narrow_to(n: int, error: float, width: float) -> int:
    """Return the largest count up to n / 2 with an interval narrow enough; n if all are; -1."""

    def narrow(count: int) -> bool:
        low, high = _clopper_pearson(count, n, error)
        return high - low <= width

    if narrow(n // 2):
        return n
    low, high = -1, n // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if narrow(middle) else (low, middle)
    return low


def _missing_counts(n: int, p: Reals, error: float) -> tuple[Reals, Reals]:
    """Return up to which count, and from which on, the interval of a look does not contain p."""
    from scipy.stats import binom  # noqa: PLC0415 - loading it takes half a second

    below = np.asarray(binom.ppf(0.5 * error, n, p) - 1.0, np.float64)
    above = np.asarray(binom.isf(0.5 * error, n, p) + 1.0, np.float64)
    return below, above


def _cdf(count: Any, n: int, p: Reals) -> Reals:
    count = np.broadcast_to(np.asarray(count, np.float64), p.shape)
    found: Reals = np.where(count < 0, 0.0, bdtr(np.clip(count, 0, n), n, p))
    return found


def _worst_mean(all_looks: tuple[int, ...]) -> Callable[[float], float]:
    q = (np.arange(_QUANTILES) + 0.5) / _QUANTILES
    # deviations in half widths: from those that are narrow at the first look to the last one
    sigma = np.sqrt(np.geomspace(0.02 * all_looks[0], all_looks[-1], _DEVIATIONS))
    u = {n: np.sqrt(chdtri(n - 1, 1.0 - q) / (n - 1)) for n in all_looks}  # s / sigma

    def worst(error: float) -> float:
        missed, not_narrow = [], []
        for n in all_looks:
            t = -float(stdtrit(n - 1, 0.5 * error))
            limit = math.sqrt(n) / (t * sigma)  # of s / sigma, for a narrow interval
            if n == all_looks[-1]:
                limit = np.full_like(sigma, np.inf)
            each = 2.0 * ndtr(-t * u[n]) / _QUANTILES
            missed.append(np.interp(limit, u[n], np.cumsum(each), left=0.0))
            not_narrow.append(1.0 - chdtr(n - 1, (n - 1) * np.minimum(limit, 1e6) ** 2))
        return _sum_of_looks(missed, not_narrow)

    return worst
