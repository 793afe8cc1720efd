"""Quadratic forms in named blocks, exactly: what a proof shows to be positive definite.

A form is built up from products of linear maps of its vector; a map has, for each block that it
reads, the matrix that acts on it.
"""

from __future__ import annotations

from typing import Any

import flint

from cosim.hinf.certificate.rational import first_bad_pivot, lower_triangle

Map = dict[str, Any]
"""A linear map of the rows: name of a block -> the matrix that acts on it."""


class Form:
    """A quadratic form in named blocks, built up from products of linear maps."""

    def __init__(self, sizes: dict[str, int]) -> None:
        self.sizes = dict(sizes)
        self._place = {name: i for i, name in enumerate(sizes)}
        self._blocks: dict[tuple[str, str], Any] = {}

    def square(self, left: Map, middle: Any) -> None:
        """Add left'M left, M symmetric."""
        for a, one in left.items():
            for b, other in left.items():
                if self._place[a] <= self._place[b]:
                    self._put(a, b, one.transpose() * middle * other)

    def twice(self, left: Map, middle: Any, right: Map) -> None:
        """Add left'M right and its transpose."""
        for a, one in left.items():
            for b, other in right.items():
                term = one.transpose() * middle * other
                if self._place[a] <= self._place[b]:
                    self._put(a, b, term)
                if self._place[b] <= self._place[a]:
                    self._put(b, a, term.transpose())

    def twice_of(self, lefts: list[Map], middle: Any, rights: list[Map]) -> None:
        """Add the same for stacked maps."""
        row = 0
        for left in lefts:
            height, column = height_of(left), 0
            for right in rights:
                width = height_of(right)
                self.twice(left, cut(middle, row, column, height, width), right)
                column += width
            row += height

    def square_of(self, lefts: list[Map], middle: Any) -> None:
        """Add left'M left for stacked maps, M symmetric."""
        self.twice_of(lefts, flint.fmpq(1, 2) * middle, lefts)

    def _put(self, row: str, column: str, term: Any) -> None:
        key = row, column
        self._blocks[key] = self._blocks[key] + term if key in self._blocks else term

    def lower(self) -> tuple[list[list[Any]], list[str]]:
        """Return the lower triangle, row by row, and the block name of every row."""
        names = [name for name in self.sizes for _ in range(self.sizes[name])]
        return lower_triangle(list(self.sizes), self.sizes, self._blocks), names

    def failure(self, name: str) -> str | None:
        """Return why this form, called `name`, is not proved positive definite; None if it is."""
        lower, names = self.lower()
        bad = first_bad_pivot(lower)
        if bad is None:
            return None
        return (
            f"{name} is not positive definite: pivot {bad + 1} of {len(lower)}, "
            f"in the rows of {names[bad]}, is not positive"
        )


def height_of(one: Map) -> int:
    """Return how many rows a map makes."""
    return int(next(iter(one.values())).nrows())


def cut(matrix: Any, row: int, column: int, height: int, width: int) -> Any:
    """Return a block of a `flint.fmpq_mat`."""
    entries = [matrix[row + a, column + b] for a in range(height) for b in range(width)]
    return flint.fmpq_mat(height, width, entries)
