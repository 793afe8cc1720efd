"""A primal-dual interior-point method for small, dense linear matrix inequalities.

    minimise q'y   subject to   S_k = C_k - sum_i y_i A_ki >= 0,   k = 1, 2, ...

with the dual   maximise -sum_k <C_k, Z_k>   subject to   <A_i, Z> = -q_i,  Z_k >= 0.

Predictor and corrector after Mehrotra in the HKM direction (Helmberg, Rendl, Vanderbei,
Wolkowicz, SIAM J. Optim. 6, 1996), from an infeasible start. An LMI of this project has
some ten to a hundred rows and unknowns: general solvers carry such a cone as a dense block of
rows^2/2 equations, here a step costs one system in the unknowns. Like any solver's, its word is
no proof: what counts is what the exact certificate makes of the solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Status = Literal["solved", "inaccurate", "infeasible", "failed"]

_STEPS = 80
_TOLERANCE = 1e-9
_ACCEPTED = 1e-6
"""Residuals and gap, relative, with which a solution still counts as a (poor) one."""


@dataclass(frozen=True)
class Cone:
    """C - sum_i y_i A_i >= 0 of one size.

    C : (N, N) symmetric.
    unknowns : indices of the y that take part.
    stacked : (len(unknowns) N, N) sparse, their A_i one below the other.
    """

    C: Array
    unknowns: NDArray[np.int64]
    stacked: sparse.csr_array

    @property
    def flat(self) -> sparse.csr_array:
        """(len(unknowns), N^2): each A_i as a row."""
        n = self.C.shape[0]
        return sparse.csr_array(self.stacked.reshape((len(self.unknowns), n * n)))


@dataclass(frozen=True)
class Solution:
    """What the method ends with.

    status : `infeasible` only with multipliers that show it.
    y : the unknowns; the last iterate unless solved.
    value : q'y.
    Z : one multiplier per cone; where `infeasible`, -sum <C, Z> = 1 and <A_i, Z> about 0.
    steps : how many it took.
    """

    status: Status
    y: Array
    value: float
    Z: tuple[Array, ...]
    steps: int


class _Block:
    """One cone with its iterates S and Z."""

    def __init__(self, cone: Cone, q: Array) -> None:
        self.C, self.unknowns, self.stacked = cone.C, cone.unknowns, cone.stacked
        self.flat = cone.flat
        self.n = n = cone.C.shape[0]
        norms = np.sqrt(np.asarray(self.flat.multiply(self.flat).sum(axis=1)).ravel())
        largest = norms.max(initial=0.0)
        root = np.sqrt(n)
        ratio = ((1 + np.abs(q[self.unknowns])) / (1 + norms)).max(initial=0.0)
        self.Z = np.eye(n) * max(10.0, root, n * ratio)
        self.S = np.eye(n) * max(10.0, root, largest, float(np.linalg.norm(self.C)))

    def image(self, y: Array) -> Array:
        """sum_i y_i A_i."""
        return np.asarray(y[self.unknowns] @ self.flat).reshape(self.n, self.n)

    def products(self, Z: Array) -> Array:
        """<A_i, Z> for the unknowns that take part."""
        return np.asarray(self.flat @ Z.ravel())

    def prepare(self, y: Array) -> None:
        """Factors of S and Z, residual, and this cone's part of the system."""
        self.rootS = np.linalg.inv(np.linalg.cholesky(self.S))
        self.rootZ = np.linalg.inv(np.linalg.cholesky(self.Z))
        self.inverse = self.rootS.T @ self.rootS
        self.residual = self.C - self.image(y) - self.S
        U = np.asarray(self.stacked @ self.inverse).reshape(-1, self.n, self.n)
        W = (self.Z @ U).reshape(-1, self.n * self.n)
        self.system = self.flat @ W.T

    def direction(self, dy: Array, constant: Array) -> None:
        """Steps of S and Z for the step of y; `constant` is dZ where dS = residual alone."""
        change = self.image(dy)
        self.dS = self.residual - change
        self.dZ = constant + _symmetric(self.Z @ change @ self.inverse)

    def lengths(self) -> tuple[float, float]:
        """How far S and Z may go."""
        return _length(self.rootS, self.dS), _length(self.rootZ, self.dZ)


