"""Inequalities of `cosim.hinf.theorems`, compiled for an SDP solver.

All of it follows from the terms: the columns of every unknown, units in which no coefficient is
far from one, and the parts that nothing connects. A change of sign of one part changes no
constant, so the mean of a solution over all such changes is a solution too, with unknowns that do
not connect the parts: one small matrix for each part loses nothing, and the four axes of the
vehicle are solved in a tenth of the time.

Where weights depend on parameters, the columns of every weight are kept: other parameters take
another sum of them.

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
from cosim.hinf.lmi.svec import Array, places, svec
from cosim.hinf.theorems import Inequality, Shape, Signal, shapes_of, value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from cosim.hinf.theorems import Term, Weight

Indices = NDArray[np.signedinteger[Any]]

_CHUNK = 256
"""Columns that are computed at once."""


class _Product(NamedTuple):
    """A term in doubles, its signals as maps of all rows, in units of the rows."""

    unknown: str | None
    left: Array
    right: Array
    weight: Weight
    is_number: bool


class At(NamedTuple):
    """Where weights are taken, and units that go with it.

    parameters : of the weights.
    rows : a row is this times what it has in units of the program, by name; 1 elsewhere.
    unknowns : likewise for unknowns.
    """

    parameters: Any
    rows: Mapping[str, float]
    unknowns: Mapping[str, float]


class _Weighed(NamedTuple):
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


_Form = tuple[Constraint | _Weighed, list[str]]
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
        self._forms = [_products_of(one, units) for one in main]
        given = {k: (np.full(1, np.sqrt(v)),) * 2 for k, v in (numbers or {}).items()}
        given |= matrices or {}
        self._scales = self._units_of_unknowns({k: v for k, v in given.items() if k in self.shapes})
        for one in others:
            form = _products_of(one, units_of_others or {})
            has_units = any(name in (units_of_others or {}) for name in one.rows)
            self._forms.append(form if has_units else self._in_units_of_rows(form))
        self._inequality_names = [one.name for one in (*main, *others)]
        self._names = [
            [name for name, size in one.rows.items() for _ in range(size)]
            for one in (*main, *others)
        ]
        self._rows = [len(names) for names in self._names]
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
    def _unfixed(self) -> tuple[list[_Form], list[_Form]]:
        """The main inequalities and the others, each cut into its parts, nothing fixed."""
        cut: tuple[list[_Form], list[_Form]] = ([], [])
        for k, (form, names) in enumerate(zip(self._forms, self._names, strict=True)):
            for at in self._cuts(k):
                own = [names[i] for i in at]
                of_numbers = all(not callable(t.weight) for t in form)
                make = self._constraint if of_numbers else self._weighed
                cut[k >= self._main].append((make(form, at), own))
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
        return [np.flatnonzero(label == part) for part in np.unique(label)]

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
            if isinstance(one, _Weighed):
                return self._sum(one, names, at, free, given, factors)
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

    def _sum(
        self,
        form: _Weighed,
        names: list[str],
        at: At | None,
        free: Indices,
        given: Array,
        factors: Array,
    ) -> Constraint:
        """Return the sum with these weights, in the units that go with them."""
        if at is None:
            raise ValueError("expected parameters: weights depend on them")
        data = (form.weights_at(at) @ form.data) * form.units_at(names, at)
        counts = np.diff(form.ends)
        data *= np.repeat(np.append(factors, 1.0), counts)
        height = form.size * (form.size + 1) // 2
        known = np.append(given, 1.0)  # the last column is the constant
        constant = np.zeros(height)
        for column in np.flatnonzero(known):
            these = slice(form.ends[column], form.ends[column + 1])
            constant[form.indices[these]] += known[column] * data[these]
        keep = np.zeros(self.width + 1, dtype=bool)
        keep[free] = True
        stays = np.repeat(keep, counts)
        ends = np.concatenate([[0], np.cumsum(counts[keep])])
        columns = scipy.sparse.csc_array(
            (data[stays], form.indices[stays], ends), shape=(height, len(free))
        )
        return Constraint(form.size, constant, columns)

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

    def _units_of_unknowns(
        self, given: Mapping[str, tuple[Array, Array]]
    ) -> dict[str, tuple[Array, Array]]:
        """Return factors of rows and columns that make every coefficient of the size of one."""
        size = {
            name: (np.zeros(shape.height), np.zeros(shape.width))
            for name, shape in self.shapes.items()
        }
        for t in (t for form in self._forms for t in form):
            if t.unknown is None or t.unknown not in size or t.unknown in given:
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
        return units | dict(given)

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
            for these, entries in self._columns_of(t, at):
                if these is None:
                    constant += t.weight * entries[:, 0]
                else:
                    columns[:, these] += t.weight * entries
        return Constraint(len(at), constant, columns)

    def _weighed(self, form: list[_Product], at: Indices) -> _Weighed:
        """Return the matrix of every weight; all of numbers go into one."""
        size = len(at) * (len(at) + 1) // 2
        weights: list[Weight] = [1.0]
        pieces: list[tuple[Indices, Array, Indices]] = []
        for t in form:
            owner, factor = (len(weights), 1.0) if callable(t.weight) else (0, t.weight)
            for these, entries in self._columns_of(t, at):
                i, j = np.nonzero(entries)
                column = np.full(len(j), self.width) if these is None else these[j]
                pieces.append((column * size + i, factor * entries[i, j], np.full(len(i), owner)))
            if owner:
                weights.append(t.weight)
        keys, values, owners = (np.concatenate(each) for each in zip(*pieces, strict=True))
        pattern, slot = np.unique(keys, return_inverse=True)
        data = scipy.sparse.csr_array(
            scipy.sparse.coo_array((values, (owners, slot)), shape=(len(weights), len(pattern)))
        )
        ends = np.searchsorted(pattern // size, np.arange(self.width + 2))
        return _Weighed(len(at), weights, data, pattern % size, ends)

    def _columns_of(self, t: _Product, at: Indices) -> Iterator[tuple[Indices | None, Array]]:
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


def _products_of(one: Inequality, units: Mapping[str, Array]) -> list[_Product]:
    """Return the terms of an inequality in doubles."""
    row = np.concatenate([units.get(name, np.ones(size)) for name, size in one.rows.items()])
    known: dict[int, Array] = {}

    def floats(signal: Signal) -> Array:
        if id(signal) not in known:
            known[id(signal)] = signal.floats_on(one.rows) * row
        return known[id(signal)]

    def product(t: Term) -> _Product:
        weight = t.weight if callable(t.weight) else float(t.weight)
        return _Product(t.unknown, floats(t.left), floats(t.right), weight, t.is_number)

    return [product(t) for t in one.terms]


def _inverse(size: Array) -> Array:
    """Return 1 / size, 1 where it is zero."""
    return np.asarray(1.0 / np.where(size > 0, size, 1.0))
