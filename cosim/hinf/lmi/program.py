"""Inequalities of `cosim.hinf.theorems`, compiled for an SDP solver.

All of it follows from the terms: the columns of every unknown, units in which no coefficient is
far from one, and the parts that nothing connects (`products`). Where weights depend on parameters,
the columns of every weight are kept (`weighed`): other parameters take another sum of them.

What is compiled is rounded to doubles here; what is found is proved again from the same terms.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.products import (
    Indices,
    Product,
    in_units_of_rows,
    parts_of,
    products_of,
    units_of_unknowns,
)
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.lmi.weighed import At, Columns, Weighed, weighed
from cosim.hinf.theorems import Inequality, Shape, shapes_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_CHUNK = 256
"""Columns that are computed at once."""


_Form = tuple[Constraint | Weighed, list[str]]
"""A part of an inequality, and the name of each of its rows."""


class Program:
    """Inequalities with the same unknowns, in units of the solver.

    Parameters
    ----------
    main : what is positive by the margin that is searched for.
    others : what is positive beside it; their rows are counted in units of their own.
    units : (size,) of the rows of each name in `main`: a row is its unit times what the solver
        has; ones where none are given.
    units_of_others : likewise in `others`; where a form has none, its coefficients say.
    numbers : units of unknown numbers, where the size of their coefficients says too little.
    matrices : likewise of unknown matrices: an entry is a unit of its row times one of its column
        times what the solver has. All must be given where weights depend on parameters.

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
        units_of_others: Mapping[str, Array] | None = None,
        numbers: Mapping[str, float] | None = None,
        matrices: Mapping[str, tuple[Array, Array]] | None = None,
    ) -> None:
        self._main = len(main)
        self.shapes: dict[str, Shape] = shapes_of([*main, *others])
        self._forms = [products_of(one, units) for one in main]
        given = {k: (np.full(1, np.sqrt(v)),) * 2 for k, v in (numbers or {}).items()}
        given |= matrices or {}
        self._scales = units_of_unknowns(self._forms, self.shapes, given)
        for one in others:
            form = products_of(one, units_of_others or {})
            has_units = any(name in (units_of_others or {}) for name in one.rows)
            self._forms.append(form if has_units else in_units_of_rows(form, self._scales))
        self._inequality_names = [one.name for one in (*main, *others)]
        self._names = [
            [name for name, size in one.rows.items() for _ in range(size)]
            for one in (*main, *others)
        ]
        self._rows = [len(names) for names in self._names]
        self._labels, self._row_labels = parts_of(self._forms, self.shapes)
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
    def _unfixed(self) -> tuple[list[_Form], list[_Form]]:
        """The main inequalities and the others, each cut into its parts, nothing fixed."""
        cut: tuple[list[_Form], list[_Form]] = ([], [])
        for k, (form, names) in enumerate(zip(self._forms, self._names, strict=True)):
            for at in self._cuts(k):
                if any(callable(t.weight) for t in form):
                    terms = [(t.weight, self._columns_of(t, at)) for t in form]
                    made: Constraint | Weighed = weighed(len(at), self.width, terms)
                else:
                    made = self._constraint(form, at)
                cut[k >= self._main].append((made, [names[i] for i in at]))
        return cut

    @property
    def names_of_others(self) -> list[str]:
        """The name of the inequality that each part of the others is of."""
        names = self._inequality_names[self._main :]
        return [name for k, name in enumerate(names, self._main) for _ in self._cuts(k)]

    @property
    def main_rows(self) -> list[Indices]:
        """The rows of each part of the main inequalities, one after the other."""
        first = np.cumsum([0, *self._rows])
        return [at + first[k] for k in range(self._main) for at in self._cuts(k)]

    def _cuts(self, k: int) -> list[Indices]:
        label = self._row_labels[k]
        return [np.flatnonzero(label == one) for one in np.unique(label)]

    @property
    def largest(self) -> int:
        """How many rows the largest part of a main inequality has."""
        return max(int(np.bincount(label).max()) for label in self._row_labels[: self._main])

    def constraints(
        self,
        fixed: Mapping[str, float] | None = None,
        *,
        multiples: Mapping[str, float] | None = None,
        at: At | None = None,
    ) -> tuple[list[Constraint], list[Constraint]]:
        """Return the main inequalities and the others, each cut into its parts.

        fixed : numbers that are known; they have no column.
        multiples : of their units, in which other numbers are counted here.
        at : where weights depend on parameters.
        """
        free, given = self._free(fixed or {}), self._given(fixed or {})
        factors = self._factors({**(multiples or {}), **(at.unknowns if at else {})})
        change = factors if (factors != 1.0).any() else None

        def of(form: _Form) -> Constraint:
            one, names = form
            if isinstance(one, Weighed):
                if at is None:
                    raise ValueError("expected parameters: weights depend on them")
                return one.constraint(names, at, free=free, given=given, factors=factors)
            constant = one.constant + one.columns @ given if given.any() else one.constant
            columns = np.asarray(one.columns)[:, free]
            return Constraint(
                one.size, constant, columns if change is None else columns * change[free]
            )

        main, others = ([of(one) for one in each] for each in self._unfixed)
        return main, others

    def product(
        self, multipliers: Sequence[Array], y: Array, fixed: Mapping[str, float] | None, at: At
    ) -> Callable[[At], float]:
        """Return sum_k <Z_k, M_k(y)> over the parts of the main inequalities, as weights change.

        multipliers : Z of every part.
        y : the unknowns that are not fixed, in the units at `at`, which they keep.
        """
        entries = self._given(fixed or {})
        entries[self._free(fixed or {})] = y
        entries = np.append(entries * self._factors(at.unknowns), 1.0)
        parts, of_numbers = [], 0.0
        for Z, (form, names) in zip(multipliers, self._unfixed[0], strict=True):
            if isinstance(form, Constraint):
                of_numbers += float(svec(Z) @ (form.constant + form.columns @ entries[:-1]))
                continue
            each = svec(Z)[form.indices] * np.repeat(entries, np.diff(form.ends))
            parts.append((form, names, each))

        def value(at: At) -> float:
            return of_numbers + sum(
                float(form.weights_at(at) @ (form.data @ (each * form.units_at(names, at))))
                for form, names, each in parts
            )

        return value

    def _given(self, fixed: Mapping[str, float]) -> Array:
        """Return (width,) what is known, in its units."""
        given = np.zeros(self.width)
        for name, number in fixed.items():
            if name in self.columns:
                given[self.columns[name]] = number / self._scales[name][0][0] ** 2
        return given

    def _factors(self, of_unknowns: Mapping[str, float]) -> Array:
        factors = np.ones(self.width)
        for name, factor in of_unknowns.items():
            if name in self.columns:
                factors[self.columns[name]] = factor
        return factors

    def values(
        self, y: Array, fixed: Mapping[str, float] | None = None, *, at: At | None = None
    ) -> dict[str, Any]:
        """Return the unknowns of a point in the units of the inequalities, numbers as floats."""
        values: dict[str, Any] = dict(fixed or {})
        entries = np.zeros(self.width)
        entries[self._free(values)] = y
        if at is not None:
            entries *= self._factors(at.unknowns)
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

    def trace(self, unknown: str, fixed: Mapping[str, float] | None = None) -> Array:
        """Return (free unknowns,) what gives the trace of a matrix, in its units."""
        weights, (a, b) = np.zeros(self.width), self._kept[unknown]
        weights[self.columns[unknown]] = a == b
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

    def _constraint(self, form: list[Product], at: Indices) -> Constraint:
        size = len(at) * (len(at) + 1) // 2
        constant, columns = np.zeros(size), np.zeros((size, self.width))
        for t in form:
            for these, entries in self._columns_of(t, at):
                if these is None:
                    constant += t.weight * entries[:, 0]
                else:
                    columns[:, these] += t.weight * entries
        return Constraint(len(at), constant, columns)

    def _columns_of(self, t: Product, at: Indices) -> Iterator[Columns]:
        """Yield columns, and the svec of a term but for its weight in each; None: the constant."""
        L, R = t.left[:, at], t.right[:, at]
        if not (L.any() and R.any()):
            return  # of another part
        if t.unknown in self.shapes and not t.is_number:
            yield from self._columns_of_matrix(t.unknown, L, R)
            return
        half = L.T @ R
        term = svec(half + half.T)[:, None]
        if t.unknown in self.shapes:
            columns = self.columns[t.unknown]
            yield np.arange(columns.start, columns.stop), self._scales[t.unknown][0] ** 2 * term
        else:
            yield None, term

    def _columns_of_matrix(
        self, unknown: str, L: Array, R: Array
    ) -> Iterator[tuple[Indices, Array]]:
        one, other = self._scales[unknown]
        L, R = one[:, None] * L, other[:, None] * R
        a, b = self._kept[unknown]
        symmetric = self.shapes[unknown].symmetric
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
            entries = svec(outer + np.swapaxes(outer, 1, 2)).T
            yield self.columns[unknown].start + these, entries
