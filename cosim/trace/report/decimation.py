"""Thin curves: keep the first, last, least and greatest point of each segment of time.

That is M4 (Jugel, Jerzak, Hackenbroich and Markl, VLDB 2014): with one segment per pixel column
the line is the same pixel by pixel, and at any width no spike is lost. Of a value drawn as steps,
only the changes are kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]


def decimated(t: Reals, values: Reals, segments: int, *, stepwise: bool = False) -> Indices:
    """Return the indices of the points to draw, increasing.

    Parameters
    ----------
    t : times, not decreasing, (m,).
    values : NaN is a gap, (m,).
    segments : number of segments, of equal length in time; at most four points of each are
        kept, and both ends of every gap.
    stepwise : each value holds until the next; values equal to the one before are left out.
    """
    kept = _changes(values) if stepwise else np.arange(t.size)
    if kept.size <= 4 * segments:
        return kept
    t, values = t[kept], values[kept]
    span = t[-1] - t[0]
    share = (t - t[0]) / span if span > 0 else np.zeros(t.size)
    segment = np.minimum((share * segments).astype(np.intp), segments - 1)
    starts = np.flatnonzero(np.diff(segment, prepend=-1))
    chosen = [starts, np.append(starts[1:], t.size) - 1]
    group = np.repeat(np.arange(starts.size), np.diff(np.append(starts, t.size)))
    for blank, best in ((np.inf, np.minimum), (-np.inf, np.maximum)):
        extreme = np.where(np.isnan(values), blank, values)
        extremes = np.flatnonzero(extreme == best.reduceat(extreme, starts)[group])
        chosen.append(extremes[np.unique(group[extremes], return_index=True)[1]])
    edge = np.flatnonzero(np.diff(np.isnan(values)))
    chosen += [edge, edge + 1]
    result: Indices = kept[np.unique(np.concatenate(chosen))]
    return result


def _changes(values: Reals) -> Indices:
    """Return where a value differs from the one before, with the first and the last."""
    if values.size < 2:
        return np.arange(values.size)
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    differs = np.concatenate([[True], ~same])
    differs[-1] = True
    return np.flatnonzero(differs)
