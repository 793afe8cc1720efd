"""A transport link: a continuous signal, delayed by a constant or by a recorded delay.

y(t) = u(t - delay(t)), with the delay at the instant of receiving, by linear interpolation
between two rows of the sender; before t = 0 the signal has its initial value, row 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.network.checks import check_delay, check_name
from cosim.network.keys import DurationKey, check_keys
from cosim.network.profile import DelayProfile
from cosim.network.state import NONE_YET, LinkState


@dataclass(frozen=True, slots=True)
class TransportLink:
    """A link that delays a continuous signal.

    Parameters
    ----------
    name : name of the link.
    delay_ns : delay [ns], 0 for a wire.
    delay : a recorded delay that varies, in place of `delay_ns`.

    Raises
    ------
    InputError : no name, a delay that is no integer in [0, 2**53], or two delays.
    """

    name: str
    delay_ns: Annotated[int, DurationKey("from sending to receiving")] = 0
    delay: DelayProfile | None = None

    def __post_init__(self) -> None:
        check_name("link", self.name)
        where = f"link {self.name!r}"
        check_keys(f"{where}: ", self)
        hint = "only a packet link can have a delay that follows a signal"
        check_delay(where, self.delay, self.delay_ns, (DelayProfile,), hint)

    def read_ns(self, points_ns: ArrayLike) -> NDArray[np.int64]:
        """Return the instant of the sender's signal that is read at each point [ns], at least 0."""
        points = np.asarray(points_ns, np.int64)
        delay = self.delay_ns if self.delay is None else self.delay.delay_ns(points)
        read: NDArray[np.int64] = np.maximum(points - delay, 0)
        return read

    def state(self, points_ns: ArrayLike) -> LinkState:
        """Return the state at each point: its age is the delay, or the time since the start.

        There are no messages: `sequence` is `NONE_YET`, and none is dropped or delivered.
        """
        points = np.asarray(points_ns, np.int64)
        none = np.zeros(points.shape, np.int64)
        return LinkState((points - self.read_ns(points)) / 1e9, none + NONE_YET, none, none.copy())

    def rows(
        self, points_ns: ArrayLike, first: int = 0
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the rows, and their weights, that give the delayed signal from `first` on.

        Parameters
        ----------
        points_ns : communication points, strictly increasing [ns], shape (n,).

        Returns
        -------
        index, weight : shape (n - first,) each. At point k the receiver reads
            (1 - weight) row[index] + weight row[index + 1], with 0 <= weight < 1. Where weight
            is 0, row index + 1 is not needed (and may not exist). Never a row after k; row k
            itself only where the delay is shorter than the step into k.
        """
        points = np.asarray(points_ns, np.int64)
        wanted = np.maximum(self.read_ns(points[first:]), points[:1])
        index = np.searchsorted(points, wanted, side="right") - 1
        following = np.minimum(index + 1, points.size - 1)
        gap = points[following] - points[index]
        past = wanted - points[index]
        weight = np.where(past > 0, past / np.maximum(gap, 1), 0.0)
        return index.astype(np.int64), weight
