"""Rows of Remarks 1 to 3."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.paper.example import Example
from cosim.paper.row import THEOREM_2, How, Row, Verdict
from cosim.paper.table_2 import Entry


def remark_rows(known: Example, table: Sequence[Entry]) -> list[Row]:
    """Remarks 1, 2, 3; `table` has at least one column that is feasible."""
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
            f"Y too is unknown: γ = {least.gamma:.7g} at d = 0.3 s, certified",
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
        ),
    ]
