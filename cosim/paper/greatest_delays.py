"""Rows of Table 2: for each gamma the printed, the certified and the true greatest delay."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

from cosim.core import Progress
from cosim.hinf import GreatestDelay, certified_delay, greatest_delay
from cosim.hinf.problem import DELAY_LIMIT
from cosim.models import DelaySystem, paper_example
from cosim.paper.exact import decimals
from cosim.paper.for_every_delay import EveryDelay
from cosim.paper.misprints import greatest_delay_as_printed
from cosim.paper.row import TABLE, How, Row, Verdict

ORDER = 2
"""Order of the Bessel-Legendre inequality in the column `bessel_legendre`."""

CHOSEN_GAMMA = "γ = 5 at d = 0.3 s by Theorem 2"
"""The row at which a gamma that is not above |D1| is counted as an error."""

WHOLE_TABLE = "the delays of Table 2, by Eq. (14) as it is printed"
"""The row at which its other delays are counted as one error."""

HALF_DIGIT = 0.005
"""Half a unit of the last printed digit of the delays [s]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Entry:
    """One column of Table 2.

    gamma, printed : as in the table [-, s].
    as_printed : greatest delay of Eq. (14) with its misprints at the printed k1, k2 [s]; computed.
    corrected : d* of the corrected LMI at the printed k1, k2 [s]; certified.
    refuted_at : a delay just above it [s] at which multipliers prove that there is no solution.
    searched, k1, k2, K : greatest certified delay with k1, k2 searched [s], and its scalars, gain.
    limit_reached : the search ended at its limit, not at a greatest delay.
    bessel_legendre : greatest certified delay [s] of the gain designed at the printed k1, k2, by
        the Bessel-Legendre condition of order `ORDER`.
    bessel_legendre_limit_reached : the same as `limit_reached`, for `bessel_legendre`.
    every_delay : this gamma is certified for every constant delay, with a suitable gain.
    witness : v' Omega v for a vector v, whatever the unknowns; >= 0 proves that there is no
        solution at any delay, k1, k2.
    """

    gamma: float
    printed: float
    as_printed: float | None = None
    corrected: float | None = None
    refuted_at: float | None = None
    searched: float | None = None
    k1: float | None = None
    k2: float | None = None
    K: list[list[float]] | None = None
    limit_reached: bool = False
    bessel_legendre: float | None = None
    bessel_legendre_limit_reached: bool = False
    every_delay: bool = False
    witness: Fraction

    @property
    def verdict(self) -> Verdict:
        """The verdict on the printed delay."""
        if self.witness >= 0:
            return Verdict.IMPOSSIBLE
        same = self.corrected is not None and abs(self.corrected - self.printed) <= HALF_DIGIT
        return Verdict.HOLDS if same else Verdict.DOES_NOT

    @property
    def why(self) -> str:
        """The reason for the verdict, in words."""
        if self.witness >= 0:
            return (
                f"γ must exceed ‖D1‖: vᵀΩv = {self.witness} for a v in the rows of w and z, "
                "whatever d, k1, k2 and the unknowns are."
            )
        if self.refuted_at is not None and self.printed > self.refuted_at:
            at = f"Infeasible at the printed k1, k2 from {self.refuted_at:.4f} s on"
        elif self.printed < (self.corrected or 0.0):
            at = "Feasible, but not the greatest delay at the printed k1, k2"
        else:
            at = "Above the greatest delay of the corrected LMI at the printed k1, k2"
        if self.every_delay:
            return f"{at}. With other k1, k2 there is no greatest delay: this γ holds at every one."
        return f"{at}."

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return asdict(self) | {
            "as_printed": None if self.as_printed is None else round(self.as_printed, 4),
            "bessel_legendre_order": None if self.bessel_legendre is None else ORDER,
            "feasible": self.witness < 0,
            "witness": str(self.witness),
            "verdict": str(self.verdict),
            "why": self.why,
        }

    def row(self) -> Row:
        """Return the column as a row of the report."""
        if self.corrected is None:
            computed = "no delay"
        else:
            end = "≥ " if self.limit_reached else ""
            computed = (
                f"{self.corrected:.4f} s at the printed k1, k2; {end}{self.searched:g} s searched"
            )
            if self.every_delay:
                computed += "; in truth every delay"
        return Row(
            TABLE,
            f"Table 2, γ = {self.gamma:g}: d*",
            f"{self.printed:.2f} s",
            computed,
            How.CERTIFIED,
            self.verdict,
            self.why,
            printed_value=self.printed,
            value=self.corrected,
            follows_from=(CHOSEN_GAMMA if self.witness >= 0 else WHOLE_TABLE,),
        )


