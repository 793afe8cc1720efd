"""A column that grows part by part, in one array where its length is known before."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


class GrowingColumn:
    """Values, and where they are present.

    Parameters
    ----------
    dtype : of the values.
    expected : how many there will be, if that is known; 0 if not.
    """

    def __init__(self, dtype: DTypeLike, expected: int) -> None:
        self._values = np.empty(expected, dtype)
        self._parts: list[tuple[int, NDArray[np.bool_] | None]] = []
        self._count = 0

    def extend(self, values: Any, present: NDArray[np.bool_] | None) -> None:
        """Append values, (m,); `present` : where they are, None for everywhere."""
        first, self._count = self._count, self._count + len(values)
        if self._count > self._values.size:
            longer = np.empty(max(self._count, 2 * first), self._values.dtype)
            longer[:first] = self._values[:first]
            self._values = longer
        self._values[first : self._count] = values
        self._parts.append((len(values), present))

    @property
    def values(self) -> NDArray[Any]:
        """The values so far, (n,)."""
        return self._values[: self._count]

    @property
    def present(self) -> NDArray[np.bool_] | None:
        """Where they are present, (n,); None for everywhere."""
        if all(present is None for _, present in self._parts):
            return None
        return np.concatenate(
            [np.ones(size, bool) if present is None else present for size, present in self._parts]
        )
