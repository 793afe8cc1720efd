"""The truth about a closed loop with delays, computed apart from everything in `cosim.hinf`.

Roots: Chebyshev collocation of the generator. First loss of stability: the frequencies at
which a root can lie on the imaginary axis, swept and refined. H-infinity norm: the level set of
the collocated loop (imaginary eigenvalues of its Hamiltonian matrix), whose frequencies the
true transfer function is then evaluated at. What comes out is attained by the true loop.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals
from scipy.optimize import brentq, minimize_scalar

from cosim.models import DelaySystem

Array = NDArray[np.float64]

_NODES = 14


@dataclass(frozen=True, eq=False)
class Loop:
    """x' = sum A_i x(t-d_i) + C w, z = sum D_i x(t-d_i) + D1 w, d_0 = 0."""

    A: tuple[Any, ...]
    d: tuple[float, ...]
    C: Array
    D: tuple[Array, ...]
    D1: Array

    def at(self, delay_index: int, d: float) -> Loop:
        """Delay `delay_index` of the system (1 + which here) replaced."""
        delays = list(self.d)
        delays[1 + delay_index] = d
        return replace(self, d=tuple(delays))


def loop_of(system: DelaySystem, K: Any = None, F: Any = None) -> Loop:
    """The loop of u = K x, K = 0 if absent, at a constant F, F = 0 if absent."""
    gain = np.zeros(system.B.T.shape) if K is None else np.asarray(K)
    acts = [not any(x.feedback for x in system.delays), *(x.feedback for x in system.delays)]
    A = [system.A, *(x.A for x in system.delays)]
    H = [system.H, *(x.H for x in system.delays)]
    loop = [M + phi * system.B @ gain for M, phi in zip(A, acts, strict=True)]
    if F is not None:
        loop = [M + system.E @ F @ N for M, N in zip(loop, H, strict=True)]
    D = [(i == 0) * system.D + phi * system.D2 @ gain for i, phi in enumerate(acts)]
    d = (0.0, *(x.d for x in system.delays))
    return Loop(tuple(loop), d, system.C, tuple(D), system.D1)


def collocated(loop: Loop, nodes: int = _NODES) -> tuple[Any, Array]:
    """The generator on polynomials of degree `nodes` over [-d_max, 0]; and x(-d_i) of them.

    The second has one row of interpolation weights per delay.
    """
    n, longest = len(loop.A[0]), max(loop.d)
    if longest == 0:
        return sum(loop.A), np.ones((len(loop.d), 1))
    t = np.cos(np.pi * np.arange(nodes + 1) / nodes)
    s = longest / 2 * (t - 1)  # from 0 to -d_max
    c = np.where((np.arange(nodes + 1) == 0) | (np.arange(nodes + 1) == nodes), 2.0, 1.0)
    c *= (-1.0) ** np.arange(nodes + 1)
    gaps = s[:, None] - s[None, :] + np.eye(nodes + 1)
    slope = np.outer(c, 1 / c) / gaps
    slope -= np.diag(slope.sum(axis=1))
    weights = np.zeros((len(loop.d), nodes + 1))
    for i, d in enumerate(loop.d):
        away = -d - s
        if np.abs(away).min() < 1e-14 * longest:
            weights[i, np.abs(away).argmin()] = 1.0
        else:
            share = 1 / c / away
            weights[i] = share / share.sum()
    whole = np.kron(slope, np.eye(n)).astype(loop.A[0].dtype)
    whole[:n] = sum(np.kron(weights[i], A) for i, A in enumerate(loop.A))
    return whole, weights


def abscissa(loop: Loop) -> float:
    """Greatest real part of the characteristic roots."""
    return float(np.linalg.eigvals(collocated(loop)[0]).real.max())


def gains(loop: Loop, omega: Any) -> Array:
    """Largest singular value of the transfer function from w to z."""
    s = 1j * np.atleast_1d(np.asarray(omega, dtype=np.float64))
    e = np.exp(-s[:, None] * np.array(loop.d))
    S = s[:, None, None] * np.eye(len(loop.A[0])) - np.einsum("kd,dij->kij", e, np.array(loop.A))
    D = np.einsum("kd,dij->kij", e, np.array(loop.D))
    x = np.linalg.solve(S, np.broadcast_to(loop.C.astype(complex), (len(s), *loop.C.shape)))
    return np.asarray(np.linalg.norm(D @ x + loop.D1, 2, axis=(1, 2)))


def _speed(loop: Loop) -> float:
    return float(sum(np.linalg.norm(A, 2) for A in loop.A))


def attained_gain(loop: Loop) -> float:
    """A gain that a swept and refined frequency attains: never above the norm."""
    top = _speed(loop)
    grid = np.concatenate([[0.0], np.geomspace(1e-3 * top, 1e3 * top, 300)])
    if np.iscomplexobj(loop.A[0]):
        grid = np.concatenate([-grid[::-1], grid])
    return max(float(np.linalg.norm(loop.D1, 2)), _peak(loop, grid))


