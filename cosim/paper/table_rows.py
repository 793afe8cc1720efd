"""Rows of Table 2, and of what the paper concludes from it."""

from __future__ import annotations

from itertools import pairwise

from cosim.paper.every_delay import EveryDelay
from cosim.paper.row import TABLE, How, Row, Verdict
from cosim.paper.table_2 import HALF_DIGIT, Entry


def table_rows(entries: list[Entry], everywhere: EveryDelay | None) -> list[Row]:
    """One row per column of the table, then three on the table as a whole."""
    rows = [entry.row() for entry in entries]
    literal = [entry for entry in entries if entry.as_printed is not None]
    worst = max(abs((entry.as_printed or 0.0) - entry.printed) for entry in literal)
    rows.append(
        Row(
            TABLE,
            "the table by Eq. (14) as it is printed",
            ", ".join(f"{entry.printed:.2f}" for entry in literal) + " s",
            ", ".join(f"{entry.as_printed:.2f}" for entry in literal) + " s",
            How.COMPUTED,
            Verdict.HOLDS if worst <= HALF_DIGIT else Verdict.DOES_NOT,
            f"For γ = {literal[0].gamma:g} to {literal[-1].gamma:g} at the printed k1, k2, both "
            "misprints left in: they do not explain the table.",
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
            "What ends is the condition at these k1, k2, not what the loop bears.",
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
            )
        )
    return rows
