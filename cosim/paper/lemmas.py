"""Rows of Lemmas 1 to 3, each checked with exact numbers.

An identity is checked at random numbers; a misprint is shown by numbers at which the printed
form fails.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import flint
import numpy as np

from cosim.paper.exact import (
    Draw,
    Exact,
    fraction,
    fractions,
    identity,
    inverse,
    is_positive,
    is_zero,
    rational,
    schur,
)
from cosim.paper.row import THEORY, How, Row, Verdict


def lemma_rows() -> list[Row]:
    """Return the rows of Lemmas 1 to 3."""
    return [_lemma_1(), *_lemma_2(), *_lemma_3()]


def _lemma_1() -> Row:
    """eps H H' + G'G / eps - H F G - (H F G)' = V'V / eps + G'(I - F'F) G / eps, V = eps H' - F G.

    So the left side is not negative where F'F <= I: the sufficient half. The necessary half is
    the S-procedure, which is not repeated here.
    """
    draw = Draw(1)
    H, G, F = draw.matrix(3, 2), draw.matrix(2, 3), draw.matrix(2, 2) / Fraction(9)
    eps = Fraction(2, 3)
    left = eps * H @ H.T + G.T @ G / eps - H @ F @ G - (H @ F @ G).T
    V = eps * H.T - F @ G
    inside = identity(2) - F.T @ F
    gap = left - (V.T @ V + G.T @ inside @ G) / eps
    holds = is_zero(gap) and is_positive(inside)
    return Row(
        THEORY,
        "Lemma 1",
        "Y + εHHᵀ + ε⁻¹GᵀG < 0 takes F(t) out",
        "the difference to HFG + its transpose is a sum of squares, exactly",
        How.COMPUTED,
        Verdict.HOLDS if holds else Verdict.DOES_NOT,
        "Completing the square shows the half that Theorem 2 needs.",
    )


def polynomials(draw: Draw, n: int, degree: int) -> list[Any]:
    """Return n random polynomials with small integer coefficients: a trajectory x(t)."""
    return [flint.fmpq_poly([int(c) for c in row]) for row in draw.matrix(n, degree + 1)]


def form(matrix: Exact, x: list[Any]) -> Any:
    """Return x' M x for polynomials x."""
    total: Any = flint.fmpq_poly([])
    for i, j in np.ndindex(matrix.shape[0], matrix.shape[1]):
        total += rational(matrix[i, j]) * x[i] * x[j]
    return total


def at(x: list[Any], t: Fraction) -> Exact:
    """Return the values of polynomials at t, as a column."""
    return np.array([[fraction(p(rational(t)))] for p in x], dtype=object)


def integral(p: Any, low: Fraction, high: Fraction) -> Fraction:
    """Return the integral of a polynomial."""
    integrated: Fraction = at([p.integral()], high)[0, 0] - at([p.integral()], low)[0, 0]
    return integrated


def lemma_2_gap(x: list[Any], X: Exact, M1: Exact, M2: Exact, h: Fraction) -> Fraction:
    """Return right side minus left side of Lemma 2 at t = h, along a polynomial trajectory."""
    now, then = at(x, h), at(x, Fraction(0))
    xi = np.vstack([now, then])
    first = np.block([[M1.T + M1, -M1.T + M2], [-M1 + M2.T, -M2.T - M2]])
    M = np.hstack([M1, M2])
    right = (xi.T @ (first + h * M.T @ inverse(X) @ M) @ xi)[0, 0]
    slope = [p.derivative() for p in x]
    gap: Fraction = right + integral(form(X, slope), Fraction(0), h)
    return gap


def _lemma_2() -> list[Row]:
    draw, n, h = Draw(2), 2, Fraction(3, 4)
    X, M1, M2 = draw.positive(n), draw.matrix(n, n), draw.matrix(n, n)
    x = polynomials(draw, n, 3)
    gap = lemma_2_gap(x, X, M1, M2, h)
    # the completed square is int (x' + X^-1 M xi)' X (x' + X^-1 M xi) ds
    shift = inverse(X) @ (M1 @ at(x, h) + M2 @ at(x, Fraction(0)))
    moved = [p.derivative() + rational(c) for p, c in zip(x, shift.ravel(), strict=True)]
    square = integral(form(X, moved), Fraction(0), h)
    straight = polynomials(draw, n, 1)
    tight = lemma_2_gap(straight, X, -X / h, X / h, h)
    holds = gap == square and gap > 0 and tight == 0
    return [
        Row(
            THEORY,
            "Lemma 2: the inequality",
            "-∫ẋᵀXẋ ds ≤ ξᵀ(...)ξ",
            f"right minus left is the integral of a square, exactly ({float(gap):.4g} for a cubic "
            "x(t)); 0 for a straight one",
            How.COMPUTED,
            Verdict.HOLDS if holds else Verdict.DOES_NOT,
            "It holds for every M1 and M2, and for the best ones it is an equality on straight "
            "lines.",
        ),
        Row(
            THEORY,
            "Lemma 2: the size of M1, M2",
            "M1, M2 ∈ Rⁿ",
            "n × n matrices",
            None,
            Verdict.CORRECTED,
            "M1ᵀ + M1 and M1ᵀX⁻¹M1 have no meaning for a column of n numbers; Theorem 2 itself "
            "sets M1 = k1 P.",
        ),
    ]


def lemma_3_counterexample() -> tuple[Exact, Exact, Exact]:
    """Return S11, S12, S22 with S < 0, S22 < 0, and a diagonal entry >= 0 in the printed (iii)."""
    for seed in range(1000):
        draw = Draw(seed)
        S11, S12, S22 = -draw.positive(2), draw.matrix(2, 2), -draw.positive(2)
        S = np.block([[S11, S12], [S12.T, S22]])
        printed = S11 - S12.T @ inverse(S22) @ S12
        if is_positive(-S) and max(printed[0, 0], printed[1, 1]) >= 0:
            return S11, S12, S22
    raise ArithmeticError("no counterexample among 1000 drawn matrices, where many are expected")


def _lemma_3() -> list[Row]:
    S11, S12, S22 = lemma_3_counterexample()
    printed = S11 - S12.T @ inverse(S22) @ S12
    worst = max(printed[0, 0], printed[1, 1])
    S = np.block([[S11, S12], [S12.T, S22]])
    corrected = S11 - S12 @ inverse(S22) @ S12.T
    both = is_positive(-corrected) and is_positive(-schur(S, 2))
    return [
        Row(
            THEORY,
            "Lemma 3 (ii)",
            "S11 < 0, S22 - S12ᵀS11⁻¹S12 < 0",
            "the Schur complement of S11",
            How.COMPUTED,
            Verdict.HOLDS if is_positive(-(S22 - S12.T @ inverse(S11) @ S12)) else Verdict.DOES_NOT,
            "As in Boyd et al., reference [13].",
        ),
        Row(
            THEORY,
            "Lemma 3 (iii)",
            "S22 < 0, S11 - S12ᵀS22⁻¹S12 < 0",
            f"S11 - S12S22⁻¹S12ᵀ; for S12 = {_text(S12)} and an S < 0 the printed form has the "
            f"diagonal entry {float(worst):.3g} ≥ 0",
            How.CERTIFIED,
            Verdict.CORRECTED if both else Verdict.DOES_NOT,
            "The transposes are exchanged; unless S12 is square, the printed product does not even "
            "exist. The paper uses the lemma correctly.",
        ),
    ]


def _text(matrix: Exact) -> str:
    rows = "; ".join(" ".join(str(x) for x in row) for row in fractions(matrix))
    return f"[{rows}]"
