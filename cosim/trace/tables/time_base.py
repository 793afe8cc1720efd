"""Times that rows are put on: a common time base, and windows of time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
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


def window_ns(start: float | None, end: float | None) -> tuple[int, int]:
    """Return a time window in nanoseconds, both ends included; None is no bound."""
    bounds = []
    for name, seconds, default in (("start", start, 0), ("end", end, LATEST_NS)):
        if seconds is None:
            bounds.append(default)
        elif math.isfinite(seconds):
            bounds.append(min(max(round(seconds * 1e9), -1), LATEST_NS))
        else:
            raise InputError("not a time", where=name, expected="finite seconds", got=repr(seconds))
    low, high = bounds
    if start is not None and end is not None and end < start:
        raise InputError(
            "the window ends before it starts", expected="start <= end", got=f"{start:g}, {end:g}"
        )
    return max(low, 0), high
