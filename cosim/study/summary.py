"""Shares and means of a table of runs, each with its confidence interval, per group.

Intervals of shares are Wilson's for a binomial proportion (1927); those of means are Student's t,
or the bias-corrected bootstrap (Efron 1987) for values far from normal; those of quantiles are
between two of the values, so many of them being smaller as the binomial distribution has it: they
hold for any distribution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.study.schema import GridAxis, Study

_MOST_GROUPS = 40
_MOST_WORDS = 12
_RESAMPLES = 2000


@dataclass(frozen=True)
class Group:
    """Runs with the same values of some axes.

    Attributes
    ----------
    where : axis -> value; empty for all runs together.
    runs : number of runs.
    shares, numbers : by metric, or by metric and value.
    """

    where: dict[str, Any]
    runs: int
    shares: dict[str, Share]
    numbers: dict[str, Numbers]


@dataclass(frozen=True)
class Share:
    """Number and share of runs with a property, and an interval for its probability.

    low, high : None for one run, and where the runs are of several points of a grid.
    """

    count: int
    of: int
    share: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Quantile:
    """The value below which this share of the runs is, and an interval for it.

    low, high : None where there are too few runs for an end of the interval.
    """

    share: float
    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Numbers:
    """Statistics of a metric over runs; `missing` runs had no finite value.

    low, high : interval for the mean; None for fewer than two values, and where the runs are of
        several points of a grid.
    """

    count: int
    missing: int
    mean: float | None
    low: float | None
    high: float | None
    deviation: float | None
    minimum: float | None
    median: float | None
    maximum: float | None
    quantiles: tuple[Quantile, ...] = ()


@dataclass(frozen=True)
class Summary:
    """The summary of a table.

    Attributes
    ----------
    runs, count : number of runs in the table, and in the study.
    by : the axes that form the groups.
    method : method of the intervals of means.
    mixed : grid axes of which groups have several values. These were chosen, not drawn: such
        groups have no intervals, nor has a single run.
    """

    title: str
    runs: int
    count: int
    by: tuple[str, ...]
    confidence: float
    method: str
    groups: tuple[Group, ...]
    mixed: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return {**asdict(self), "complete": self.runs == self.count}


def summarise(
    table: Any,
    manifest: dict[str, Any],
    by: Sequence[str] | None = None,
    *,
    confidence: float = 0.95,
    bootstrap: bool = False,
    quantiles: Sequence[float] = (),
) -> Summary:
    """Summarise a table of results (`read_table`).

        >>> from cosim import DelaySystem, Scenario, sweep
        >>> from cosim.study import read_table, summarise
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> rates = {"components.lag.parameters.A[1,1]": [-1.0, -2.0]}
        >>> frame = sweep(lag, rates, {"x": "final.lag.x[1]"}, out="lags")
        >>> summary = summarise(*read_table("lags"))
        >>> summary.by, [round(group.numbers["x"].mean, 3) for group in summary.groups]
        (('components_lag_parameters_A_1_1',), [0.135, 0.368])

    Parameters
    ----------
    by : axes to group by; None for the grid axes, if they give few groups.
    quantiles : the quantiles of the metrics to compute, such as 0.95.

    Raises
    ------
    InputError : no such axis, or a confidence or quantile that is not between 0 and 1.
    """
    for what, given in (("confidence level", confidence), *(("quantile", q) for q in quantiles)):
        if not 0.0 < given < 1.0:
            raise InputError(
                f"not a {what}", where=what.split()[0], expected="0 < p < 1", got=str(given)
            )
    interval = _Intervals(confidence, bootstrap, tuple(quantiles))
    study = Study.model_validate(manifest["study"])
    frame = table.to_pandas()
    axes = [axis.column for axis in study.vary]
    for name in by or ():
        if name not in axes:
            raise InputError.unknown("axis", name, axes, where="by")
    chosen = list(by) if by is not None else _usual(study, frame)
    mixed = tuple(
        axis.column
        for axis in study.vary
        if isinstance(axis, GridAxis) and axis.column not in chosen and _varies(frame[axis.column])
    )
    groups = []
    if chosen:
        for key, part in frame.groupby(chosen, sort=True, dropna=False):
            where = dict(zip(chosen, key, strict=True))
            groups.append(_group(where, part, study, interval))
    else:
        groups.append(_group({}, frame, study, interval))
    return Summary(
        title=study.title,
        runs=len(frame),
        count=int(manifest["count"]),
        by=tuple(chosen),
        confidence=confidence,
        method="bootstrap" if bootstrap else "t",
        groups=tuple(
            _without_intervals(group) if mixed or group.runs == 1 else group for group in groups
        ),
        mixed=mixed,
    )


def _varies(column: Any) -> bool:
    return bool(column.nunique(dropna=False) > 1)


def _without_intervals(group: Group) -> Group:
    """Return a group without the intervals, which chosen values, or one run, make meaningless."""
    none: dict[str, Any] = {"low": None, "high": None}
    numbers = {
        name: replace(found, **none, quantiles=tuple(replace(q, **none) for q in found.quantiles))
        for name, found in group.numbers.items()
    }
    shares = {name: replace(found, **none) for name, found in group.shares.items()}
    return replace(group, shares=shares, numbers=numbers)


def _usual(study: Study, frame: Any) -> list[str]:
    grids = [axis.column for axis in study.vary if isinstance(axis, GridAxis)]
    if not grids:
        return []
    return grids if frame.groupby(grids, dropna=False).ngroups <= _MOST_GROUPS else []


class _Intervals(NamedTuple):
    confidence: float
    bootstrap: bool
    quantiles: tuple[float, ...]


def _group(where: dict[str, Any], frame: Any, study: Study, intervals: _Intervals) -> Group:
    shares: dict[str, Share] = {}
    numbers: dict[str, Numbers] = {}
    for name in ("status", *study.metrics):
        column = frame[name]
        values = [v for v in column.tolist() if v is not None and v == v]  # noqa: PLR0124 - no NaN
        if values and all(isinstance(v, bool) for v in values):
            shares[name] = share(sum(values), len(values), intervals.confidence)
        elif any(isinstance(v, str) for v in values):
            words = sorted(set(values))
            for word in words if len(words) <= _MOST_WORDS else ():
                found = share(values.count(word), len(values), intervals.confidence)
                shares[f"{name} = {word}"] = found
        else:
            numbers[name] = mean_of(values, len(column), *intervals)
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in where.items()}
    return Group(plain, len(frame), shares, numbers)


def share(count: int, of: int, confidence: float = 0.95) -> Share:
    """Return the share `count` / `of` with Wilson's interval."""
    from scipy import stats  # noqa: PLC0415 - loading it takes half a second

    found = stats.binomtest(count, of).proportion_ci(confidence, method="wilson")
    return Share(count, of, count / of, float(found.low), float(found.high))


