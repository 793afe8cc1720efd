"""Uncertainty matrices E, H and their blocks from the enclosure of a mean Jacobian.

Every entry of the matrix that is not known is the centre and |delta| <= its radius: a (1, 1) block
of F, with a multiplier of its own in the LMI. Entries that are a matrix of known norm, as those of
a rotation are, make one full block. Constants that are known to twelve digits count as known: the
equations of the plant are computed in doubles as well.

Which of two factors carries the uncertainty of a product is free (`mean_jacobian`), and affects
gamma. `order_of_variables` decides it by the loop gain of the uncertainty: with q the radii, and g
the gains of a nominal loop from an error of each row to each variable, the worst case grows along
the Perron vector of q g; the variable that moves least in it, in share of its bound, comes last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_KNOWN = 1e-12
_FREQUENCIES = np.logspace(-3, 2, 120)


class NormBlock(NamedTuple):
    """A part of the matrix whose deviation from its centre has at most this 2-norm."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    norm: float


class UncertainMatrix(NamedTuple):
    """centre + E F H, F block-diagonal; `E` (n, s), `H` (r, N) and `blocks` as a `DelaySystem`."""

    centre: Matrix
    E: Matrix
    H: Matrix
    blocks: tuple[tuple[int, int], ...]


def centre_and_radius(lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """Return doubles in the middle of the bounds, and radii rounded up; 0 where it is known."""
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    # what is symmetric about zero, or about a number that has few digits, is so but for rounding
    middle = np.where(np.abs(middle) <= 1e-9 * half, 0.0, middle)
    row = np.abs(middle).max(axis=1, initial=0.0, keepdims=True)
    middle = np.where(np.abs(middle) <= _KNOWN * row, 0.0, middle)
    known = half <= _KNOWN * np.maximum(np.abs(middle), 1.0)
    short = _digits(middle, 12)
    centre = np.where(known, np.where(np.abs(short - middle) <= half, short, middle), short)
    radius = np.nextafter(np.maximum(upper - centre, centre - lower), math.inf)
    return centre + 0.0, np.where(known, 0.0, radius)


def uncertain_matrix(
    centre: Matrix, radius: Matrix, wholes: Sequence[NormBlock] = ()
) -> UncertainMatrix:
    """Return the factors, rounded outward: `wholes` first, then every other entry, by rows."""
    left = radius.copy()
    columns, rows, blocks = [], [], []
    n, size = radius.shape
    for form in wholes:
        left[np.ix_(form.rows, form.columns)] = 0.0
        root = _root(form.norm)
        columns += [root * _unit(n, i) for i in form.rows]
        rows += [root * _unit(size, j) for j in form.columns]
        blocks.append((len(form.rows), len(form.columns)))
    for i, j in np.argwhere(left > 0):
        columns.append(_root(left[i, j]) * _unit(n, i))
        rows.append(_root(left[i, j]) * _unit(size, j))
        blocks.append((1, 1))
    E = np.array(columns).T if columns else np.zeros((n, 0))
    H = np.array(rows) if rows else np.zeros((0, size))
    return UncertainMatrix(centre, E, H, tuple(blocks))


def _unit(size: int, place: int) -> Matrix:
    unit = np.zeros(size)
    unit[place] = 1.0
    return unit


def _root(value: float) -> float:
    """Return a double whose square, even as a product of doubles, is not below the value."""
    return math.sqrt(value) * (1 + 4 * math.ulp(1.0))


def _digits(values: Matrix, digits: int) -> Matrix:
    return np.array([[float(f"{value:.{digits}g}") for value in row] for row in values])


def loop_gains(A: Matrix, B: Matrix, weights: Matrix) -> Matrix | None:
    """Return the gains (n, n) of a nominal loop, from row i of an error to state j as [j, i].

    The loop is the linear-quadratic one of |weights x|^2 + |u|^2; None where the control does not
    stabilise A.
    """
    from scipy.linalg import solve_continuous_are  # noqa: PLC0415 - slow to import

    n, m = B.shape
    try:
        P = solve_continuous_are(A, B, np.diag(weights**2) + 1e-9 * np.eye(n), np.eye(m))
    except (ValueError, np.linalg.LinAlgError):  # SciPy's, where it cannot order the roots
        return None
    closed = A - B @ B.T @ P
    if not np.linalg.eigvals(closed).real.max() < 0:
        return None
    one = np.eye(n)
    responses = np.linalg.inv(1j * _FREQUENCIES[:, None, None] * one - closed)
    return np.asarray(np.abs(responses).max(axis=0))


def order_of_variables(q: Matrix, g: Matrix, bounds: Matrix) -> list[int]:
    """Return the columns of q (n, n), those that move most in share of their bounds first.

    q, g : radii of the uncertainty, and gains from an error of row i to state j as g[j, i].
    """
    product = q @ g
    product = product + 1e-9 * product.max(initial=1e-300)
    values, vectors = np.linalg.eig(product)
    x = np.abs(vectors[:, int(np.argmax(values.real))].real)
    # digits of a library must not decide: a tie goes by the number of the column
    share = [float(f"{value:.6g}") for value in (g @ x) / bounds]
    return sorted(range(len(share)), key=lambda j: (-share[j], j))
