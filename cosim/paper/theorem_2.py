"""Rows of Theorem 2 and its remarks: each step of the proof, Eqs. (14) and (16)-(18), in fractions.

At random numbers, the congruence of the proof is applied to Eq. (18), and each block of the
result is compared with the block that Eq. (14) prints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from cosim.core import at_most
from cosim.hinf.theorems import minus_omega
from cosim.paper.exact import (
    Exact,
    is_zero,
    rational,
    schur,
)
from cosim.paper.example import Example
from cosim.paper.greatest_delays import Entry
from cosim.paper.lmi import zeros
from cosim.paper.omega import (
    CORRECTED,
    NAMES,
    PRINTED,
    Reading,
    matrix_at,
    minus_omega_as_read,
)
from cosim.paper.proof_2 import LEFT, Proof, differing_blocks, drawn_proof, lambda_18, psi
from cosim.paper.row import THEOREM_2, How, Row, Verdict
from cosim.paper.theorem_1 import theta


def theorem_2_rows() -> list[Row]:
    """Return the rows of the proof's steps and of the LMI that `cosim design` proves."""
    v = drawn_proof()
    blocks = len(NAMES) * (len(NAMES) + 1) // 2
    printed, corrected = differing_blocks(v, PRINTED), differing_blocks(v, CORRECTED)
    others = [name for name in printed if name not in {"Ω12", "Ω25"}]
    only_12 = "Ω25" not in differing_blocks(v, Reading(omega_12=False))
    return [
        _eq_16(v),
        _eq_18(v),
        Row(
            THEOREM_2,
            "Eq. (14): all blocks but Ω12 and Ω25",
            "Ω11 ... Ω77",
            f"{blocks - 2 - len(others)} of {blocks - 2} equal the congruence applied to Eq. (18)",
            How.COMPUTED,
            Verdict.HOLDS if not others else Verdict.DOES_NOT,
            "In fractions, at one set of random numbers.",
        ),
        Row(
            THEOREM_2,
            "Eq. (14): Ω12",
            "k2 A1 X - k1 k2⁻¹ X + X",
            "k2⁻¹ A1 X - k1 k2⁻¹ X + X",
            How.CERTIFIED,
            _slip("Ω12", printed, corrected),
            "Row 2 of Eq. (18) is multiplied by k2⁻¹ P⁻¹, so P A1 becomes k2⁻¹ A1 X. The two "
            "agree for k2 = ±1 alone.",
        ),
        Row(
            THEOREM_2,
            "Eq. (14): Ω25",
            "d k2⁻¹ X A1",
            "d k2⁻¹ X A1ᵀ",
            How.CERTIFIED,
            _slip("Ω25", printed, corrected) if only_12 else Verdict.DOES_NOT,
            "Row 2 of Eq. (18) has d A1ᵀ there; the transpose was lost.",
        ),
        _own_lmi(v),
    ]


def _slip(name: str, printed: list[str], corrected: list[str]) -> Verdict:
    if name not in printed:
        return Verdict.HOLDS
    return Verdict.DOES_NOT if name in corrected else Verdict.CORRECTED


def _eq_16(v: Proof) -> Row:
    """Compare with Theta of Theorem 1 at A + dA + BK, A1 + dA1, D + D2 K, M1 = k1 P, M2 = k2 P."""
    s, P = v.data, v.loop.P
    left, right = _uncertainty(v)
    uncertain = replace(
        v.loop,
        A=s.A + s.E @ v.F @ s.H + s.B @ v.K,
        A1=s.A1 + s.E @ v.F @ s.H1,
        C=s.C,
        D=s.D + s.D2 @ v.K,
        D1=s.D1,
        M1=s.k1 * P,
        M2=s.k2 * P,
        d=s.d,
        gamma=s.gamma,
    )
    change = left @ v.F @ right
    agrees = is_zero(theta(uncertain) - psi(v) - change - change.T)
    return Row(
        THEOREM_2,
        "Eq. (16)",
        "Ψ + column F(t) row + its transpose",
        "equal to Θ of Theorem 1 with M1 = k1 P, M2 = k2 P",
        How.COMPUTED,
        Verdict.HOLDS if agrees else Verdict.DOES_NOT,
        "In fractions, at one set of random numbers.",
    )


