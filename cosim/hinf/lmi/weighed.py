"""Matrices affine in unknowns whose terms have weights: other weights take another sum."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.products import Indices
from cosim.hinf.lmi.svec import Array, places
from cosim.hinf.theorems import value_of

if TYPE_CHECKING:
    from cosim.hinf.theorems import Weight

Columns = tuple[Indices | None, Array]
"""Numbers of columns, None for the constant, and the svec of each."""


class At(NamedTuple):
    """Where weights are taken, and units that go with it.

    parameters : of the weights.
    rows : a row is this times what it has in units of the program, by name; 1 elsewhere.
    unknowns : likewise for unknowns.
    """

    parameters: Any
    rows: Mapping[str, float]
    unknowns: Mapping[str, float]


class Weighed(NamedTuple):
    """A matrix that is a sum of others with weights: one sparsity pattern, a row per weight.

    The last column is the constant.
    """

    size: int
    weights: list[Weight]
    data: scipy.sparse.csr_array
    indices: Indices
    ends: Indices

    def weights_at(self, at: At) -> Array:
        """Return every weight as a double."""
        return np.array([float(value_of(weight, at.parameters)) for weight in self.weights])

    def units_at(self, names: list[str], at: At) -> Array:
        """Return what the units of its rows, known by `names`, multiply each entry by."""
        rows, columns, _ = places(self.size)
        unit = np.array([at.rows.get(name, 1.0) for name in names])
        return np.asarray((unit[rows] * unit[columns])[self.indices])

    def constraint(
        self, names: list[str], at: At, *, free: Indices, given: Array, factors: Array
    ) -> Constraint:
        """Return the sum with these weights, in the units that go with them.

        Parameters
        ----------
        names : of the row block of every row.
        free, given : which columns are unknown, and what is known of the others, zero elsewhere.
        factors : of all columns.
        """
        data = (self.weights_at(at) @ self.data) * self.units_at(names, at)
        counts = np.diff(self.ends)
        data *= np.repeat(np.append(factors, 1.0), counts)
        height = self.size * (self.size + 1) // 2
        known = np.append(given, 1.0)  # the last column is the constant
        constant = np.zeros(height)
        for column in np.flatnonzero(known):
            these = slice(self.ends[column], self.ends[column + 1])
            constant[self.indices[these]] += known[column] * data[these]
        keep = np.zeros(len(known), dtype=bool)
        keep[free] = True
        stays = np.repeat(keep, counts)
        ends = np.concatenate([[0], np.cumsum(counts[keep])])
        columns = scipy.sparse.csc_array(
            (data[stays], self.indices[stays], ends), shape=(height, len(free))
        )
        return Constraint(self.size, constant, columns)


def weighed(size: int, width: int, terms: Iterable[tuple[Weight, Iterable[Columns]]]) -> Weighed:
    """Return the sum of terms: a weight, and its entries by columns; all numbers go into one.

    size, width : rows of the matrix, and columns.
    """
    height = size * (size + 1) // 2
    weights: list[Weight] = [1.0]
    pieces: list[tuple[Indices, Array, Indices]] = []
    for weight, columns in terms:
        owner, factor = (len(weights), 1.0) if callable(weight) else (0, weight)
        for these, entries in columns:
            i, j = np.nonzero(entries)
            column = np.full(len(j), width) if these is None else these[j]
            pieces.append((column * height + i, factor * entries[i, j], np.full(len(i), owner)))
        if owner:
            weights.append(weight)
    keys, values, owners = (np.concatenate(each) for each in zip(*pieces, strict=True))
    pattern, slot = np.unique(keys, return_inverse=True)
    data = scipy.sparse.csr_array(
        scipy.sparse.coo_array((values, (owners, slot)), shape=(len(weights), len(pattern)))
    )
    ends = np.searchsorted(pattern // height, np.arange(width + 2))
    return Weighed(size, weights, data, pattern % height, ends)
