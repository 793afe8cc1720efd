"""The report in a few sentences, with the numbers that came out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.models import paper_example as printed
from cosim.paper.every_delay import EveryDelay
from cosim.paper.example import Example
from cosim.paper.row import FIGURES, MODEL, THEOREM_2, Row, Verdict
from cosim.paper.table_2 import Entry

_MET = (Verdict.HOLDS, Verdict.CORRECTED)


def summary_sentences(
    rows: Sequence[Row], known: Example, table: Sequence[Entry], everywhere: EveryDelay | None
) -> tuple[str, ...]:
    """One sentence or two for each part of the paper."""
    return (
        _model(rows),
        _theorem(rows),
        _example(known),
        _table(table, everywhere),
        _figures(rows),
    )


def _model(rows: Sequence[Row]) -> str:
    coefficients = [r for r in rows if r.section == MODEL and r.what.startswith("f(x), row")]
    met = sum(row.verdict in _MET for row in coefficients)
    literal = sum(row.verdict is Verdict.HOLDS for row in coefficients)
    return (
        f"The vehicle: {met} of the {len(coefficients)} coefficients of f(x) come out of Eq. (3) "
        f"and Table 1 once their slips are put right; as printed, {literal} do."
    )


def _theorem(rows: Sequence[Row]) -> str:
    theory = [row for row in rows if row.section == THEOREM_2]
    accepted = [r for r in theory if r.what.endswith("as printed") and r.value and r.value > 0]
    harm = (
        " As printed, the theorem accepts loops that diverge."
        if any(row.verdict is Verdict.IMPOSSIBLE for row in accepted)
        else ""
    )
    slips = [r.what.removeprefix("Eq. (14): ") for r in theory if r.what.startswith("Eq. (14): Ω")]
    return (
        f"Theorem 2: its proof goes through block by block, with {' and '.join(slips)} corrected."
        f"{harm}"
    )


def _example(known: Example) -> str:
    floor = float(np.linalg.norm(known.system.D1, 2))
    K, least = known.by_theorem_1, known.searched.gamma
    proved = "no γ" if K.gamma is None else f"γ = {K.gamma:.5g}"
    return (
        f"Section 5: Theorem 2 cannot give γ = {printed.GAMMA:g}, since every γ of it exceeds "
        f"‖D1‖ = {floor:g}. The printed K is certified for {proved}, its exact norm being "
        f"{K.exact_norm:.5g}; a better K for {least:.7g}. The loop is stable, as claimed."
    )


def _table(table: Sequence[Entry], everywhere: EveryDelay | None) -> str:
    none = [f"{e.gamma:g}" for e in table if e.witness >= 0]
    endless = [e for e in table if e.every_delay]
    text = f"Table 2: Theorem 2 has no solution at γ = {' or '.join(none)}, whatever the delay."
    if everywhere is not None and endless:
        text += (
            f" The other {len(endless)} have no greatest delay: γ = {everywhere.gamma:g} is "
            "certified for every constant delay at once."
        )
    return text


def _figures(rows: Sequence[Row]) -> str:
    count = sum(row.section == FIGURES for row in rows)
    return (
        f"Figures: of the {count} the text holds no data; ours are drawn in their place, and say "
        "what they assume."
    )
