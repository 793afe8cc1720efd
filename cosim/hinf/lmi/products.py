"""The terms of inequalities in doubles: units in which they are near one, and parts.

A change of sign of one part changes no constant, so the mean of a solution over all such changes is
a solution too, with unknowns that do not connect the parts: one small matrix for each part loses
nothing, and the four axes of the vehicle are solved in a tenth of the time.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.lmi.svec import Array

if TYPE_CHECKING:
    from cosim.hinf.theorems import Inequality, Shape, Signal, Term, Weight

Indices = NDArray[np.signedinteger[Any]]
Units = Mapping[str, tuple[Array, Array]]
"""Of an unknown by name: an entry is a unit of its row times one of its column times what the
solver has."""


class Product(NamedTuple):
    """A term in doubles, its signals as maps of all rows, in units of the rows."""

    unknown: str | None
    left: Array
    right: Array
    weight: Weight
    is_number: bool


def products_of(one: Inequality, units: Mapping[str, Array]) -> list[Product]:
    """Return the terms of an inequality in doubles."""
    row = np.concatenate([units.get(name, np.ones(size)) for name, size in one.rows.items()])
    known: dict[int, Array] = {}

    def floats(signal: Signal) -> Array:
        if id(signal) not in known:
            known[id(signal)] = signal.floats_on(one.rows) * row
        return known[id(signal)]

    def product(t: Term) -> Product:
        weight = t.weight if callable(t.weight) else float(t.weight)
        return Product(t.unknown, floats(t.left), floats(t.right), weight, t.is_number)

    return [product(t) for t in one.terms]


def units_of_unknowns(
    forms: Iterable[list[Product]], shapes: Mapping[str, Shape], given: Units
) -> dict[str, tuple[Array, Array]]:
    """Return factors of rows and columns that make every coefficient of the size of one.

    given : those that are known; weights of these unknowns may be functions.
    """
    size = {name: (np.zeros(shape.height), np.zeros(shape.width)) for name, shape in shapes.items()}
    for t in (t for form in forms for t in form):
        if t.unknown is None or t.unknown not in size or t.unknown in given:
            continue
        left, right = (np.linalg.norm(M, axis=1) for M in (t.left, t.right))
        if t.is_number:  # 2 w |left| |right|, entry by entry of what is multiplied
            largest = np.sqrt(2 * abs(t.weight) * float((left * right).max(initial=0.0)))
            left = right = np.full(1, largest)
        else:
            left, right = (np.sqrt(abs(t.weight)) * x for x in (left, right))
        if shapes[t.unknown].symmetric:
            left = right = np.sqrt(left * right)
        for known, more in zip(size[t.unknown], (left, right), strict=True):
            np.maximum(known, more, out=known)
    units = {name: (_inverse(left), _inverse(right)) for name, (left, right) in size.items()}
    return units | {name: unit for name, unit in given.items() if name in shapes}


def in_units_of_rows(form: list[Product], units: Units) -> list[Product]:
    """Return an inequality with each row in units in which the first unknown is about one.

    units : of the unknowns.
    """
    size = np.zeros(form[0].left.shape[1])
    for t in form:
        left, right = t.left, t.right
        weight = 2 * abs(t.weight)
        if t.unknown is not None and t.unknown in units:
            one, other = units[t.unknown]
            if t.is_number:
                weight *= float(one[0] ** 2)
            else:
                left, right = one[:, None] * left, other[:, None] * right
        sizes = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=0)
        size = np.where(size > 0, size, weight * sizes)
    unit = _inverse(np.sqrt(size))
    return [t._replace(left=t.left * unit, right=t.right * unit) for t in form]


def parts_of(
    forms: Sequence[list[Product]], shapes: Mapping[str, Shape]
) -> tuple[dict[str, tuple[Indices, Indices]], list[Indices]]:
    """Return the part of every row and column of the unknowns, and of all rows of the forms."""
    start: dict[str, tuple[int, int]] = {}
    count = 0
    for name, shape in shapes.items():
        if shape.is_number:
            continue
        second = count if shape.symmetric else count + shape.height
        start[name] = count, second
        count = second + shape.width
    first = count + np.cumsum([0, *(form[0].left.shape[1] for form in forms)])
    links: list[tuple[Indices, Indices]] = []
    for form, at in zip(forms, first, strict=False):
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
        for name, shape in shapes.items()
    }
    return of_unknowns, [label[a:b] for a, b in itertools.pairwise(first)]


def _inverse(size: Array) -> Array:
    """Return 1 / size, 1 where it is zero."""
    return np.asarray(1.0 / np.where(size > 0, size, 1.0))
