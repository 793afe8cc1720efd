"""Table 2: for each gamma the printed delay, what the corrected LMI bears, and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cosim.core import Progress
from cosim.hinf import DELAY_LIMIT, GreatestDelay, certified_delay, greatest_delay
from cosim.models import DelaySystem, paper_example
from cosim.paper.every_delay import EveryDelay
from cosim.paper.exact import decimals
from cosim.paper.misprints import greatest_delay_as_printed
from cosim.paper.row import TABLE, How, Row, Verdict

ORDER = 2
"""Of the Bessel-Legendre inequality in the column `bessel_legendre`."""

HALF_DIGIT = 0.005
"""Of the table's delays [s]."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One column of Table 2.

    gamma, printed : as in the table [-, s].
    as_printed : where Eq. (14), misprints and all, ends at the printed k1, k2 [s]; computed.
    corrected : d* of the corrected LMI at the printed k1, k2 [s]; certified.
    refuted_at : a delay just above it [s] at which multipliers show that there is no solution.
    searched, k1, k2, K : greatest delay with k1, k2 searched [s], certified, and what for.
    limit_reached : the search ended at its limit, not at an end of the delay.
    bessel_legendre : greatest certified delay [s] of the gain designed at the printed k1, k2, by
    the
        Bessel-Legendre condition of order `ORDER`.
    bessel_legendre_limit_reached : as above.
    every_delay : this gamma is certified for every constant delay, with a suitable gain.
    witness : v' Omega v for a vector v, whatever the unknowns; >= 0 says that there is no
        solution at any delay, k1, k2.
    """

    gamma: float
    printed: float
    as_printed: float | None
    corrected: float | None
    refuted_at: float | None
    searched: float | None
    k1: float | None
    k2: float | None
    K: list[list[float]] | None
    limit_reached: bool
    bessel_legendre: float | None
    bessel_legendre_limit_reached: bool
    every_delay: bool
    witness: Fraction

    @property
    def verdict(self) -> Verdict:
        """Of the printed delay as the greatest one."""
        if self.witness >= 0:
            return Verdict.IMPOSSIBLE
        same = self.corrected is not None and abs(self.corrected - self.printed) <= HALF_DIGIT
        return Verdict.HOLDS if same else Verdict.DOES_NOT

    @property
    def why(self) -> str:
        """In words."""
        if self.witness >= 0:
            return (
                f"γ must exceed ‖D1‖: vᵀΩv = {self.witness} for a v in the rows of w and z, "
                "whatever d, k1, k2 and the unknowns are."
            )
        if self.refuted_at is not None and self.printed > self.refuted_at:
            at = f"Infeasible at the printed k1, k2 from {self.refuted_at:.4f} s on"
        elif self.printed < (self.corrected or 0.0):
            at = "Borne, but not the greatest delay at the printed k1, k2"
        else:
            at = "Beyond what the corrected LMI bears at the printed k1, k2"
        if self.every_delay:
            return f"{at}. With other k1, k2 there is no greatest delay: this γ holds at every one."
        return f"{at}."

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "gamma": self.gamma,
            "printed": self.printed,
            "as_printed": None if self.as_printed is None else round(self.as_printed, 4),
            "corrected": self.corrected,
            "refuted_at": self.refuted_at,
            "searched": self.searched,
            "k1": self.k1,
            "k2": self.k2,
            "K": self.K,
            "limit_reached": self.limit_reached,
            "bessel_legendre": self.bessel_legendre,
            "bessel_legendre_order": None if self.bessel_legendre is None else ORDER,
            "bessel_legendre_limit_reached": self.bessel_legendre_limit_reached,
            "every_delay": self.every_delay,
            "feasible": self.witness < 0,
            "witness": str(self.witness),
            "verdict": str(self.verdict),
            "why": self.why,
        }

    def row(self) -> Row:
        """The same as a row of the report."""
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
        )


def table_2(
    everywhere: EveryDelay | None,
    report_progress: Progress,
    limit: float = DELAY_LIMIT,
    gammas: tuple[float, ...] | None = None,
) -> list[Entry]:
    """All columns, or those of `gammas`; the search for k1, k2 goes from one to the next.

    Parameters
    ----------
    everywhere : what is certified for every delay.
    report_progress : hears what is done, and its share.
    limit : where searches end [s].
    gammas : columns of Table 2.
    """
    system, entries = paper_example.system(), []
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    columns = [at for at in paper_example.TABLE_2 if gammas is None or at[0] in gammas]
    for place, (gamma, printed) in enumerate(columns):
        report_progress(f"Table 2, γ = {gamma:g}", place / len(columns))
        witness = direct_term(system, gamma)
        if witness >= 0:
            entries.append(_nothing(gamma, printed, witness))
            continue
        k1, k2 = (paper_example.K1,), (paper_example.K2,)
        fixed = greatest_delay(system, gamma, k1, k2)
        best = _searched(system, gamma, start or (k1, k2), limit, known=start is not None)
        start = best.design.k1, best.design.k2
        bessel_legendre = certified_delay(system, fixed.design.K, gamma, order=ORDER, limit=limit)
        entries.append(
            Entry(
                gamma=gamma,
                printed=printed,
                as_printed=greatest_delay_as_printed(gamma, printed),
                corrected=fixed.delay,
                refuted_at=fixed.refuted_at,
                searched=best.delay,
                k1=best.design.k1[0],
                k2=best.design.k2[0],
                K=best.design.K.tolist(),
                limit_reached=best.limit_reached,
                bessel_legendre=bessel_legendre.d,
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
    """From k1, k2 that reached the limit for a smaller gamma, if there are any."""
    if known:
        again = greatest_delay(system, gamma, *start, limit=limit)
        if again.limit_reached:
            return again
    return greatest_delay(system, gamma, *start, limit=limit, search=True)


def direct_term(system: DelaySystem, gamma: float) -> Fraction:
    """v' Omega v for v = (w, z) = (1, D1 / gamma), exactly: |D1|^2 / gamma - gamma.

    The rows of w and z of Eq. (14) are -gamma I, D1', -gamma I, whatever the unknowns are.
    """
    D1, level = decimals(system.D1), Fraction(repr(gamma))
    w = decimals([[1.0]])
    z = D1 @ w / level
    value: Fraction = (-level * w.T @ w + 2 * z.T @ D1 @ w - level * z.T @ z)[0, 0]
    return value


def _nothing(gamma: float, printed: float, witness: Fraction) -> Entry:
    return Entry(
        gamma=gamma,
        printed=printed,
        as_printed=None,
        corrected=None,
        refuted_at=None,
        searched=None,
        k1=None,
        k2=None,
        K=None,
        limit_reached=False,
        bessel_legendre=None,
        bessel_legendre_limit_reached=False,
        every_delay=False,
        witness=witness,
    )