def mean_of(
    values: Sequence[float],
    total: int,
    confidence: float = 0.95,
    bootstrap: bool = False,  # noqa: FBT001, FBT002 - as in the tuple of its callers
    quantiles: Sequence[float] = (),
) -> Numbers:
    """Return the statistics of the finite `values`, out of `total` runs."""
    x = np.array([float(v) for v in values])
    x = x[np.isfinite(x)]
    if x.size == 0:
        return Numbers(0, total, None, None, None, None, None, None, None)
    low, high = _interval(x, confidence, bootstrap=bootstrap)
    return Numbers(
        count=x.size,
        missing=total - x.size,
        mean=float(x.mean()),
        low=low,
        high=high,
        deviation=float(x.std(ddof=1)) if x.size > 1 else None,
        minimum=float(x.min()),
        median=float(np.median(x)),
        maximum=float(x.max()),
        quantiles=tuple(quantile_of(x, q, confidence) for q in quantiles),
    )


def quantile_of(values: Sequence[float], share: float, confidence: float = 0.95) -> Quantile:
    """Return the quantile of values, and an interval that holds for any distribution."""
    from scipy import stats  # noqa: PLC0415 - loading it takes half a second

    x = np.sort(np.asarray(values, np.float64))
    # the r-th value is below the quantile if at least r of n runs are: a binomial number
    tail = 0.5 - 0.5 * confidence
    smaller = stats.binom(x.size, share)
    low, high = int(smaller.ppf(tail)), int(smaller.ppf(1.0 - tail)) + 1
    return Quantile(
        share,
        float(np.quantile(x, share)),
        float(x[low - 1]) if low >= 1 else None,
        float(x[high - 1]) if high <= x.size else None,
    )


def _interval(
    x: NDArray[np.float64], confidence: float, *, bootstrap: bool
) -> tuple[float | None, float | None]:
    from scipy import stats  # noqa: PLC0415 - loading it takes half a second

    if x.size < 2:
        return None, None
    mean = float(x.mean())
    error = float(x.std(ddof=1)) / math.sqrt(x.size)
    if error == 0.0:
        return mean, mean
    if bootstrap:
        found = stats.bootstrap(
            (x,),
            np.mean,
            confidence_level=confidence,
            n_resamples=_RESAMPLES,
            rng=np.random.default_rng(0),
        ).confidence_interval
        return float(found.low), float(found.high)
    half_width = float(stats.t.ppf(0.5 + 0.5 * confidence, x.size - 1)) * error
    return mean - half_width, mean + half_width
