"""Approximate characteristic roots: eigenvalues of a system whose delay lines are collocated.

    x'(t) = A x(t) + sum_d B_d y(t-d),    y(t) = R x(t) + sum_d G_d y(t-d)

A signal y_k that acts late is known by its values at N+1 Chebyshev nodes of [-T_k, 0], T_k the
longest delay it acts at. The matrix acts on x and on these values but those at 0, which follow
from the equation of y: the infinitesimal generator of the solution semigroup, whose eigenvalues
near 0 converge exponentially in N (Breda, Maset, Vermiglio, SIAM J. Sci. Comput. 27, 2005). Only
what acts late has a past: a feedback of two inputs through a delay has two signals, however many
states there are.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.delay_lti.closed_loop import ClosedLoop

Matrix = NDArray[np.float64]

_RANK = 1e-13  # of the late terms, against the largest


def late_signals(loop: ClosedLoop) -> tuple[Matrix, dict[float, Matrix]]:
    """Return R (r, n) and the late terms of a closed loop for `collocated`, r their rank."""
    n = loop.order
    by_delay = {d: A for d, A in zip(loop.delays, loop.A, strict=True) if d > 0.0 and A.any()}
    if not by_delay:
        return np.zeros((0, n)), {}
    stacked = np.vstack(list(by_delay.values()))
    used = np.flatnonzero(stacked.any(axis=0))
    _, sizes, rows = np.linalg.svd(stacked[:, used], full_matrices=False)
    rank = int((sizes > _RANK * sizes[0]).sum())
    R = np.eye(n)[used]
    if rank < used.size:
        R = rows[:rank] @ R
    none = np.zeros((len(R), len(R)))
    return R, {d: np.vstack([A @ R.T, none]) for d, A in by_delay.items()}


def collocated(A: Matrix, R: Matrix, by_delay: Mapping[float, Matrix], nodes: int) -> Matrix:
    """Return the matrix of x and the past of y, (n + r N, n + r N).

    Parameters
    ----------
    A : (n, n). R : (r, n).
    by_delay : by delay d > 0 [s], [B_d; G_d] (n + r, r); every signal acts at one delay at least.
    nodes : N.
    """
    n, r = A.shape[0], R.shape[0]
    if not r:
        return A
    x, D = _chebyshev(nodes)
    span = np.max([d * M.any(axis=0) for d, M in by_delay.items()], axis=0)
    now, past = np.zeros((n + r, r)), np.zeros((n + r, r, nodes))
    for d, M in by_delay.items():
        weights = np.array([_interpolation(x, max(1.0 - 2.0 * d / T, -1.0)) for T in span])
        now += M * weights[:, 0]
        past += M[:, :, None] * weights[:, 1:]
    past = past.reshape(n + r, r * nodes)
    start = np.linalg.solve(np.eye(r) - now[n:], np.hstack([R, past[n:]]))  # y(t)
    matrix = np.zeros((n + r * nodes, n + r * nodes))
    matrix[:n, :n], matrix[:n, n:] = A, past[:n]
    matrix[:n] += now[:n] @ start
    matrix[n:] = np.kron(start * (2.0 / span)[:, None], D[1:, :1])
    matrix[n:, n:] += np.kron(np.diag(2.0 / span), D[1:, 1:])
    return matrix


def _chebyshev(nodes: int) -> tuple[Matrix, Matrix]:
    """Return Chebyshev points 1 = x_0 > ... > x_N = -1 and their differentiation matrix.

    Trefethen, Spectral Methods in MATLAB (2000), chapter 6.
    """
    j = np.arange(nodes + 1)
    x: Matrix = np.cos(np.pi * j / nodes)
    c = np.where((j == 0) | (j == nodes), 2.0, 1.0) * (-1.0) ** j
    D: Matrix = np.outer(c, 1.0 / c) / (x[:, None] - x[None, :] + np.eye(nodes + 1))
    D -= np.diag(D.sum(axis=1))
    return x, D


def _interpolation(x: Matrix, at: float) -> Matrix:
    """Return the weights of the values at Chebyshev points `x` in the interpolant at `at`."""
    gap = at - x
    if np.any(gap == 0.0):
        return np.where(gap == 0.0, 1.0, 0.0)
    weights = (-1.0) ** np.arange(x.size) / gap
    weights[[0, -1]] /= 2.0
    normalised: Matrix = weights / weights.sum()
    return normalised
