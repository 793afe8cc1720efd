"""The distribution of a metric over the runs: a histogram, or how often each value occurs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.page import LARGEST
from cosim.study.columns import Column

Reals = NDArray[np.float64]
_MOST_BINS = 60
_FAR = 5.0
_MOST_WORDS = 30
_FINEST = 1e-12


@dataclass(frozen=True)
class Distribution:
    """How many runs have which values.

    Attributes
    ----------
    edges : borders of the bins of numbers, (k + 1,); empty for truths and texts.
    names : truths and texts, the most frequent ones; empty for numbers.
    counts : runs per bin or name, (k,).
    below, above : runs whose numbers lie outside the bins, far from all others.
    others : runs with less frequent texts.
    """

    edges: Reals
    names: tuple[str, ...]
    counts: NDArray[np.int64]
    below: int = 0
    above: int = 0
    others: int = 0

    @property
    def outside(self) -> str:
        """What is not drawn, in words; empty if nothing."""
        parts = []
        if self.below or self.above:
            first, last = self.edges[0], self.edges[-1]
            parts.append(f"{self.below} below {first:.4g} and {self.above} above {last:.4g}")
        if self.others:
            parts.append(f"{self.others} runs with other values")
        return f"not drawn: {', '.join(parts)}" if parts else ""


def distribution_of(column: Column) -> Distribution:
    """Return the distribution of a metric over the runs that have it."""
    values = column.values[column.known]
    if column.kind == "number":
        return _histogram(values)
    places, counts = np.unique(values.astype(np.int64), return_counts=True)
    if column.kind == "truth":
        counts = np.array([counts[places == k].sum() for k in (1, 0)], np.int64)
        return Distribution(np.zeros(0), ("yes", "no"), counts)
    order = np.argsort(-counts, kind="stable")[:_MOST_WORDS]
    names = tuple(column.words[places[k]] for k in order)
    return Distribution(
        np.zeros(0), names, counts[order], others=int(values.size - counts[order].sum())
    )


def _histogram(values: Reals) -> Distribution:
    """Count numbers in bins by Freedman and Diaconis' rule, without what lies far outside."""
    if values.size == 0:
        return Distribution(np.zeros(0), (), np.zeros(0, np.int64))
    values = np.clip(values, -LARGEST, LARGEST)
    low, high = float(values.min()), float(values.max())
    first, quarter, three, last = np.quantile(values, [0.01, 0.25, 0.75, 0.99])
    margin = _FAR * max(last - first, 0.0)
    if margin > 0.0:
        near = values[(values >= first - margin) & (values <= last + margin)]
        low, high = float(near.min()), float(near.max())
    width = 2.0 * (three - quarter) / np.cbrt(values.size)
    bins = int(np.clip((high - low) / width, 5, _MOST_BINS)) if width > 0.0 else 20
    if high - low <= _FINEST * max(abs(low), abs(high)):  # one value, or no room for bins
        half = 0.05 * max(abs(low), 1.0)
        low, high, bins = low - half, high + half, 1
    counts, edges = np.histogram(values, bins=bins, range=(low, high))
    return Distribution(
        edges, (), counts.astype(np.int64), int((values < low).sum()), int((values > high).sum())
    )
