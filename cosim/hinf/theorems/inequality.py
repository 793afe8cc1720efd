"""Matrix inequalities, written once: a theorem is a list of terms over named rows.

A *signal* is a linear map of named rows (name of a row block -> the matrix that acts on it), a
*term* is weight (L'U R + its transpose) of two signals and an unknown U, and an inequality is a
sum of terms that must be positive definite. An unknown is known by its name; its shape, and
whether it is symmetric, follow from the terms. A weight is a number, or a function of parameters
in which a search moves: `fixed` puts them in, as rationals for a proof.

Matrices are exact (`flint.fmpq_mat`), and so is the proof: no rounding, no solver.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import flint
import numpy as np

from cosim.hinf.exact import first_bad_pivot, identity, lower_triangle

if TYPE_CHECKING:
    from cosim.models import Matrix

HALF = flint.fmpq(1, 2)

Weight = Any
"""A number, or a function of parameters that returns one of the kind of the parameters."""


class Signal:
    """A linear map of named rows: name of a row block -> the matrix that acts on it."""

    def __init__(self, maps: dict[str, Any]) -> None:
        self.maps = maps

    @property
    def height(self) -> int:
        """How many numbers it has."""
        return int(next(iter(self.maps.values())).nrows())

    def on(self, rows: Mapping[str, int]) -> Any:
        """Return it as one matrix that acts on all rows."""
        matrix = flint.fmpq_mat(self.height, sum(rows.values()))
        first = 0
        for name, size in rows.items():
            if name in self.maps:
                for i, entry in enumerate(self.maps[name].entries()):
                    matrix[i // size, first + i % size] = entry
            first += size
        return matrix

    def floats_on(self, rows: Mapping[str, int]) -> Matrix:
        """Return it as one matrix of doubles, rounded."""
        matrix = np.zeros((self.height, sum(rows.values())))
        first = 0
        for name, size in rows.items():
            if name in self.maps:
                entries = [float(entry) for entry in self.maps[name].entries()]
                matrix[:, first : first + size] = np.reshape(entries, (self.height, size))
            first += size
        return matrix

    def __add__(self, other: Signal) -> Signal:
        mine, more = self.maps, other.maps
        both = {name: mine[name] + more[name] for name in mine.keys() & more.keys()}
        return Signal({**mine, **more, **both})

    def __sub__(self, other: Signal) -> Signal:
        return self + -1 * other

    def __rmul__(self, factor: Any) -> Signal:
        """Return a multiple of it, or a matrix times it."""
        return Signal({name: factor * M for name, M in self.maps.items()})

    def rows(self, of: slice) -> Signal:
        """Return some of its numbers."""
        return Signal({name: _rows_of(M, of) for name, M in self.maps.items()})


def _rows_of(matrix: Any, of: slice) -> Any:
    """Return rows of a `flint.fmpq_mat`."""
    chosen = range(matrix.nrows())[of]
    width = matrix.ncols()
    return flint.fmpq_mat(len(chosen), width, [matrix[i, j] for i in chosen for j in range(width)])


def stack(signals: Sequence[Signal]) -> Signal:
    """Return signals one below the other."""
    if len(signals) == 1:
        return signals[0]
    widths = {name: M.ncols() for s in signals for name, M in s.maps.items()}
    return Signal(
        {
            name: flint.fmpq_mat(
                sum(s.height for s in signals),
                width,
                [
                    entry
                    for s in signals
                    for entry in (
                        s.maps[name].entries() if name in s.maps else [0] * (s.height * width)
                    )
                ],
            )
            for name, width in widths.items()
        }
    )


Sum = Sequence[tuple[Weight, Signal]]
"""Signals with weights, to be added."""


def value_of(weight: Weight, parameters: Any) -> Any:
    """Return a weight at these parameters."""
    return weight(parameters) if callable(weight) else weight


def product(*weights: Weight) -> Weight:
    """Return the product of weights: a function where one of them is."""
    functions = [weight for weight in weights if callable(weight)]
    number = math.prod(weight for weight in weights if not callable(weight))

    def of(parameters: Any) -> Any:
        value = math.prod(function(parameters) for function in functions)
        return float(number) * value if isinstance(value, float) else number * value

    return of if functions else number


class Term(NamedTuple):
    """weight (left'U right + its transpose); `unknown` None: U = 1, `is_number`: U is a number."""

    unknown: str | None
    left: Signal
    right: Signal
    weight: Weight
    is_number: bool = False


class Shape(NamedTuple):
    """Rows and columns of an unknown, whether it is symmetric, and whether it is a number."""

    height: int
    width: int
    symmetric: bool
    is_number: bool


class Inequality:
    """A sum of terms that must be positive definite.

    Parameters
    ----------
    name : as messages call it.
    rows : size of each row block, in order.
    """

    def __init__(self, name: str, rows: dict[str, int]) -> None:
        self.name, self.rows = name, rows
        self.terms: list[Term] = []

    def row(self, name: str) -> Signal:
        """Return a block of rows."""
        return Signal({name: identity(self.rows[name])})

    def square(self, unknown: str, signal: Signal, weight: Weight = 1) -> None:
        """Add weight s'U s, U symmetric."""
        self.terms.append(Term(unknown, signal, signal, product(HALF, weight)))

    def twice(
        self,
        unknown: str | None,
        left: Signal,
        right: Signal,
        weight: Weight = 1,
        *,
        is_number: bool = False,
    ) -> None:
        """Add weight (left'U right + its transpose); `unknown` None: of the two alone."""
        self.terms.append(Term(unknown, left, right, weight, is_number))

    def sums(
        self,
        unknown: str | None,
        left: Sum,
        right: Sum,
        weight: Weight = 1,
        *,
        is_number: bool = False,
    ) -> None:
        """Add weight (left'U right + its transpose) of two sums, term by term."""
        for a, L in left:
            for b, R in right:
                self.twice(unknown, L, R, product(weight, a, b), is_number=is_number)

    def number(self, unknown: str | None, signal: Signal, weight: Weight = 1) -> None:
        """Add weight u s's, u a number; `unknown` None: 1."""
        self.terms.append(Term(unknown, signal, signal, product(HALF, weight), is_number=True))

    def fixed(self, parameters: Any) -> Inequality:
        """Return the inequality with every weight a number."""
        form = Inequality(self.name, self.rows)
        form.terms = [t._replace(weight=value_of(t.weight, parameters)) for t in self.terms]
        return form

    def renamed(self, prefix: str, keep: Container[str]) -> Inequality:
        """Return it with `prefix` before the names of its rows, and of all unknowns but `keep`."""
        form = Inequality(
            prefix + self.name, {prefix + name: size for name, size in self.rows.items()}
        )
        signals: dict[int, Signal] = {}  # one that stands twice stays one: so U is symmetric

        def of(signal: Signal) -> Signal:
            maps = {prefix + name: M for name, M in signal.maps.items()}
            return signals.setdefault(id(signal), Signal(maps))

        for t in self.terms:
            named = t.unknown if t.unknown is None or t.unknown in keep else prefix + t.unknown
            form.terms.append(t._replace(unknown=named, left=of(t.left), right=of(t.right)))
        return form

    def at(self, values: Mapping[str, Any]) -> list[list[Any]]:
        """Return the lower triangle, row by row, at rationals: `fmpq_mat` and `fmpq` by name."""
        place = {name: i for i, name in enumerate(self.rows)}
        blocks: dict[tuple[str, str], Any] = {}
        for unknown, left, right, weight, _ in self.terms:
            U = weight if unknown is None else weight * values[unknown]
            for b, R in right.maps.items():
                UR = U * R
                for a, L in left.maps.items():
                    term = L.transpose() * UR
                    if place[a] <= place[b]:
                        _put(blocks, a, b, term)
                    if place[b] <= place[a]:
                        _put(blocks, b, a, term.transpose())
        return lower_triangle(list(self.rows), self.rows, blocks)

    def failure(self, values: Mapping[str, Any]) -> str | None:
        """Return why it is not proved at these rationals; None if it is."""
        lower = self.at(values)
        bad = first_bad_pivot(lower)
        if bad is None:
            return None
        if len(self.rows) == 1:
            return f"{self.name} is not positive definite"
        names = [name for name, size in self.rows.items() for _ in range(size)]
        return (
            f"{self.name} is not positive definite: pivot {bad + 1} of {len(lower)}, "
            f"in the rows of {names[bad]}, is not positive"
        )


def _put(blocks: dict[tuple[str, str], Any], row: str, column: str, term: Any) -> None:
    key = row, column
    blocks[key] = blocks[key] + term if key in blocks else term


def itself(name: str, size: int) -> Inequality:
    """Return the inequality that an unknown alone is positive definite."""
    form = Inequality(name, {name: size})
    form.square(name, form.row(name))
    return form


def number_itself(name: str) -> Inequality:
    """Return the inequality that an unknown number alone is positive."""
    form = Inequality(name, {name: 1})
    form.number(name, form.row(name))
    return form


def shapes_of(inequalities: Iterable[Inequality]) -> dict[str, Shape]:
    """Return the shape of every unknown, from how it is used."""
    shapes: dict[str, Shape] = {}
    for unknown, left, right, _, is_number in (t for one in inequalities for t in one.terms):
        if unknown is None:
            continue
        symmetric = left is right or (unknown in shapes and shapes[unknown].symmetric)
        size = (1, 1) if is_number else (left.height, right.height)
        shapes[unknown] = Shape(*size, symmetric, is_number)
    return shapes


def first_failure(inequalities: Iterable[Inequality], values: Mapping[str, Any]) -> str | None:
    """Return why the first inequality that is not proved is not; None if all are."""
    reasons = (one.failure(values) for one in inequalities)
    return next((reason for reason in reasons if reason is not None), None)
