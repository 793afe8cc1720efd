"""Linear matrix inequalities with few unknowns and large dense matrices, in the form of `conic`.

Clarabel factorises a system with a row for every entry of every matrix: a matrix of 80 rows has
3,000. Where the unknowns are fewer than that, it is quicker to eliminate the matrices first and
to factorise the normal equations, of the size of the unknowns. This is the primal-dual
path-following method in the direction of Nesterov and Todd, with Mehrotra's predictor and
corrector, from an infeasible start (Toh, Todd, Tutuncu, SDPT3, Optim. Methods Softw. 11, 1999).

With G of each matrix such that G^-1 S G^-T = G'Z G = diag(l), and in these coordinates,

    sum_i <A_j, A_i> dy_i = <A_j, R_c - R_p> - r_j,     dS = R_p + sum_i A_i dy_i,  dZ = R_c - dS,

R_p = M(y) - S, r_j = q_j - <A_j, Z>, and R_c is the solution of l o R_c = its target, entry by
entry (R_c)_ab = 2 (target)_ab / (l_a + l_b).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.core import one_blas_thread, still_working
from cosim.hinf.lmi.conic import TOLERANCE, Constraint, Solution
from cosim.hinf.lmi.solver_status import count, status_of
from cosim.hinf.lmi.svec import Array, places, smat

_MOST_ITERATIONS = 80
_CLOSE = 1e-4
"""Gap and residuals, relative, up to which a point is worth a proof where progress ends."""
_STEP = 0.98  # of the way to the boundary, at most
_RIDGE = 1e-15  # of the normal equations, relative to their diagonal


class _Cone:
    """One matrix, its slack S and its multiplier Z.

    used : the unknowns that it contains; A (unknowns, n, n) their matrices.
    """

    def __init__(self, one: Constraint) -> None:
        self.n = one.size
        columns = np.asarray(
            one.columns if isinstance(one.columns, np.ndarray) else one.columns.toarray()
        )
        self.used = np.flatnonzero(columns.any(axis=0))
        rows, cols, factors = places(self.n)
        self.A = np.zeros((self.used.size, self.n, self.n))
        self.A[:, rows, cols] = self.A[:, cols, rows] = (columns[:, self.used] / factors[:, None]).T
        self.constant = smat(one.constant, self.n)
        sizes = np.sqrt(np.einsum("iab,iab->i", self.A, self.A))
        size = max(float(sizes.max(initial=0.0)), float(np.linalg.norm(self.constant)))
        self.S = max(10.0, self.n**0.5, self.n**0.5 * size) * np.eye(self.n)
        self.Z = max(10.0, self.n**0.5) * np.eye(self.n)

    def value(self, y: Array) -> Array:
        """Return M(y)."""
        return self.constant + np.tensordot(y[self.used], self.A, axes=1)

    def scale(self, y: Array) -> None:
        """Take the coordinates of the current S and Z, and R_p in them."""
        left, right = np.linalg.cholesky(self.S), np.linalg.cholesky(self.Z)
        _, self.l, V = np.linalg.svd(right.T @ left)
        turned = scipy.linalg.solve_triangular(left, V.T, lower=True, trans="T")
        self.inverse = (turned * np.sqrt(self.l)).T
        self.G = left @ V.T / np.sqrt(self.l)
        n = self.n
        half = (self.A.reshape(-1, n) @ self.inverse.T).reshape(-1, n, n).swapaxes(1, 2)
        self.scaled = (half.reshape(-1, n) @ self.inverse.T).reshape(-1, n * n)
        residual = self.value(y) - self.S
        self.R_p = self.inverse @ residual @ self.inverse.T

    def solved(self, target: Array) -> Array:
        """Return R_c of a target."""
        return np.asarray(2.0 * target / (self.l[:, None] + self.l))

    def direction(self, R_c: Array, dy: Array) -> tuple[Array, Array]:
        """Return dS and dZ in these coordinates."""
        dS = self.R_p + (dy[self.used] @ self.scaled).reshape(self.n, self.n)
        return dS, R_c - dS

    def longest(self, step: Array) -> float:
        """Return how far diag(l) + t step stays positive."""
        root = np.sqrt(self.l)
        least = float(np.linalg.eigvalsh(step / root[:, None] / root)[0])
        return np.inf if least >= 0 else -1.0 / least

    def move(self, dS: Array, dZ: Array, primal: float, dual: float) -> None:
        """Go along a direction of these coordinates."""
        S, Z = self.S + primal * self.G @ dS @ self.G.T, self.inverse.T @ dZ @ self.inverse
        Z = self.Z + dual * Z
        self.S, self.Z = (S + S.T) / 2, (Z + Z.T) / 2


@dataclass(frozen=True)
class _State:
    """How far a point is from a solution, relative, and its gap."""

    primal: float
    dual: float
    gap: float
    value: float

    @property
    def worst(self) -> float:
        return max(self.primal, self.dual, self.gap)


def solve_dense(
    constraints: Sequence[Constraint], q: Array, *, tolerance: float = TOLERANCE
) -> Solution:
    """Minimise q'y over the constraints, as `cosim.hinf.lmi.conic.solve` does."""
    with one_blas_thread():  # the last digits must not depend on it
        return _solved(constraints, q, tolerance)


