"""Small matrix inequalities M(y) >= 0, affine in some entries of a longer vector y."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.svec import Array, svec


class Affine:
    """The inequality M(y) = M0 + sum_i y_i M_i >= 0, M symmetric with `size` rows."""

    def __init__(self, size: int) -> None:
        self._constant = np.zeros((size, size))
        self._terms: dict[int, Array] = {}

    def constant(self, row: int, column: int, block: Array) -> Affine:
        """Add a block at (row, column), and its transpose where it is off the diagonal."""
        _put(self._constant, row, column, np.asarray(block, dtype=np.float64))
        return self

    def unknown(
        self, row: int, column: int, place: NDArray[np.int64], factor: float | Array = 1.0
    ) -> Affine:
        """Add factor (a number, or one per entry) times the unknowns at `place`, as a block."""
        factors = np.broadcast_to(np.asarray(factor, dtype=np.float64), place.shape)
        for index in np.unique(place):
            block = np.where(place == index, factors, 0.0)
            self.term(row, column, int(index), block)
        return self

    def term(self, row: int, column: int, index: int, block: Array) -> Affine:
        """Add y_index times a block."""
        if block.any():
            matrix = self._terms.setdefault(index, np.zeros_like(self._constant))
            _put(matrix, row, column, block)
        return self

    def constraint(self, width: int) -> Constraint:
        """Return M(y) >= 0 for the solver; y has `width` entries."""
        columns = scipy.sparse.lil_array(
            (self._constant.shape[0] * (len(self._constant) + 1) // 2, width)
        )
        for index, matrix in self._terms.items():
            columns[:, [index]] = svec(matrix)[:, None]
        return Constraint(
            len(self._constant), svec(self._constant), scipy.sparse.csc_array(columns)
        )


def _put(matrix: Array, row: int, column: int, block: Array) -> None:
    height, width = block.shape
    matrix[row : row + height, column : column + width] += block
    if row != column:
        matrix[column : column + width, row : row + height] += block.T
