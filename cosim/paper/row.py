"""One claim of the paper, as printed and as computed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class Verdict(StrEnum):
    """The result of comparing a printed claim with the computed one."""

    HOLDS = "holds"
    CORRECTED = "holds corrected"
    DOES_NOT = "does not hold"
    IMPOSSIBLE = "cannot hold as printed"
    NOT_COMPARABLE = "not comparable"


MEANING = {
    Verdict.HOLDS: "the printed result is reproduced, to the printed digits",
    Verdict.CORRECTED: "it is reproduced once the named misprint is corrected",
    Verdict.DOES_NOT: "the computed result is another one",
    Verdict.IMPOSSIBLE: "it contradicts itself, or a proof given here",
    Verdict.NOT_COMPARABLE: "the text gives nothing to compare with",
}


class How(StrEnum):
    """How a figure was obtained."""

    CERTIFIED = "certified"
    COMPUTED = "computed"
    MEASURED = "measured"


FAULTY = (Verdict.CORRECTED, Verdict.DOES_NOT, Verdict.IMPOSSIBLE)
"""Verdicts of rows that show an error of the paper."""

HOW_MEANING = {
    How.CERTIFIED: "proved in exact arithmetic",
    How.COMPUTED: "to a tolerance, or exactly at one set of numbers",
    How.MEASURED: "in a simulated run",
}


@dataclass(frozen=True)
class Row:
    """One claim of the paper and the computed result.

    section : one of `SECTIONS`.
    what : the equation, table or figure.
    printed, computed : the claim as the paper prints it, and the computed result.
    how : how the result was obtained; None if nothing could be computed.
    verdict : result of the comparison.
    why : an explanation of one or two sentences.
    printed_value, value : the two as numbers, if each is a single number.
    follows_from : the rows (their `what`) whose errors show here again; empty if the error is
        this row's own, or if there is none.
    """

    section: str
    what: str
    printed: str
    computed: str
    how: How | None
    verdict: Verdict
    why: str
    printed_value: float | None = None
    value: float | None = None
    follows_from: tuple[str, ...] = ()

    @property
    def errors(self) -> tuple[str, ...]:
        """The errors of the paper that show here, by the rows that they are counted at."""
        return (self.follows_from or (self.what,)) if self.verdict in FAULTY else ()

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON values."""
        how = None if self.how is None else str(self.how)
        return asdict(self) | {
            "how": how,
            "verdict": str(self.verdict),
            "follows_from": list(self.follows_from),
            "errors": list(self.errors),
        }


MODEL = "Section 2: the vehicle"
THEORY = "Section 3 and Theorem 1"
THEOREM_2 = "Theorem 2 and its remarks"
EXAMPLE = "Section 5: the example"
TABLE = "Table 2: the greatest delay"
FIGURES = "Figures"
SECTIONS = (MODEL, THEORY, THEOREM_2, EXAMPLE, TABLE, FIGURES)
"""The sections of the report, in the order of the paper."""
