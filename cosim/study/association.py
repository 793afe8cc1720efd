"""How a metric depends on the axes: means per group, means per cell of a grid, correlations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from cosim.study.columns import Column
from cosim.study.intervals import student, wilson

Reals = NDArray[np.float64]
_MOST_CELLS = 60


@dataclass(frozen=True)
class Groups:
    """A metric per value of an axis, or per part of its range.

    Attributes
    ----------
    names, centres : of the groups, (k,).
    mean, low, high : of the runs of each group, with interval, (k,); NaN where there is none.
    number : of runs of each group that have the metric, (k,).
    explained : share of the metric's variance (of its ranks) between the groups, less what chance
        gives; None where the metric does not vary.
    """

    names: tuple[str, ...]
    centres: Reals
    mean: Reals
    low: Reals
    high: Reals
    number: Reals
    explained: float | None


def groups_of(metric: Column, axis: Column, confidence: float = 0.95) -> Groups:
    """Return the means of a metric per group of an axis."""
    group, names, centres = axis.groups
    kept = metric.known & (group >= 0)
    group, values = group[kept], metric.values[kept]
    n = np.bincount(group, minlength=len(names)).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(group, values, len(names)) / n
        if metric.kind == "truth":
            low, high = wilson(mean, n, confidence)
        else:
            squares = np.bincount(group, (values - mean[group]) ** 2, len(names))
            low, high = student(mean, squares / np.maximum(n - 1.0, 1.0), n, confidence)
    ranks = metric.ranks if values.size == metric.ranks.size else rankdata(values)
    return Groups(names, centres, mean, low, high, n, _explained(ranks, group, n))


def _explained(ranks: Reals, group: NDArray[np.int64], n: Reals) -> float | None:
    """Return the adjusted correlation ratio of ranks."""
    number = int((n > 0).sum())
    if ranks.size <= number or np.ptp(ranks) == 0.0:
        return None
    means = np.bincount(group, ranks, n.size) / np.maximum(n, 1.0)
    within = float(((ranks - means[group]) ** 2).sum())
    total = float(((ranks - ranks.mean()) ** 2).sum())
    return max(0.0, 1.0 - within / total * (ranks.size - 1) / (ranks.size - number))


@dataclass(frozen=True)
class Cells:
    """The means of a metric in the cells of two axes; `values` (ny, nx), NaN where no run has it.

    coarse : whether neighbouring values of an axis are taken together.
    """

    x: Column
    y: Column
    names_x: tuple[str, ...]
    names_y: tuple[str, ...]
    values: Reals
    coarse: bool


def cells_of(metric: Column, x: Column, y: Column) -> Cells:
    """Return the mean, or share, of a metric per cell of a grid."""
    (i, names_x, coarse_x), (j, names_y, coarse_y) = _cells(x), _cells(y)
    kept = metric.known & (i >= 0) & (j >= 0)
    place = j[kept] * len(names_x) + i[kept]
    size = len(names_x) * len(names_y)
    n = np.bincount(place, minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.bincount(place, metric.values[kept], size) / n
    shape = (len(names_y), len(names_x))
    return Cells(x, y, names_x, names_y, values.reshape(shape), coarse_x or coarse_y)


def _cells(axis: Column) -> tuple[NDArray[np.int64], tuple[str, ...], bool]:
    distinct, inverse = np.unique(axis.values[axis.known], return_inverse=True)
    coarse = distinct.size > _MOST_CELLS
    if coarse:
        inverse = inverse * _MOST_CELLS // distinct.size
        first = [
            np.flatnonzero(np.arange(distinct.size) * _MOST_CELLS // distinct.size == k)[0]
            for k in range(_MOST_CELLS)
        ]
        distinct = distinct[first]
    found = np.full(axis.values.size, -1, np.int64)
    found[axis.known] = inverse
    return found, tuple(axis.text(value) for value in distinct), coarse


def rank_correlations(rows: Sequence[Column], columns: Sequence[Column]) -> Reals:
    """Return Spearman's rank correlation of each row with each column, (rows, columns).

    Of the runs that have both; NaN where one of them does not vary, or is text.
    """
    found = np.full((len(rows), len(columns)), np.nan)
    ranked: dict[tuple[str, bytes], Reals | None] = {}

    def ranks(column: Column, kept: NDArray[np.bool_]) -> Reals | None:
        key = column.name, np.packbits(kept).tobytes()
        if key not in ranked:
            r = rankdata(column.values[kept])
            r -= r.mean() if r.size else 0.0
            norm = float(np.sqrt(r @ r))
            ranked[key] = r / norm if norm > 0.0 else None
        return ranked[key]

    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            if "text" in (row.kind, column.kind):
                continue
            kept = row.known & column.known
            a, b = ranks(row, kept), ranks(column, kept)
            if a is not None and b is not None:
                found[i, j] = 1.0 if row is column else float(np.clip(a @ b, -1.0, 1.0))
    return found
