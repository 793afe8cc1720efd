"""Inequalities of `cosim.hinf.theorems`, compiled for an SDP solver.

All of it follows from the terms: the columns of every unknown, units in which no coefficient is
far from one, and the parts that nothing connects. A change of sign of one part changes no
constant, so the mean of a solution over all such changes is a solution too, with unknowns that do
not connect the parts: one small matrix for each part loses nothing, and the four axes of the
vehicle are solved in a tenth of the time.

What is compiled is rounded to doubles here; what is found is proved again from the same terms.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.theorems import Inequality, Shape, Signal, shapes_of

if TYPE_CHECKING:
    from cosim.hinf.theorems import Term

Indices = NDArray[np.signedinteger[Any]]

_CHUNK = 256
"""Columns that are computed at once."""


class _Product(NamedTuple):
    """A term in doubles, its signals as maps of all rows, in units of the rows."""

    unknown: str | None
    left: Array
    right: Array
    weight: float
    is_number: bool


class Program:
    """Inequalities with the same unknowns, in units of the solver.

    Parameters
    ----------
    main : what is positive by the margin that is searched for.
    others : what is positive beside it; their rows are counted in units of their own.
    units : (size,) of the rows of each name in `main`: a row is its unit times what the solver
        has; ones where none are given.
    numbers : units of unknown numbers, where the size of their coefficients says too little.

    Attributes
    ----------
    width : how many unknown numbers there are, where none is fixed.
    columns : where those of each unknown stand.
    """

    def __init__(
        self,
        main: Sequence[Inequality],
        others: Sequence[Inequality],
        units: Mapping[str, Array],
        *,
        numbers: Mapping[str, float] | None = None,
    ) -> None:
        self._main = len(main)
        self.shapes: dict[str, Shape] = shapes_of([*main, *others])
        self._forms = [_products_of(one, units) for one in main]
        self._scales = self._units_of_unknowns(numbers or {})
        self._forms += [self._in_units_of_rows(_products_of(one, {})) for one in others]
        self._rows = [sum(one.rows.values()) for one in (*main, *others)]
        self._labels, self._row_labels = self._parts()
        self.columns: dict[str, slice] = {}
        self._kept: dict[str, tuple[Indices, Indices]] = {}
        start = 0
        for name, shape in self.shapes.items():
            left, right = self._labels[name]
            a, b = (
                np.triu_indices(shape.height)
                if shape.symmetric
                else np.indices((shape.height, shape.width)).reshape(2, -1)
            )
            same = left[a] == right[b]
            self._kept[name] = a[same], b[same]
            self.columns[name] = slice(start, start + int(same.sum()))
            start = self.columns[name].stop
        self.width = start

    @functools.cached_property
    def _unfixed(self) -> tuple[list[Constraint], list[Constraint]]:
        """The main inequalities and the others, each cut into its parts, nothing fixed."""
        cut: tuple[list[Constraint], list[Constraint]] = ([], [])
        for k, (form, label) in enumerate(zip(self._forms, self._row_labels, strict=True)):
            for part in np.unique(label):
                cut[k >= self._main].append(self._constraint(form, np.flatnonzero(label == part)))
        return cut

    @property
    def largest(self) -> int:
        """How many rows the largest part of a main inequality has."""
        return max(int(np.bincount(label).max()) for label in self._row_labels[: self._main])

    def constraints(
        self,
        fixed: Mapping[str, float] | None = None,
        *,
        multiples: Mapping[str, float] | None = None,
    ) -> tuple[list[Constraint], list[Constraint]]:
        """Return the main inequalities and the others, each cut into its parts.

        fixed : numbers that are known; they have no column.
        multiples : of their units, in which other numbers are counted here.
        """
        free = self._free(fixed or {})
        given, factors = np.zeros(self.width), np.ones(self.width)
        for name, factor in (multiples or {}).items():
            factors[self.columns[name]] = factor
        for name, number in (fixed or {}).items():
            if name in self.columns:
                given[self.columns[name]] = number / self._scales[name][0][0] ** 2

        def at(one: Constraint) -> Constraint:
            columns = np.asarray(one.columns)
            constant = one.constant + columns @ given if given.any() else one.constant
            columns = columns[:, free]
            return Constraint(one.size, constant, columns * factors[free] if multiples else columns)

        main, others = ([at(one) for one in each] for each in self._unfixed)
        return main, others

    def values(self, y: Array, fixed: Mapping[str, float] | None = None) -> dict[str, Any]:
        """Return the unknowns of a point in the units of the inequalities, numbers as floats."""
        values: dict[str, Any] = dict(fixed or {})
        entries = np.zeros(self.width)
        entries[self._free(values)] = y
        for name, shape in self.shapes.items():
            if name in values:
                continue
            (left, right), (a, b) = self._scales[name], self._kept[name]
            U = np.zeros((shape.height, shape.width))
            U[a, b] = entries[self.columns[name]]
            if shape.symmetric:
                U[b, a] = U[a, b]
            U = left[:, None] * U * right
            values[name] = float(U[0, 0]) if shape.is_number else U
        return values

    def cost(self, unknowns: Sequence[str], fixed: Mapping[str, float] | None = None) -> Array:
        """Return (free unknowns,) what is minimised: the sum of these numbers, in their units."""
        weights = np.zeros(self.width)
        for name in unknowns:
            weights[self.columns[name]] = 1.0
        return weights[self._free(fixed or {})]

    def _free(self, fixed: Mapping[str, float]) -> Indices:
        """Return the places of what is unknown."""
        keep = np.ones(self.width, dtype=bool)
        for name in fixed:
            if name in self.columns:
                keep[self.columns[name]] = False
        return np.flatnonzero(keep)

    def unit_of(self, name: str) -> Array:
        """Return (rows,) what multiplies the solver's unknown from both sides; it is symmetric."""
        return self._scales[name][0]

    def _units_of_unknowns(self, numbers: Mapping[str, float]) -> dict[str, tuple[Array, Array]]:
        """Return factors of rows and columns that make every coefficient of the size of one."""
        size = {
            name: (np.zeros(shape.height), np.zeros(shape.width))
            for name, shape in self.shapes.items()
        }
        for t in (t for form in self._forms for t in form):
            if t.unknown is None or t.unknown not in size:
                continue
            left, right = (np.linalg.norm(M, axis=1) for M in (t.left, t.right))
            if t.is_number:  # 2 w |left| |right|, entry by entry of what is multiplied
                largest = np.sqrt(2 * abs(t.weight) * float((left * right).max(initial=0.0)))
                left = right = np.full(1, largest)
            else:
                left, right = (np.sqrt(abs(t.weight)) * x for x in (left, right))
            if self.shapes[t.unknown].symmetric:
                left = right = np.sqrt(left * right)
            for known, more in zip(size[t.unknown], (left, right), strict=True):
                np.maximum(known, more, out=known)
        units = {name: (_inverse(left), _inverse(right)) for name, (left, right) in size.items()}
        given = {k: (np.full(1, np.sqrt(v)),) * 2 for k, v in numbers.items() if k in units}
        return units | given

    def _in_units_of_rows(self, form: list[_Product]) -> list[_Product]:
        """Return an inequality with each row in units in which the first unknown is about one."""
        size = np.zeros(form[0].left.shape[1])
        for t in form:
            left, right = t.left, t.right
            if t.unknown in self._scales and not t.is_number:
                one, other = self._scales[t.unknown]
                left, right = one[:, None] * left, other[:, None] * right
            weight = 2 * abs(t.weight)
            if t.unknown in self._scales and t.is_number:
                weight *= float(self._scales[t.unknown][0][0] ** 2)
            sizes = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=0)
            size = np.where(size > 0, size, weight * sizes)
        unit = _inverse(np.sqrt(size))
        return [t._replace(left=t.left * unit, right=t.right * unit) for t in form]

    def _parts(self) -> tuple[dict[str, tuple[Indices, Indices]], list[Indices]]:
        """Return the part of every row and column of the unknowns, and of all rows."""
        start: dict[str, tuple[int, int]] = {}
        count = 0
        for name, shape in self.shapes.items():
            if shape.is_number:
                continue
            second = count if shape.symmetric else count + shape.height
            start[name] = count, second
            count = second + shape.width
        first = count + np.cumsum([0, *self._rows])
        links: list[tuple[Indices, Indices]] = []
        for form, at in zip(self._forms, first, strict=False):
            for t in form:
                if t.unknown not in start:
                    i, j = np.nonzero(abs(t.left).T @ abs(t.right))
                    links.append((at + i, at + j))
                    continue
                for side, M in zip(start[t.unknown], (t.left, t.right), strict=True):
                    a, i = np.nonzero(M)
                    links.append((side + a, at + i))
        i, j = (np.concatenate(x) for x in zip(*links, strict=True))
        graph = scipy.sparse.coo_array((np.ones(len(i)), (i, j)), shape=(int(first[-1]),) * 2)
        _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
        one: Indices = np.zeros(1, dtype=np.intp)
        of_unknowns: dict[str, tuple[Indices, Indices]] = {
            name: (one, one)
            if shape.is_number
            else (
                label[start[name][0] : start[name][0] + shape.height],
                label[start[name][1] : start[name][1] + shape.width],
            )
            for name, shape in self.shapes.items()
        }
        return of_unknowns, [label[a:b] for a, b in itertools.pairwise(first)]

    def _constraint(self, form: list[_Product], at: Indices) -> Constraint:
        size = len(at) * (len(at) + 1) // 2
        constant, columns = np.zeros(size), np.zeros((size, self.width))
        for t in form:
            L, R = t.left[:, at], t.right[:, at]
            if not (L.any() and R.any()):
                continue  # of another part
            if t.unknown in self.shapes and not t.is_number:
                self._add_columns(columns[:, self.columns[t.unknown]], t, L, R)
                continue
            half = t.weight * (L.T @ R)
            term = svec(half + half.T)
            if t.unknown in self.shapes:
                columns[:, self.columns[t.unknown]] += (
                    self._scales[t.unknown][0] ** 2 * term[:, None]
                )
            else:
                constant += term
        return Constraint(len(at), constant, columns)

    def _add_columns(self, columns: Array, t: _Product, L: Array, R: Array) -> None:
        """Add the columns of the entries of an unknown matrix."""
        assert t.unknown is not None  # noqa: S101 - the caller has looked
        one, other = self._scales[t.unknown]
        L, R = one[:, None] * L, t.weight * other[:, None] * R
        a, b = self._kept[t.unknown]
        symmetric = self.shapes[t.unknown].symmetric
        of_L, of_R = (np.asarray(M.any(axis=1)) for M in (L, R))
        some = of_L[a] & of_R[b]
        if symmetric:
            some |= of_L[b] & of_R[a]
        used = np.flatnonzero(some)
        for first in range(0, len(used), _CHUNK):
            these = used[first : first + _CHUNK]
            i, j = a[these], b[these]
            outer = L[i][:, :, None] * R[j][:, None, :]
            if symmetric:
                apart = i != j  # V_ij stands twice
                outer[apart] += L[j[apart]][:, :, None] * R[i[apart]][:, None, :]
            columns[:, these] += svec(outer + np.swapaxes(outer, 1, 2)).T


def _products_of(one: Inequality, units: Mapping[str, Array]) -> list[_Product]:
    """Return the terms of an inequality in doubles."""
    row = np.concatenate([units.get(name, np.ones(size)) for name, size in one.rows.items()])
    known: dict[int, Array] = {}

    def floats(signal: Signal) -> Array:
        if id(signal) not in known:
            known[id(signal)] = signal.floats_on(one.rows) * row
        return known[id(signal)]

    def product(t: Term) -> _Product:
        return _Product(t.unknown, floats(t.left), floats(t.right), float(t.weight), t.is_number)

    return [product(t) for t in one.terms]


def _inverse(size: Array) -> Array:
    """Return 1 / size, 1 where it is zero."""
    return np.asarray(1.0 / np.where(size > 0, size, 1.0))