def solve(cones: Sequence[Cone], q: Array) -> Solution:  # noqa: C901 - ends in five ways
    """Minimise q'y over the cones."""
    y = np.zeros(len(q))
    blocks = [_Block(cone, q) for cone in cones]
    total = sum(block.n for block in blocks)
    size_C = 1 + max(float(np.linalg.norm(block.C)) for block in blocks)
    size_q = 1 + float(np.linalg.norm(q))
    best: tuple[float, Array, tuple[Array, ...]] = (np.inf, y, ())
    step = 0
    for step in range(_STEPS):
        rp = -q.copy()
        for block in blocks:
            rp[block.unknowns] -= block.products(block.Z)
        try:
            for block in blocks:
                block.prepare(y)
        except np.linalg.LinAlgError:
            break
        mu = sum(float(np.vdot(b.S, b.Z)) for b in blocks) / total
        primal, dual = float(q @ y), -sum(float(np.vdot(b.C, b.Z)) for b in blocks)
        error = max(
            total * mu / (1 + abs(primal) + abs(dual)),
            float(np.linalg.norm(rp)) / size_q,
            max(float(np.linalg.norm(b.residual)) for b in blocks) / size_C,
        )
        Z = tuple(block.Z for block in blocks)
        if error < best[0]:
            best = (error, y.copy(), Z)
        if error < _TOLERANCE:
            break
        # multipliers that grow without end, and with which nothing is left of <A_i, Z>
        if dual > 0 and float(np.linalg.norm(rp + q)) < 1e-9 * dual:
            return Solution("infeasible", y, primal, tuple(z / dual for z in Z), step)
        if error > 1e3 * best[0] and best[0] < _ACCEPTED:
            break
        M = np.zeros((len(q), len(q)))
        for block in blocks:
            M[np.ix_(block.unknowns, block.unknowns)] += block.system
        try:
            y, moved = _step(blocks, y, _factor(M), rp, mu, total)
        except (np.linalg.LinAlgError, ValueError):
            break
        if moved < 1e-7:
            break
    error, y, Z = best
    status: Status = (
        "solved" if error < 10 * _TOLERANCE else "inaccurate" if error < _ACCEPTED else "failed"
    )
    return Solution(status, y, float(q @ y), Z, step)


def _step(
    blocks: list[_Block], y: Array, factor: Array, rp: Array, mu: float, total: int
) -> tuple[Array, float]:
    """Predictor, corrector, and the step: the new y and how far it went."""
    _direction(blocks, factor, rp, [np.zeros((b.n, b.n)) for b in blocks])
    s, z = _lengths(blocks, 1.0)
    ahead = sum(float(np.vdot(b.S + s * b.dS, b.Z + z * b.dZ)) for b in blocks) / total
    exponent = 3 if min(s, z) > 0.6 else 2 if min(s, z) > 0.3 else 1
    sigma = min(1.0, max(ahead / mu, 0.0)) ** exponent
    corrections = [sigma * mu * b.inverse - _symmetric(b.dZ @ b.dS @ b.inverse) for b in blocks]
    dy = _direction(blocks, factor, rp, corrections)
    near = 0.9 + 0.08 * min(s, z)  # to the boundary, but never quite
    s, z = _lengths(blocks, near)
    for block in blocks:
        block.S = _symmetric(block.S + s * block.dS)
        block.Z = _symmetric(block.Z + z * block.dZ)
    return y + s * dy, max(s, z)


def _direction(blocks: list[_Block], factor: Array, rp: Array, corrections: list[Array]) -> Array:
    """Step of y; those of S and Z are left in the blocks."""
    right = rp.copy()
    constants = []
    for block, correction in zip(blocks, corrections, strict=True):
        constant = correction - block.Z - _symmetric(block.Z @ block.residual @ block.inverse)
        right[block.unknowns] -= block.products(constant)
        constants.append(constant)
    dy = factor.T @ (factor @ right)
    for block, constant in zip(blocks, constants, strict=True):
        block.direction(dy, constant)
    return dy


def _lengths(blocks: list[_Block], near: float) -> tuple[float, float]:
    lengths = [block.lengths() for block in blocks]
    return (
        min(1.0, near * min(s for s, _ in lengths)),
        min(1.0, near * min(z for _, z in lengths)),
    )


def _length(root: Array, change: Array) -> float:
    """Largest t with (root' root)^-1 + t change >= 0."""
    least = float(np.linalg.eigvalsh(_symmetric(root @ change @ root.T))[0])
    return np.inf if least >= 0 else -1.0 / least


def _factor(M: Array) -> Array:
    """F with F'F = M^-1; unknowns that nothing depends on stay where they are."""
    M = (M + M.T) / 2
    diagonal = np.diag(M).copy()
    diagonal[diagonal <= 0] = 1.0
    M = M + np.diag(np.where(np.diag(M) <= 0, 1.0, 1e-14 * diagonal))
    return np.linalg.inv(np.linalg.cholesky(M))


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2, dtype=np.float64)
