"""Times that rows are put on: a common time base, and windows of time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Seconds, seconds, unit_in
from cosim.trace.file.records import LATEST_NS
from cosim.trace.tables.column import Align

Integers = NDArray[np.int64]
_MOST_POINTS = 100_000_000


def time_base(align: Align, topics: Mapping[str, Integers], chosen: Iterable[Integers]) -> Integers:
    """Return the instants of the time base [ns], increasing.

    align : as of `Framed`.
    topics : instants of the rows of each topic that can be aligned with [ns].
    chosen : instants of the rows that are put on the time base [ns].
    """
    every = np.unique(np.concatenate([*chosen, np.zeros(0, np.int64)]))
    if isinstance(align, str):
        if align == "union":
            return every
        if align in topics:
            return np.unique(topics[align])
        if unit_in(align) is not None:
            align = seconds(align, "align")
    if isinstance(align, str):
        raise InputError.unknown("topic to align with", align, ["union", *topics], where="align")
    if isinstance(align, int | float):
        period = round(align * 1e9) if np.isfinite(align) else 0
        if period < 1:
            raise InputError(
                "not a period", where="align", expected="at least a nanosecond", got=f"{align:g} s"
            )
        if every.size and (every[-1] - every[0]) // period > _MOST_POINTS:
            raise InputError("too many instants", where="align", expected=f"at most {_MOST_POINTS}")
        return np.arange(every[0], every[-1] + 1, period) if every.size else every
    given = np.asarray(align, np.float64)
    if given.ndim != 1 or not np.isfinite(given).all() or (np.diff(given) < 0).any():
        raise InputError("not instants", where="align", expected="finite, increasing seconds")
    return np.rint(given * 1e9).astype(np.int64)


def window_ns(start: Seconds | None, end: Seconds | None) -> tuple[int, int]:
    """Return a time window in nanoseconds, both ends included; None is no bound."""
    bounds, given = [], []
    for name, bound, default in (("start", start, 0), ("end", end, LATEST_NS)):
        if bound is None:
            bounds.append(default)
            continue
        given.append(seconds(bound, name))
        if not math.isfinite(given[-1]):
            raise InputError("not a time", where=name, expected="finite seconds", got=repr(bound))
        bounds.append(min(max(round(given[-1] * 1e9), -1), LATEST_NS))
    low, high = bounds
    if len(given) > 1 and given[1] < given[0]:
        raise InputError(
            "the window ends before it starts",
            expected="start <= end",
            got=f"{given[0]:g}, {given[1]:g}",
        )
    return max(low, 0), high