def _uncertainty(v: Proof) -> tuple[Exact, Exact]:
    """Return the column and the row of Eq. (16) around F(t)."""
    s = v.data
    n, _, q, p, _, _, r = s.sizes
    column = np.vstack([v.loop.P @ s.E, zeros(n + q + p, LEFT), s.d * s.E, zeros(n, LEFT)])
    return column, np.hstack([s.H, s.H1, zeros(r, q + p + 2 * n)])


def _eq_18(v: Proof) -> Row:
    n, _, q, p, _, _, _ = v.data.sizes
    left, right = _uncertainty(v)
    eq_17 = psi(v) + v.eps * left @ left.T + right.T @ right / v.eps
    agrees = is_zero(schur(lambda_18(v), 4 * n + q + p) - eq_17)
    return Row(
        THEOREM_2,
        "Eqs. (17), (18)",
        "Λ < 0",
        "its Schur complement is Eq. (17)",
        How.COMPUTED,
        Verdict.HOLDS if agrees else Verdict.DOES_NOT,
        "In fractions, at one set of random numbers.",
    )


def _own_lmi(v: Proof) -> Row:
    """Compare `cosim.hinf.minus_omega`, its rows x_d divided by k2, with the corrected Omega.

    Lemma 3 gives d M'R^-1 M a row, -dR below d k1 R and d R; the product keeps the term.
    """
    s, case, unknowns = v.data, v.data.case, v.unknowns
    indexed = {f"{name}[0]": unknowns[name] for name in ("Q", "R", "eps")}
    form = minus_omega(case.system, [rational(s.k1)], [rational(s.k2)], bounded=True)
    ours = matrix_at(form, unknowns | indexed)
    rows = len(ours)
    n, _, q, p, _, _, _ = s.sizes
    scale = np.array([Fraction(1)] * n + [1 / s.k2] * n + [Fraction(1)] * (rows - 2 * n))
    ours = -(scale[:, None] * ours * scale[None, :])
    Omega = -matrix_at(minus_omega_as_read(case), unknowns)
    of_lemma_3 = np.arange(3 * n + q + p, 4 * n + q + p)
    order = [*np.delete(np.arange(len(Omega)), of_lemma_3), *of_lemma_3]
    agrees = is_zero(ours - schur(Omega[np.ix_(order, order)], rows))
    return Row(
        THEOREM_2,
        "the LMI that cosim design proves",
        "Eq. (14)",
        "equal to Eq. (14) with Ω12 and Ω25 corrected, its row of M removed, entry by entry",
        How.COMPUTED,
        Verdict.CORRECTED if agrees else Verdict.DOES_NOT,
        "In fractions; every number below is therefore about the theorem that the proof proves.",
        follows_from=("Eq. (14): Ω12", "Eq. (14): Ω25"),
    )


def remark_rows(known: Example, table: Sequence[Entry]) -> list[Row]:
    """Return the rows of Remarks 1 to 3; at least one column of `table` must be feasible."""
    entry = next(entry for entry in table if entry.corrected is not None)
    least = known.least
    depends = entry.refuted_at is not None
    refuted = "not refuted above" if entry.refuted_at is None else f"{entry.refuted_at:.5f} s"
    end = (
        f"γ = {entry.gamma:g}: certified at {entry.corrected:.5f} s, infeasible (multipliers) at "
        f"{refuted}"
    )
    return [
        Row(
            THEOREM_2,
            "Remark 1: what kind of condition",
            '"delay-independent"',
            f"delay-dependent; {end}",
            How.CERTIFIED,
            Verdict.CORRECTED if depends else Verdict.DOES_NOT,
            "d enters Eq. (14), and the title says so.",
        ),
        Row(
            THEOREM_2,
            "Remark 2, Eq. (19): the least γ",
            "minimise over X, R̄, Q̄, ε",
            f"Y too is unknown: γ = {at_most(least.gamma)} at d = 0.3 s, certified",
            How.CERTIFIED,
            Verdict.CORRECTED,
            "Without Y among the unknowns there would be no gain to find.",
            value=least.gamma,
        ),
        Row(
            THEOREM_2,
            "Remark 3, Eq. (20): the greatest delay",
            "maximise d over X, R̄, Q̄, ε",
            f"the end of an interval from 0, Y unknown too; {end}",
            How.CERTIFIED,
            Verdict.CORRECTED if depends else Verdict.DOES_NOT,
            "At fixed k1, k2 what solves Eq. (14) at d solves it at every smaller delay.",
            value=entry.corrected,
            follows_from=("Remark 2, Eq. (19): the least γ",),
        ),
    ]