def table_2(
    everywhere: EveryDelay | None,
    report_progress: Progress,
    limit: float = DELAY_LIMIT,
    gammas: tuple[float, ...] | None = None,
) -> list[Entry]:
    """Compute the columns of Table 2; each search for k1, k2 starts from the result of the last.

    Parameters
    ----------
    everywhere : the result of `every_delay`.
    report_progress : called with the current step and the share done.
    limit : largest delay that is tried [s].
    gammas : the columns to compute; None for all.
    """
    system, entries = paper_example.system(), []
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    columns = [at for at in paper_example.TABLE_2 if gammas is None or at[0] in gammas]
    for place, (gamma, printed) in enumerate(columns):
        report_progress(f"Table 2, γ = {gamma:g}", place / len(columns))
        witness = direct_term(system, gamma)
        if witness >= 0:
            entries.append(Entry(gamma=gamma, printed=printed, witness=witness))
            continue
        k1, k2 = (paper_example.K1,), (paper_example.K2,)
        fixed = greatest_delay(system, gamma, k1, k2)
        best = _searched(system, gamma, start or (k1, k2), limit, known=start is not None)
        start = best.result.k1, best.result.k2
        bessel_legendre = certified_delay(system, fixed.result.K, gamma, order=ORDER, limit=limit)
        entries.append(
            Entry(
                gamma=gamma,
                printed=printed,
                as_printed=greatest_delay_as_printed(gamma, printed),
                corrected=fixed.delay,
                refuted_at=fixed.refuted_at,
                searched=best.delay,
                k1=best.result.k1[0],
                k2=best.result.k2[0],
                K=best.result.K.tolist(),
                limit_reached=best.limit_reached,
                bessel_legendre=bessel_legendre.delay,
                bessel_legendre_limit_reached=bessel_legendre.limit_reached,
                every_delay=everywhere is not None and gamma >= everywhere.gamma,
                witness=witness,
            )
        )
    return entries


def _searched(
    system: DelaySystem,
    gamma: float,
    start: tuple[tuple[float, ...], tuple[float, ...]],
    limit: float,
    *,
    known: bool,
) -> GreatestDelay:
    """Try k1, k2 that reached the limit at a smaller gamma before searching new ones."""
    if known:
        again = greatest_delay(system, gamma, *start, limit=limit)
        if again.limit_reached:
            return again
    return greatest_delay(system, gamma, *start, limit=limit, search=True)


def direct_term(system: DelaySystem, gamma: float) -> Fraction:
    """Return v' Omega v for v = (w, z) = (1, D1 / gamma), exactly: |D1|^2 / gamma - gamma.

    The rows of w and z of Eq. (14) are -gamma I, D1', -gamma I, whatever the unknowns are.
    """
    D1, level = decimals(system.D1), Fraction(repr(gamma))
    w = decimals([[1.0]])
    z = D1 @ w / level
    value: Fraction = (-level * w.T @ w + 2 * z.T @ D1 @ w - level * z.T @ z)[0, 0]
    return value


def table_rows(entries: list[Entry], everywhere: EveryDelay | None) -> list[Row]:
    """Return one row per column of the table, then three rows on the whole table."""
    rows = [entry.row() for entry in entries]
    literal = [entry for entry in entries if entry.as_printed is not None]
    worst = max(abs((entry.as_printed or 0.0) - entry.printed) for entry in literal)
    rows.append(
        Row(
            TABLE,
            WHOLE_TABLE,
            ", ".join(f"{entry.printed:.2f}" for entry in literal) + " s",
            ", ".join(f"{entry.as_printed:.2f}" for entry in literal) + " s",
            How.COMPUTED,
            Verdict.HOLDS if worst <= HALF_DIGIT else Verdict.DOES_NOT,
            f"For γ = {literal[0].gamma:g} to {literal[-1].gamma:g} at the printed k1, k2, with "
            "both misprints: they do not explain the table.",
        )
    )
    ends = [entry.corrected for entry in entries if entry.corrected is not None]
    grows = all(low < high for low, high in pairwise(ends))
    rows.append(
        Row(
            TABLE,
            "conclusion from Table 2",
            "with γ the greatest delay d* increases",
            "at the printed k1, k2 it does; with k1, k2 free there is no greatest delay",
            How.CERTIFIED,
            Verdict.HOLDS if grows else Verdict.DOES_NOT,
            "The limit is that of the condition at these k1, k2, not that of the loop.",
        )
    )
    if everywhere is not None:
        K = " ".join(f"{x:g}" for x in everywhere.K.ravel())
        rows.append(
            Row(
                TABLE,
                "the least γ for every delay",
                "d* = 1.05 s at γ = 5, 1.15 s at γ = 20",
                f"γ = {everywhere.gamma:g} at every constant delay, with K = ({K})",
                How.CERTIFIED,
                Verdict.DOES_NOT,
                "A functional without the delay (P and Q alone) proves it, uncertainty included; "
                "only γ ≤ ‖D1‖ is out of reach.",
                value=everywhere.gamma,
                follows_from=(WHOLE_TABLE,),
            )
        )
    return rows
