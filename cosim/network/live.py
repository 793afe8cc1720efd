"""The schedule of a live link as it was asked for before `GrowingSchedule`."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.network.growing_schedule import GrowingSchedule


class LiveSchedule(GrowingSchedule):
    """A `GrowingSchedule` that also has all instants of sending at once."""

    @cached_property
    def sent_ns(self) -> NDArray[np.int64]:
        """Instant of sending of each message [ns], int64 (n,)."""
        return self._sendings.instants(0, self._sendings.count)

    def next_change_ns(self, after_ns: int) -> int | None:
        """Return the first instant after this one at which the message in use changes [ns].

        None when there is none before the horizon.
        """
        times, _ = self.changes(after_ns, self.horizon_ns - 1)
        return int(times[0]) if times.size else None
