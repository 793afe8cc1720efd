"""Values that events set and that hold until they are set again.

The delay and the loss that a condition gives a link, the mode of a machine: what the conductor of
a session decides while the run goes on, and the parent of a supervised run has to know as well. A
value holds from its instant on; one that nothing has set, or that is NaN, is none.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

History = list[tuple[int, float]]
"""Instants [ns], increasing, and the values that hold from there on."""


class EventValues:
    """The values by their names, and since when each holds.

    Attributes
    ----------
    on_set : called with name, instant [ns] and value of what is set.
    """

    def __init__(self) -> None:
        self._histories: dict[str, History] = {}
        self.on_set: Callable[[str, int, float], None] | None = None

    def set(self, name: str, time_ns: int, value: float) -> None:
        """Set a value from an instant on, in place of one that was set at it."""
        history = self._histories.setdefault(name, [])
        while history and history[-1][0] >= time_ns:
            history.pop()
        history.append((time_ns, value))
        if self.on_set is not None:
            self.on_set(name, time_ns, value)

    def at(self, name: str, time_ns: int) -> float | None:
        """Return the value at an instant; None if there is none."""
        history = self._histories.get(name, ())
        place = bisect_right(history, time_ns, key=lambda one: one[0])
        value = history[place - 1][1] if place else np.nan
        return None if np.isnan(value) else value

    def read(self, name: str, points_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the value at each point [ns], float64; NaN where there is none."""
        times, values = self.changes(name)
        places = np.searchsorted(times, points_ns, side="right")
        return np.concatenate(([np.nan], values))[places]

    def since(self, name: str, points_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return when the value at each point was set [ns], int64; 0 where none was."""
        times, _ = self.changes(name)
        return np.concatenate(([0], times))[np.searchsorted(times, points_ns, side="right")]

    def changes(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the instants [ns] and the values of all that was set, int64 and float64 (n,)."""
        history = self._histories.get(name, [])
        times = np.array([time for time, _ in history], np.int64)
        return times, np.array([value for _, value in history], np.float64)

    def all(self) -> dict[str, History]:
        """Return everything that was set, for `restore`."""
        return {name: list(history) for name, history in self._histories.items()}

    def restore(self, histories: Mapping[str, Sequence[Sequence[float]]]) -> None:
        """Return to what `all` returned."""
        self._histories = {
            name: [(int(time), float(value)) for time, value in history]
            for name, history in histories.items()
        }
