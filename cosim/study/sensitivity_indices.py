"""Sensitivity indices: the share of a metric's variance that is due to each axis.

First-order and total indices of Sobol', from a study whose axes are of kind "saltelli", by the
estimators of Saltelli et al. (2010), with bootstrap intervals. They are made as if points were
independent; those of a Sobol sequence are evener, so that intervals contain an index at least as
often as they say.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.study.points import Points
from cosim.study.schema import SampledAxis, Study


@dataclass(frozen=True)
class Index:
    """A sensitivity index, and an interval for it."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Sensitivity:
    """The indices of one metric.

    Attributes
    ----------
    metric : its name.
    samples : number of samples, each of (axes + 2) runs.
    first : by axis, the share of the variance that this axis causes alone.
    total : by axis, the share that it causes alone and together with others.
    """

    metric: str
    samples: int
    confidence: float
    first: dict[str, Index]
    total: dict[str, Index]

    def to_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return asdict(self)


def sensitivity(
    table: Any, manifest: dict[str, Any], metric: str, *, confidence: float = 0.95
) -> Sensitivity:
    """Return the sensitivity indices of a metric.

        >>> from cosim import DelaySystem, Scenario, run_study
        >>> from cosim.study import Study, read_table, sensitivity
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1]).loaded()
        >>> of, kind = "components.lag.parameters", {"kind": "saltelli"}
        >>> axes = [kind | {"name": "start", "path": f"{of}.initial.x[1]", "uniform": [0.5, 1.5]},
        ...         kind | {"name": "rate", "path": f"{of}.A[1,1]", "uniform": [-1.1, -0.9]}]
        >>> end = {"x": "final.lag.x[1]"}
        >>> study = Study(title="Lags", scenario="lag", vary=axes, samples=8, metrics=end)
        >>> done = run_study(study, "lags", scenario=lag)
        >>> indices = sensitivity(*read_table("lags"), "x")
        >>> done.runs, indices.total["start"].value > indices.total["rate"].value
        (32, True)

    table, manifest : of a study that is finished (`read_table`).

    Raises
    ------
    InputError : no such metric; axes of other kinds; runs that are missing or have no finite value;
        or a metric that does not vary.
    """
    from scipy.stats import bootstrap  # noqa: PLC0415 - loading it takes half a second

    study = Study.model_validate(manifest["study"])
    if metric not in study.metrics:
        raise InputError.unknown("metric", metric, study.metrics, where="sensitivity")
    axes = [axis.column for axis in study.vary if isinstance(axis, SampledAxis)]
    if not axes or any(getattr(axis, "kind", "") != "saltelli" for axis in study.vary):
        raise InputError(
            "sensitivity indices need a study made for them",
            where=study.title,
            expected="axes of kind 'saltelli' alone",
            got=", ".join(axis.kind for axis in study.vary),
        )
    values = _values(table, metric, Points(study).count)
    if np.ptp(values) == 0.0:
        raise InputError("the metric does not vary", where=metric, got=f"{values[0]:g} in all runs")
    blocks = values.reshape(study.samples, len(axes) + 2)
    blocks = blocks - blocks[:, [0, -1]].mean()  # the products of a large mean lose digits
    found = _indices(blocks)

    def of_some(numbers: NDArray[np.int64]) -> Any:
        return _indices(blocks[numbers])

    # always the same draws: a study says the same whenever it is asked
    numbers, draws = [np.arange(study.samples)], np.random.default_rng(0)
    made = bootstrap(
        numbers, of_some, method="BCa", n_resamples=999, confidence_level=confidence, rng=draws
    )
    low, high = map(np.asarray, made.confidence_interval)
    first, total = (_by_axis(axes, found[k], low[k], high[k]) for k in range(2))
    return Sensitivity(metric, study.samples, confidence, first, total)


def _indices(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return first-order and total indices (2, axes), of samples (n, axes + 2): A, AB, ..., B.

    Saltelli et al. (2010), Table 2, (b) and (f); the variance is that of A and B together.
    """
    a, mixed, b = blocks[:, :1], blocks[:, 1:-1], blocks[:, -1:]
    variance = np.var(np.concatenate((a, b)))
    first = np.mean(b * (mixed - a), axis=0)
    total = np.mean((a - mixed) ** 2, axis=0) / 2.0
    found: NDArray[np.float64] = np.stack((first, total)) / variance
    return found


def _values(table: Any, metric: str, count: int) -> Any:
    """Return the metric of every run, by its number, (count,)."""
    column = table.column(metric).to_pylist()
    values = np.array([np.nan if value is None else float(value) for value in column])
    if values.size < count or not np.isfinite(values).all():
        raise InputError(
            "sensitivity indices need the metric of every run",
            where=metric,
            expected=f"{count} finite values",
            got=f"{int(np.isfinite(values).sum())}",
            hint="finish the study, or take a metric that every run has",
        )
    return values


def _by_axis(axes: list[str], values: Any, low: Any, high: Any) -> dict[str, Index]:
    found = zip(axes, values, low, high, strict=True)
    return {axis: Index(*map(float, numbers)) for axis, *numbers in found}
