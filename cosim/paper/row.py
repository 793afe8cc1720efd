"""One claim of the paper beside what comes out when it is computed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Verdict(StrEnum):
    """What can be said of a printed claim."""

    HOLDS = "holds"
    CORRECTED = "holds corrected"
    DOES_NOT = "does not hold"
    IMPOSSIBLE = "cannot hold as printed"
    NOT_COMPARABLE = "not comparable"


MEANING = {
    Verdict.HOLDS: "what is printed comes out, to the digits printed",
    Verdict.CORRECTED: "it comes out once the misprint named is put right",
    Verdict.DOES_NOT: "another value comes out",
    Verdict.IMPOSSIBLE: "it contradicts itself, or what is proved beside it",
    Verdict.NOT_COMPARABLE: "the text gives nothing that could be compared",
}


class How(StrEnum):
    """How a figure was obtained."""

    CERTIFIED = "certified"
    COMPUTED = "computed"
    MEASURED = "measured"


HOW_MEANING = {
    How.CERTIFIED: "proved in exact arithmetic",
    How.COMPUTED: "to a tolerance, or exactly at one set of numbers",
    How.MEASURED: "in a simulated run",
}


@dataclass(frozen=True)
class Row:
    """One claim.

    section : where it stands, one of `SECTIONS`.
    what : the equation, table or figure.
    printed : what the paper prints.
    computed : what comes out.
    how : how that was obtained; None where nothing could be.
    verdict : the one compared with the other.
    why : a sentence or two for who has not computed it.
    printed_value, value : both as numbers, where each is a single one.
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

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "section": self.section,
            "what": self.what,
            "printed": self.printed,
            "computed": self.computed,
            "how": None if self.how is None else str(self.how),
            "verdict": str(self.verdict),
            "why": self.why,
            "printed_value": self.printed_value,
            "value": self.value,
        }


MODEL = "Section 2: the vehicle"
THEORY = "Section 3 and Theorem 1"
THEOREM_2 = "Theorem 2 and its remarks"
EXAMPLE = "Section 5: the example"
TABLE = "Table 2: the greatest delay"
FIGURES = "Figures"
SECTIONS = (MODEL, THEORY, THEOREM_2, EXAMPLE, TABLE, FIGURES)
