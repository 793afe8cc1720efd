"""Enclose what a function changes by over a box, as a matrix times the change of its argument.

For f of a vector x in the box |x - x0| <= r, go from x0 to x one variable after the other:

    f(x) - f(x0) = sum_j m_j(x) (x_j - x0_j),
    m_j(x) = mean over 0 <= t <= 1 of df/dx_j at (x before j, x0_j + t (x_j - x0_j), x0 after j).

That is exact for every order of the variables, and the order says which of two factors carries the
uncertainty of a product: the later one. The mean is enclosed piece by piece of the ray. What is
linear in t has its mean exactly, so a quadratic term costs half of its slope; -d |v| v lies in
[-d v_bar, 0], not in [-2 d v_bar, 0], up to one part in the number of pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim.hinf.problem.affine_dual import AFFINE, AffineDual, dual
from cosim.hinf.problem.affine_form import AffineForm, Bounds, new_symbol

Function = Callable[[Sequence[Any], Any], Sequence[Any]]
"""Equations: the variables, and the namespace of functions for them, to the values."""

PIECES = 64


def mean_jacobian(
    function: Function,
    centre: Sequence[float],
    radius: Sequence[float],
    order: Sequence[int],
    pieces: int = PIECES,
) -> tuple[Bounds, Bounds]:
    """Return bounds (rows, N) of m_j(x) over the box, in the order of the variables.

    An entry is not a number where the equations are not defined, or not differentiable, over the
    box, or depend on a variable without a bound.

    Parameters
    ----------
    centre, radius : x0 and r (N,); a radius may be infinite for a variable that nothing depends on.
    order : the variables, in the order in which they move. One that is not among them is anywhere
        in its box all the time, and its column is zero: what it changes, `change_of` bounds.
    """
    count = len(order)
    place = {j: p for p, j in enumerate(order)}
    turn = np.repeat(np.arange(count), pieces)
    share = np.tile((np.arange(pieces) + 0.5) / pieces, count)
    symbols, within = [new_symbol() for _ in centre], new_symbol()
    variables = []
    for j, (middle, size) in enumerate(zip(centre, radius, strict=True)):
        mine, moved = turn == place.get(j, -1), turn > place.get(j, -1)
        parts = {symbols[j]: np.where(mine, share * size, np.where(moved, size, 0.0))}
        if mine.any():
            parts[within] = np.where(mine, size / (2 * pieces), 0.0)
        slope = AffineForm(mine.astype(float)) if mine.any() else None
        variables.append(AffineDual(AffineForm(middle, parts, 0.0), slope))
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        rows = [dual(row).slope for row in function(variables, AFFINE)]
        lower, upper = np.zeros((2, len(rows), len(centre)))
        for i, row in enumerate(rows):
            if row is not None:
                mean, spread = _mean(row, symbols, within, count)
                lower[i, list(order)], upper[i, list(order)] = mean - spread, mean + spread
    return lower, upper


def jacobian(
    function: Function, centre: Sequence[Any], radius: Sequence[Any], columns: Sequence[int]
) -> tuple[Bounds, Bounds]:
    """Return bounds (cells, rows, columns) of df/dx_j in cells of a box.

    Parameters
    ----------
    centre, radius : per variable a number, or an array with one entry per cell.
    """
    cells = max(np.size(value) for value in (*centre, *radius))
    turn = np.repeat(np.arange(len(columns)), cells)
    variables = []
    for j, (middle, size) in enumerate(zip(centre, radius, strict=True)):
        about, parts = (
            np.tile(np.broadcast_to(value, cells), len(columns)) for value in (middle, size)
        )
        form = AffineForm(about, {new_symbol(): parts} if np.any(parts) else None)
        mine = turn == (columns.index(j) if j in columns else -1)
        slope = AffineForm(mine.astype(float)) if mine.any() else None
        variables.append(AffineDual(form, slope))
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        rows = [dual(row).slope or AffineForm(0.0) for row in function(variables, AFFINE)]
        ends = np.array([[np.broadcast_to(end, turn.size) for end in x.bounds] for x in rows])
    bounds = ends.reshape(len(rows), 2, len(columns), cells)
    return bounds[:, 0].transpose(2, 0, 1), bounds[:, 1].transpose(2, 0, 1)


def _mean(
    slope: AffineForm, symbols: Sequence[int], within: int, count: int
) -> tuple[Bounds, Bounds]:
    """Return middle and radius, per variable, of the mean of a slope over the pieces of its ray.

    Symbols of the variables are the same in every piece; what an operation left unknown may differ
    from piece to piece.
    """

    def mean(values: Any) -> Bounds:
        K = slope.middle.size if slope.middle.ndim else 1
        shape = max(np.size(values), K)
        spread = np.broadcast_to(values, shape) if shape % count == 0 else np.full(count, values)
        return np.asarray(np.mean(spread.reshape(count, -1), axis=1))

    middle, size = mean(slope.middle), mean(slope.rest)
    for k, share in slope.parts.items():
        if k != within:
            size = size + (np.abs(mean(share)) if k in symbols else mean(np.abs(share)))
    return middle, size + (np.abs(middle) + size) * 2.0**-40 * (size > 0)


def change_of(
    function: Function, centre: Sequence[float], radius: Sequence[float]
) -> tuple[Bounds, Bounds]:
    """Return bounds (rows,) of f(x) - f(x0) over the box."""
    with np.errstate(invalid="ignore"):
        point = function([dual(value) for value in centre], AFFINE)
        moved = [AffineForm(c, {new_symbol(): r}) for c, r in zip(centre, radius, strict=True)]
        box = function([dual(form) for form in moved], AFFINE)
        ends = [(dual(b) - dual(a)).value.bounds for a, b in zip(point, box, strict=True)]
    return np.array([float(a) for a, _ in ends]), np.array([float(b) for _, b in ends])
