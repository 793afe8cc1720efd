"""A transport link: a continuous signal, delayed by a constant.

y(t) = u(t - delay), read off the rows of the sender by linear interpolation between two
communication points; before t = 0 the signal has its initial value, row 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import InputError
from cosim.network.packet import check_duration

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class TransportLink:
    """A link that delays a continuous signal.

    Parameters
    ----------
    name : name of the link.
    delay_ns : delay [ns], 0 for a wire.

    Raises
    ------
    InputError : no name, or a delay that is no integer in [0, 2**53].
    """

    name: str
    delay_ns: int = 0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(
                "a link needs a name",
                where="link",
                expected="a non-empty string",
                got=repr(self.name),
            )
        check_duration(f"link {self.name!r}: delay_ns", self.delay_ns)

    def rows(self, points_ns: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Where the delayed signal lies between the sender's rows.

        Parameters
        ----------
        points_ns : communication points, strictly increasing [ns], shape (n,).

        Returns
        -------
        index, weight : shape (n,) each. At point k the receiver reads
            (1 - weight[k]) row[index[k]] + weight[k] row[index[k] + 1], with 0 <= weight < 1.
            Where weight is 0, row index + 1 is not needed (and may not exist). Never a row
            after k; row k itself only where the delay is shorter than the step into k.
        """
        points = np.asarray(points_ns, np.int64)
        wanted = np.maximum(points - np.int64(self.delay_ns), points[:1])
        index = np.searchsorted(points, wanted, side="right") - 1
        following = np.minimum(index + 1, points.size - 1)
        gap = points[following] - points[index]
        past = wanted - points[index]
        weight = np.where(past > 0, past / np.maximum(gap, 1), 0.0)
        return index.astype(np.int64), weight