def _solved(constraints: Sequence[Constraint], q: Array, tolerance: float) -> Solution:
    cones = [_Cone(one) for one in constraints]
    y, word = np.zeros(len(q)), "MaxIterations"
    best: tuple[float, Array, list[Array]] | None = None
    for _ in range(_MOST_ITERATIONS):
        still_working()
        against = np.zeros(len(q))
        for cone in cones:
            against[cone.used] += np.tensordot(cone.A, cone.Z, axes=2)
        state = _state(cones, y, q, against)
        if best is None or state.worst < best[0]:
            best = state.worst, y, [cone.Z for cone in cones]
        if state.worst < tolerance:
            word = "Solved"
            break
        excess = -sum(float(np.vdot(cone.constant, cone.Z)) for cone in cones)
        if excess > 0 and np.linalg.norm(against) < tolerance * excess and state.primal > tolerance:
            word, best = "PrimalInfeasible", (0.0, y, [cone.Z / excess for cone in cones])
            break
        try:
            moved = _moved(cones, y, q - against)
        except np.linalg.LinAlgError:
            moved = None
        if moved is None:
            word = "InsufficientProgress"
            break
        y = moved
    assert best is not None  # noqa: S101 - the first iteration sets it
    if word in {"MaxIterations", "InsufficientProgress"} and not best[0] < _CLOSE:
        word = "NumericalError"
    count(word)
    return Solution(status_of(word), best[1], float(q @ best[1]), tuple(best[2]), word)


def _state(cones: list[_Cone], y: Array, q: Array, against: Array) -> _State:
    value = float(q @ y)
    dual = -sum(float(np.vdot(cone.constant, cone.Z)) for cone in cones)
    gap = sum(float(np.vdot(cone.S, cone.Z)) for cone in cones)
    residuals = [
        float(np.linalg.norm(cone.value(y) - cone.S)) / (1.0 + float(np.linalg.norm(cone.constant)))
        for cone in cones
    ]
    size = 1.0 + abs(value) + abs(dual)
    far = float(np.linalg.norm(q - against)) / (1.0 + float(np.linalg.norm(q)))
    return _State(max(residuals), far, gap / size, value)


def _moved(cones: list[_Cone], y: Array, r: Array) -> Array | None:
    """Make one step of all cones; return y after it, None where there is no more progress."""
    for cone in cones:
        cone.scale(y)
    rows = sum(cone.n for cone in cones)
    mu = sum(float(cone.l @ cone.l) for cone in cones) / rows
    normal = np.zeros((len(y), len(y)))
    for cone in cones:
        normal[np.ix_(cone.used, cone.used)] += cone.scaled @ cone.scaled.T
    diagonal = np.diag_indices(len(y))
    normal[diagonal] *= 1.0 + _RIDGE
    factor = scipy.linalg.cho_factor(normal)

    def directions(targets: list[Array]) -> tuple[Array, list[tuple[Array, Array]]]:
        right = -r
        each = [cone.solved(target) for cone, target in zip(cones, targets, strict=True)]
        for cone, R_c in zip(cones, each, strict=True):
            right[cone.used] += cone.scaled @ (R_c - cone.R_p).ravel()
        dy = scipy.linalg.cho_solve(factor, right)
        dy += scipy.linalg.cho_solve(factor, right - normal @ dy)  # one refinement
        return dy, [cone.direction(R_c, dy) for cone, R_c in zip(cones, each, strict=True)]

    def lengths(steps: list[tuple[Array, Array]], share: float) -> tuple[float, float]:
        both = zip(cones, steps, strict=True)
        ends = [(cone.longest(dS), cone.longest(dZ)) for cone, (dS, dZ) in both]
        primal, dual = (min(1.0, share * min(side)) for side in zip(*ends, strict=True))
        return primal, dual

    _, steps = directions([-np.diag(cone.l**2) for cone in cones])
    primal, dual = lengths(steps, 1.0)
    after = sum(
        float(np.vdot(np.diag(cone.l) + primal * dS, np.diag(cone.l) + dual * dZ))
        for cone, (dS, dZ) in zip(cones, steps, strict=True)
    )
    power = max(1.0, 3.0 * min(primal, dual) ** 2)
    centre = min(1.0, max(after / rows / mu, 0.0) ** power) * mu
    targets: list[NDArray[np.float64]] = []
    for cone, (dS, dZ) in zip(cones, steps, strict=True):
        second = dS @ dZ
        targets.append(centre * np.eye(cone.n) - np.diag(cone.l**2) - (second + second.T) / 2)
    dy, steps = directions(targets)
    primal, dual = lengths(steps, min(_STEP, 0.9 + 0.09 * min(primal, dual)))
    if not (np.isfinite(dy).all() and max(primal, dual) > 1e-7):
        return None
    for cone, (dS, dZ) in zip(cones, steps, strict=True):
        cone.move(dS, dZ, primal, dual)
    return y + primal * dy
