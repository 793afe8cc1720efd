"""Rows of Theorem 1, Eqs. (10)-(13): exact comparison with the functional, block by block.

The functional is written here from its definition, with matrices that select x, x_d, x', z, w
from eta = (x, x_d, w); no block of the paper is used for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from cosim.paper.exact import Draw, Exact, identity, inverse, is_zero, schur
from cosim.paper.lemmas import at, form, integral, polynomials
from cosim.paper.lmi import mirrored, zeros
from cosim.paper.row import THEORY, How, Row, Verdict

_N, _Q, _P = 3, 2, 2


@dataclass(frozen=True)
class Loop:
    """Random numbers for Theorem 1: A (A_K), A1, C, D (D_K), D1, P, Q, R, M1, M2, d, gamma."""

    A: Exact
    A1: Exact
    C: Exact
    D: Exact
    D1: Exact
    P: Exact
    Q: Exact
    R: Exact
    M1: Exact
    M2: Exact
    d: Fraction
    gamma: Fraction


def drawn_loop() -> Loop:
    """Draw the numbers; sizes 3, 2, 2 for x, w, z show every missing transpose."""
    draw, n = Draw(10), _N
    return Loop(
        A=draw.matrix(n, n),
        A1=draw.matrix(n, n),
        C=draw.matrix(n, _Q),
        D=draw.matrix(_P, n),
        D1=draw.matrix(_P, _Q),
        P=draw.positive(n),
        Q=draw.positive(n),
        R=draw.positive(n),
        M1=draw.matrix(n, n),
        M2=draw.matrix(n, n),
        d=Fraction(3, 10),
        gamma=Fraction(7, 2),
    )


def functional_form(v: Loop) -> Exact:
    """Return M with V' + z'z / gamma - gamma w'w <= eta' M eta, by Lemma 2 for the integral."""
    x, delayed, w = _pick(0, _N), _pick(_N, _N), _pick(2 * _N, _Q)
    slope = v.A @ x + v.A1 @ delayed + v.C @ w
    z = v.D @ x + v.D1 @ w
    m = v.M1 @ x + v.M2 @ delayed
    form = x.T @ v.P @ slope + (x - delayed).T @ m
    form = form + form.T + x.T @ v.Q @ x - delayed.T @ v.Q @ delayed
    form = form + v.d * (slope.T @ v.R @ slope + m.T @ inverse(v.R) @ m)
    result: Exact = form + z.T @ z / v.gamma - v.gamma * w.T @ w
    return result


def theta(v: Loop) -> Exact:
    """Return Theta of Eq. (10), as printed."""
    n, d = _N, v.d
    one, R = identity, v.R
    rows: list[list[Any]] = [
        [
            v.A.T @ v.P + v.P @ v.A + v.Q + v.M1.T + v.M1,
            v.P @ v.A1 - v.M1.T + v.M2,
            v.P @ v.C,
            v.D.T,
            d * v.A.T,
            d * v.M1.T,
        ],
        [-v.Q - v.M2.T - v.M2, zeros(n, _Q), zeros(n, _P), d * v.A1.T, d * v.M2.T],
        [-v.gamma * one(_Q), v.D1.T, d * v.C.T, zeros(_Q, n)],
        [-v.gamma * one(_P), zeros(_P, n), zeros(_P, n)],
        [-d * inverse(R), zeros(n, n)],
        [-d * R],
    ]
    return np.block(mirrored(rows))


def printed_pi(v: Loop) -> dict[str, Exact]:
    """Return the blocks of Pi below Eq. (13), as printed."""
    A, A1, R, g = v.A, v.A1, v.R, v.gamma
    d, M1, M2, Ri = v.d, v.M1, v.M2, inverse(v.R)
    return {
        "Π11": A.T @ v.P
        + v.P @ A
        + v.Q
        + M1.T
        + M1
        + d * A.T @ R @ A
        + d * M1.T @ Ri @ M1
        + v.D.T @ v.D / g,
        "Π12": v.P @ A1 - M1.T + M2 + d * A.T @ R @ A1 + d * M1.T @ Ri @ M2,
        "Π13": v.P @ v.C + d * A.T @ R @ v.C,
        "Π22": -v.Q - M2.T - M2 + d * A1.T @ R @ A1 + d * M2.T @ Ri @ M2,
        "Π23": d * A1.T @ R @ v.C,
        "Π33": d * v.C.T @ R @ v.C + v.D1.T @ v.D1 / g - g * identity(_Q),
    }


def theorem_1_rows() -> list[Row]:
    """Return the rows of Eqs. (10) to (13)."""
    v = drawn_loop()
    truth = functional_form(v)
    start = {"1": 0, "2": _N, "3": 2 * _N}
    size = {"1": _N, "2": _N, "3": _Q}
    bad = []
    for name, block in printed_pi(v).items():
        i, j = name[-2], name[-1]
        entries = truth[start[i] : start[i] + size[i], start[j] : start[j] + size[j]]
        if not is_zero(entries - block):
            bad.append(name)
    left_out = truth[:_N, 2 * _N :] - printed_pi(v)["Π13"]
    explained = is_zero(left_out - v.D.T @ v.D1 / v.gamma)
    agrees = is_zero(schur(theta(v), 2 * _N + _Q) - truth)
    return [
        _derivative(),
        Row(
            THEORY,
            "Theorem 1, Eq. (10)",
            "Θ < 0",
            "its Schur complement is the functional's quadratic form, entry by entry",
            How.COMPUTED,
            Verdict.HOLDS if agrees else Verdict.DOES_NOT,
            "Compared in fractions with V̇ + zᵀz/γ - γwᵀw, written from the definition of V. For a "
            "given K this is what cosim analyse proves.",
        ),
        Row(
            THEORY,
            "Eq. (13), the blocks of Π",
            "Π13 = PC + dA_KᵀRC",
            f"blocks that differ from the functional: {', '.join(bad) or 'none'}; Π13 lacks "
            "γ⁻¹D_KᵀD1",
            How.CERTIFIED,
            Verdict.CORRECTED if bad == ["Π13"] and explained else Verdict.DOES_NOT,
            "The matrix printed just before it has the term, and so has Eq. (10): this line alone "
            "is misprinted.",
        ),
    ]


def _derivative() -> Row:
    """Check Eq. (11) along a polynomial trajectory, where it is an identity of polynomials."""
    draw, n, d = Draw(11), 2, Fraction(1, 2)
    P, Q, R = draw.positive(n), draw.positive(n), draw.positive(n)
    x = polynomials(draw, n, 3)
    slope = [p.derivative() for p in x]
    lag = flint.fmpq_poly([flint.fmpq(-1, 2), 1])  # t - d
    delayed = [p(lag) for p in x]
    half = flint.fmpq(1, 2)
    once, energy = form(Q, x).integral(), form(R, slope).integral()
    twice = energy.integral()
    V = form(P, x) + once - once(lag) + half * energy - (twice - twice(lag))
    both = [*x, *slope]
    cross = np.block([[zeros(n, n), P], [P, zeros(n, n)]])
    printed = (
        form(cross, both)
        + form(Q, x)
        - form(Q, delayed)
        + half * form(R, slope)
        - (energy - energy(lag))
    )
    moment = Fraction(5, 3)
    value = at([V.derivative()], moment)[0, 0] - at([printed], moment)[0, 0]
    other = integral(form(R, slope), moment - d, moment) - at([energy - energy(lag)], moment)[0, 0]
    holds = V.derivative() == printed and value == 0 and other == 0
    return Row(
        THEORY,
        "Eq. (11)",
        "V̇ along a solution",
        "equal as polynomials for a cubic x(t)" if holds else "another polynomial",
        How.COMPUTED,
        Verdict.HOLDS if holds else Verdict.DOES_NOT,
        "V written out and differentiated in exact arithmetic.",
    )


def _pick(start: int, size: int) -> Exact:
    return np.eye(2 * _N + _Q, dtype=int).astype(object)[start : start + size]
