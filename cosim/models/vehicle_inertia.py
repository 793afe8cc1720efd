"""Mass matrix of a vehicle, its inverse, and the Coriolis and centripetal forces.

    M = M_RB + M_A,   M_RB = [[m I, -m S(r_g)], [m S(r_g), I_o]],   M_A = -[X_udot ...]
    C(nu) = [[0, -S(a)], [-S(a), -S(b)]],   (a, b) = M nu          (Fossen 2021, ch. 3)

Matrices are sparse, {(row, column): entry} of the six axes u, v, w, p, q, r: which entries there
are is decided by the vehicle's terms, not by values, so that floats and recorded scalars take the
same steps. Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

VELOCITIES = "uvwpqr"
"""Letters of the velocities, in the order of the axes."""
FORCES = "XYZKMN"
"""Letters of forces and moments, in the order of the axes."""

Sparse = dict[tuple[int, int], Any]

_LATER = ((0, 4, "z"), (1, 5, "x"), (2, 3, "y"))
_EARLIER = ((1, 3, "z"), (2, 4, "x"), (0, 5, "y"))
_INERTIA = {"x": (3, 3), "y": (4, 4), "z": (5, 5), "xy": (3, 4), "xz": (3, 5), "yz": (4, 5)}
_CORIOLIS = (
    *((0, 4, 1, 2), (0, 5, -1, 1), (1, 3, -1, 2), (1, 5, 1, 0), (2, 3, 1, 1), (2, 4, -1, 0)),
    *((3, 1, 1, 2), (3, 2, -1, 1), (4, 0, -1, 2), (4, 2, 1, 0), (5, 0, 1, 1), (5, 1, -1, 0)),
    *((3, 4, 1, 5), (3, 5, -1, 4), (4, 3, -1, 5), (4, 5, 1, 3), (5, 3, 1, 4), (5, 4, -1, 3)),
)
"""Row, column, sign and component of the momentum (a, b) of each entry of C."""


def axes_of(degrees_of_freedom: int) -> tuple[int, ...]:
    """Return the axes of 4 (u, v, w, r) or 6 degrees of freedom."""
    return (0, 1, 2, 5) if degrees_of_freedom == 4 else (0, 1, 2, 3, 4, 5)


def rigid_body_mass(
    p: Mapping[str, Any], r_g: Collection[str], inertia: Collection[str], axes: Sequence[int]
) -> Sparse:
    """Return M_RB about the origin of the body axes.

    p : parameters `mass`, `r_g.x`, ..., `inertia.x`, `inertia.xy`, ... (entries of the matrix).
    r_g, inertia : those of their components that are not zero.
    """
    m = p["mass"]
    mass: Sparse = {(i, i): m for i in range(3)}
    for entries, sign in ((_LATER, 1), (_EARLIER, -1)):
        for i, j, axis in entries:
            if axis in r_g:
                moment = m * p[f"r_g.{axis}"]
                mass[i, j] = mass[j, i] = moment if sign > 0 else -moment
    for name in inertia:
        i, j = _INERTIA[name]
        mass[i, j] = mass[j, i] = p[f"inertia.{name}"]
    return {(i, j): mass[i, j] for i in axes for j in axes if (i, j) in mass}


def symmetric_part(m: Sparse) -> Sparse:
    """Return (m + m')/2 of a matrix whose entries come in pairs."""
    return {(i, j): m[i, j] if i == j else 0.5 * (m[i, j] + m[j, i]) for i, j in m}


def matrix_sum(a: Sparse, b: Sparse) -> Sparse:
    """Return a + b."""
    both = {**a, **b}
    return {at: a[at] + b[at] if at in a and at in b else both[at] for at in both}


def pivots_and_inverse(m: Sparse, axes: Sequence[int]) -> tuple[list[Any], Sparse]:
    """Return the pivots of the elimination without exchanges, and the inverse.

    All pivots of a symmetric matrix are positive if and only if it is positive definite.
    """
    a: Sparse = dict(m)
    b: Sparse = {(i, i): 1.0 for i in axes}
    for k in axes:
        for i in axes:
            if i == k or (i, k) not in a:
                continue
            factor = a[i, k] / a[k, k]
            for matrix, columns in ((a, [j for j in axes if j > k]), (b, axes)):
                for j in columns:
                    if (k, j) in matrix:
                        less = factor * matrix[k, j]
                        matrix[i, j] = matrix[i, j] - less if (i, j) in matrix else -less
    return [a[k, k] for k in axes], {(i, j): b[i, j] / a[i, i] for i, j in sorted(b)}


def multiplied(m: Sparse, x: Mapping[int, Any]) -> dict[int, Any]:
    """Return m x by row; rows and entries that are always zero are absent."""
    sums: dict[int, Any] = {}
    for i, j in sorted(m):
        if j in x:
            term = m[i, j] * x[j]
            sums[i] = sums[i] + term if i in sums else term
    return sums


def coriolis_force(
    m: Sparse, nu: Mapping[int, Any], without: Collection[tuple[int, int]] = ()
) -> dict[int, Any]:
    """Return C(nu) nu by row.

    m : symmetric mass matrix.
    without : entries (row, column) of C that are left out, counted from 0.
    """
    momentum = multiplied(m, nu)
    force: dict[int, Any] = {}
    for i, j, sign, k in _CORIOLIS:
        if i in nu and j in nu and k in momentum and (i, j) not in without:
            term = momentum[k] * nu[j]
            if i in force:
                force[i] = force[i] + term if sign > 0 else force[i] - term
            else:
                force[i] = term if sign > 0 else -term
    return force
