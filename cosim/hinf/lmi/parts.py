"""Solve the LMI of a loop that falls into parts as several small ones.

Where the states, inputs and signals of a system fall into parts that no matrix connects, a change
of sign of one part changes nothing. The mean of a solution over all such changes is a solution at
the same gamma and eps, one for each block of F, with matrices that do not connect the parts
either. So nothing is lost by one small LMI for each part, tied by gamma and eps alone: the four
axes of the vehicle are solved in a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.lmi.conic import TOLERANCE, Constraint, Solution, solve
from cosim.hinf.lmi.svec import Array, places

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

Labels = NDArray[np.signedinteger[Any]]


def parts_of(links: Sequence[tuple[str, str, Array]]) -> dict[str, Labels]:
    """Return the part of every entry of every signal.

    links : (row signal, column signal, matrix): what its nonzero entries connect.
    """
    sizes: dict[str, int] = {}
    for row, column, matrix in links:
        sizes[row], sizes[column] = matrix.shape
    start = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
    total = sum(sizes.values())
    graph = np.zeros((total, total), dtype=bool)
    for row, column, matrix in links:
        i, j = np.nonzero(matrix)
        graph[start[row] + i, start[column] + j] = True
    _, label = scipy.sparse.csgraph.connected_components(
        scipy.sparse.csr_array(graph), directed=False
    )
    return {name: label[start[name] : start[name] + size] for name, size in sizes.items()}


def parts_of_system(system: DelaySystem, gain: Matrix | None = None) -> dict[str, Labels]:
    """Return the part of every entry of x, u, w, z, of q (h) and of the columns of E (p).

    gain : (m, n) K where it is given; one that is designed connects no parts.
    """
    links = [("x", "x", system.A), ("x", "u", system.B), ("x", "w", system.C)]
    links += [("z", "x", system.D), ("z", "w", system.D1), ("z", "u", system.D2)]
    links += [("x", "p", system.E), ("h", "x", system.H)]
    for delay in system.delays:
        links += [("x", "x", delay.A), ("h", "x", delay.H)]
    if gain is not None:
        links.append(("u", "x", gain))
    return parts_of(links)


def solve_in_parts(
    constraints: Sequence[Constraint],
    labels: Sequence[Labels | None],
    q: Array,
    *,
    equal: tuple[Array, float] | None = None,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Minimise as `solve`, each matrix cut into the blocks of its parts.

    Parameters
    ----------
    labels : the part of every row of each matrix; None for one that is not cut. Unknowns that
        connect parts are zero.
    """
    if not any(own is not None and np.ptp(own) for own in labels):
        return solve(constraints, q, equal=equal, tolerance=tolerance)
    keep = np.ones(len(q), dtype=bool)
    cuts: list[list[tuple[NDArray[np.intp], NDArray[np.intp]]]] = []
    for one, own in zip(constraints, labels, strict=True):
        label: Labels = np.zeros(one.size, dtype=np.intp) if own is None else own
        rows, columns, _ = places(one.size)
        same = label[rows] == label[columns]
        if one.constant[~same].any():
            raise ValueError("expected parts that no constant connects, got one that does")
        across = one.columns[~same]
        keep &= np.asarray(abs(across).sum(axis=0)).ravel() == 0
        cuts.append(
            [
                (np.flatnonzero(label == part), np.flatnonzero(same & (label[rows] == part)))
                for part in np.unique(label)
            ]
        )
    blocks = [
        Constraint(len(rows), one.constant[at], one.columns[at][:, keep])
        for one, cut in zip(constraints, cuts, strict=True)
        for rows, at in cut
    ]
    tied = None if equal is None else (equal[0][keep], equal[1])
    found = solve(blocks, q[keep], equal=tied, tolerance=tolerance)
    y = np.zeros(len(q))
    y[keep] = found.y
    if not found.Z:
        return replace(found, y=y)
    multipliers, made = [], iter(found.Z)
    for one, cut in zip(constraints, cuts, strict=True):
        Z = np.zeros((one.size, one.size))
        for rows, _ in cut:
            Z[np.ix_(rows, rows)] = next(made)
        multipliers.append(Z)
    return replace(found, y=y, Z=tuple(multipliers))