def norm(loop: Loop) -> float:
    """The H-infinity norm of a stable real loop: no other frequency attains a higher gain."""
    top, best = _speed(loop), attained_gain(loop)
    A, weights = collocated(loop)
    n, size = len(loop.A[0]), len(A)
    B = np.zeros((size, loop.C.shape[1]))
    B[:n] = loop.C
    C = sum(np.kron(weights[i], D) for i, D in enumerate(loop.D))
    for _ in range(4):
        level = best * (1 + 1e-6)
        inside = np.linalg.inv(level**2 * np.eye(B.shape[1]) - loop.D1.T @ loop.D1)
        feed = B @ inside @ loop.D1.T @ C
        below = C.T @ (np.eye(len(C)) + loop.D1 @ inside @ loop.D1.T) @ C
        Hamiltonian = np.block(
            [[A + feed, B @ inside @ B.T], [-below, -(A + feed).conj().T]],
        )
        roots = np.linalg.eigvals(Hamiltonian)
        found = np.sort(roots.imag[np.abs(roots.real) < 1e-7 * (top + np.abs(roots))])
        if not found.size:
            break
        inner = np.concatenate([found, (found[1:] + found[:-1]) / 2])
        higher = _peak(loop, np.unique(inner))
        if higher <= best * (1 + 1e-9):
            break
        best = higher
    return best


def _peak(loop: Loop, grid: Array) -> float:
    values = gains(loop, grid)
    best = float(values.max())
    for k in np.argsort(-values)[:3]:
        low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
        if low < high:
            found = minimize_scalar(
                lambda w: -gains(loop, w)[0], bounds=(low, high), method="bounded"
            )
            best = max(best, -float(found.fun))
    return best


def first_loss(loop: Loop, delay_index: int) -> float:
    """The least delay `delay_index` at which a root lies on the imaginary axis; infinite if none.

    A root j w at delay d is an eigenvalue e^{jwd} of (jw - sum of the others)^-1 A_which: the
    moduli of its eigenvalues, sorted, are continuous in w, and are swept for passing 1.
    """
    here = 1 + delay_index
    others = [i for i in range(len(loop.d)) if i != here]

    def eigenvalues(w: Any) -> Any:
        s = 1j * np.atleast_1d(w)
        e = np.exp(-s[:, None] * np.array([loop.d[i] for i in others]))
        rest = np.einsum("kd,dij->kij", e, np.array([loop.A[i] for i in others]))
        M = np.linalg.solve(
            s[:, None, None] * np.eye(len(loop.A[0])) - rest,
            np.broadcast_to(loop.A[here].astype(complex), rest.shape),
        )
        values = np.linalg.eigvals(M)
        order = np.argsort(np.abs(values), axis=1)
        return np.take_along_axis(values, order, axis=1)

    top = _speed(loop)
    grid = np.concatenate([np.geomspace(1e-5, 1e-2, 60), np.linspace(1e-2, 1, 1500)[1:]]) * top
    moduli = np.abs(eigenvalues(grid)) - 1
    losses = [np.inf]
    for k, j in zip(*np.nonzero(moduli[1:] * moduli[:-1] < 0), strict=True):
        w = brentq(
            lambda at, j=j: abs(eigenvalues(at)[0, j]) - 1, grid[k], grid[k + 1], xtol=1e-13 * top
        )
        angle = float(np.angle(eigenvalues(w)[0, j])) % (2 * np.pi)
        losses.append(angle / w)
    return float(min(losses))


def first_loss_by_pencil(A0: Array, A1: Array) -> float:
    """The same for one delay, by algebra: no sweep.

    A0 + A1 z has an eigenvalue jw and A0 + A1 / z its conjugate, so their Kronecker sum is
    singular: a quadratic pencil in z (Chen, Gu, Nett, Syst. Control Lett. 26, 1995).
    """
    n = len(A0)
    one, zero = np.eye(n), np.zeros((n * n, n * n))
    a, b, c = np.kron(A1, one), np.kron(A0, one) + np.kron(one, A0), np.kron(one, A1)
    left = np.block([[zero, np.eye(n * n)], [-c, -b]])
    right = np.block([[np.eye(n * n), zero], [zero, a]])
    losses = [np.inf]
    for z in eigvals(left, right):
        if np.isfinite(z) and abs(abs(z) - 1) < 1e-6:
            losses += [
                float((-np.angle(z) / s.imag) % (2 * np.pi / abs(s.imag)))
                for s in np.linalg.eigvals(A0 + A1 * z)
                if abs(s.real) < 1e-6 and abs(s.imag) > 1e-9
            ]
    return min(losses)
