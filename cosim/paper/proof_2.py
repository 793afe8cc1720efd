"""The steps of Theorem 2's proof in fractions, at random numbers."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from cosim.models import Delay, DelaySystem
from cosim.paper.exact import (
    Draw,
    Exact,
    identity,
    inverse,
    is_zero,
    rational,
    rational_matrix,
)
from cosim.paper.lmi import mirrored, zeros
from cosim.paper.omega import NAMES, Case, Reading, matrix_at, minus_omega_as_read
from cosim.paper.theorem_1 import Loop, drawn_loop

INPUTS, LEFT, RIGHT = 2, 2, 2
"""Number of inputs, of columns of E, of rows of H."""


@dataclass(frozen=True)
class Data:
    """The given quantities: the matrices of Eq. (7), d, k1, k2, gamma; all of them are doubles."""

    A: Exact
    A1: Exact
    B: Exact
    C: Exact
    D: Exact
    D1: Exact
    D2: Exact
    E: Exact
    H: Exact
    H1: Exact
    d: Fraction
    k1: Fraction
    k2: Fraction
    gamma: Fraction

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of rows of each block of `NAMES`."""
        n, q = self.C.shape
        return (n, n, q, self.D.shape[0], n, n, self.H.shape[0])

    @property
    def case(self) -> Case:
        """The same as a system with k1, k2 and gamma."""
        letters = ("A", "B", "C", "D", "D1", "D2", "E", "H")
        given = {letter: getattr(self, letter).astype(np.float64) for letter in letters}
        delay = Delay(float(self.d), self.A1.astype(np.float64), self.H1.astype(np.float64))
        system = DelaySystem(**given, delays=[delay])
        return Case(system, float(self.k1), float(self.k2), float(self.gamma))


@dataclass(frozen=True)
class Proof:
    """Random numbers for the proof of Theorem 2: those of Theorem 1, and K, F, eps."""

    loop: Loop
    data: Data
    K: Exact
    F: Exact
    eps: Fraction

    @property
    def unknowns(self) -> dict[str, Any]:
        """X, Q, R, Y, eps and gamma of the proof's last step, as `flint` numbers."""
        X = inverse(self.loop.P)
        matrices = {"X": X, "R": inverse(self.loop.R), "Q": X @ self.loop.Q @ X, "Y": self.K @ X}
        numbers = {"eps": rational(self.eps), "gamma": rational(self.data.gamma)}
        return {name: rational_matrix(M) for name, M in matrices.items()} | numbers


def drawn_proof() -> Proof:
    """Draw the numbers; sizes differ and k1, k2 are not 1, so that they hide no misprint."""
    loop, draw = drawn_loop(), Draw(20)
    n, q = loop.C.shape
    p = loop.D.shape[0]
    data = Data(
        A=draw.matrix(n, n),
        A1=draw.matrix(n, n),
        B=draw.matrix(n, INPUTS),
        C=draw.matrix(n, q),
        D=draw.matrix(p, n),
        D1=draw.matrix(p, q),
        D2=draw.matrix(p, INPUTS),
        E=draw.matrix(n, LEFT),
        H=draw.matrix(RIGHT, n),
        H1=draw.matrix(RIGHT, n),
        # exact as doubles, for the comparison with the LMI of the design
        d=Fraction(3, 8),
        k1=Fraction(5, 8),
        k2=Fraction(1, 4),
        gamma=Fraction(7, 2),
    )
    F = draw.matrix(LEFT, RIGHT) / Fraction(9)
    return Proof(loop, data, draw.matrix(INPUTS, n), F, Fraction(3, 4))


def psi(v: Proof) -> Exact:
    """Return Psi below Eq. (16), as printed."""
    s, P, Q, R, K = v.data, v.loop.P, v.loop.Q, v.loop.R, v.K
    n, _, q, p, _, _, _ = s.sizes
    BK = s.B @ K
    rows: list[list[Any]] = [
        [
            s.A.T @ P + P @ s.A + Q + 2 * s.k1 * P + BK.T @ P + P @ BK,
            P @ s.A1 - s.k1 * P + s.k2 * P,
            P @ s.C,
            s.D.T + (s.D2 @ K).T,
            s.d * (s.A + BK).T,
            s.d * s.k1 * P,
        ],
        [-Q - 2 * s.k2 * P, zeros(n, q), zeros(n, p), s.d * s.A1.T, s.d * s.k2 * P],
        [-s.gamma * identity(q), s.D1.T, s.d * s.C.T, zeros(q, n)],
        [-s.gamma * identity(p), zeros(p, n), zeros(p, n)],
        [-s.d * inverse(R), zeros(n, n)],
        [-s.d * R],
    ]
    Psi: Exact = np.block(mirrored(rows))
    return Psi


def lambda_18(v: Proof) -> Exact:
    """Return Lambda of Eq. (18), as printed."""
    s, P, eps = v.data, v.loop.P, v.eps
    n, _, q, p, _, _, r = s.sizes
    EE = eps * s.E @ s.E.T
    inside, places = psi(v), [0, *accumulate(s.sizes)]
    x, slope = slice(0, n), slice(places[4], places[5])
    inside[x, x] = inside[x, x] + P @ EE @ P
    inside[x, slope] = s.d * (s.A + s.B @ v.K).T + s.d * P @ EE
    inside[slope, x] = inside[x, slope].T
    inside[slope, slope] = inside[slope, slope] + s.d * s.d * EE
    column = np.vstack([s.H.T, s.H1.T, zeros(q + p + 2 * n, r)])
    Lambda: Exact = np.block([[inside, column], [column.T, -eps * identity(r)]])
    return Lambda


def congruent(v: Proof) -> Exact:
    """Return T' Lambda T for Eq. (18), T = diag(P^-1, P^-1 / k2, I, I, I, R^-1, I)."""
    s = v.data
    n, _, q, p, _, _, r = s.sizes
    X = inverse(v.loop.P)
    parts = [X, X / s.k2, identity(q), identity(p), identity(n), inverse(v.loop.R), identity(r)]
    T = block_diag(*parts)
    Lambda: Exact = T.T @ lambda_18(v) @ T
    return Lambda


def differing_blocks(v: Proof, reading: Reading) -> list[str]:
    """Return the names of the blocks of Eq. (14) that differ from the congruence."""
    truth, places = congruent(v), [0, *accumulate(v.data.sizes)]
    wrong = truth + matrix_at(minus_omega_as_read(v.data.case, reading), v.unknowns)
    blocks = [(i, j) for i in range(len(NAMES)) for j in range(i, len(NAMES))]
    return [
        f"Ω{i + 1}{j + 1}"
        for i, j in blocks
        if not is_zero(wrong[places[i] : places[i + 1], places[j] : places[j + 1]])
    ]
