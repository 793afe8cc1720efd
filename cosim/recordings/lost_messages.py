"""When a lost message would have arrived."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.network import IN_FLIGHT_NS


def with_due(delays_ns: Sequence[int | None]) -> NDArray[np.int64]:
    """Return delays in which None is that of the last message before that arrived [ns], int64 (n,).

    Before the first arrival that of the first; 0 where none arrived at all.
    """
    known = (d for d in delays_ns if d is not None and d != IN_FLIGHT_NS)
    last = next(known, 0)
    found = np.zeros(len(delays_ns), np.int64)
    for k, delay in enumerate(delays_ns):
        if delay is not None and delay != IN_FLIGHT_NS:
            last = delay
        found[k] = last if delay is None else delay
    return found
