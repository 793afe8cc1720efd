"""The whole report: every claim of the paper, computed anew, and a summary in sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.core import Progress, at_most, silent
from cosim.hinf.delay_lti import one_thread
from cosim.hinf.problem import DELAY_LIMIT
from cosim.models import paper_example
from cosim.paper.example import Example, example_rows, solve_example
from cosim.paper.figures import Curves, curves, figure_rows
from cosim.paper.for_every_delay import EveryDelay, every_delay
from cosim.paper.greatest_delays import Entry, table_2, table_rows
from cosim.paper.lemmas import lemma_rows
from cosim.paper.misprints import misprint_rows
from cosim.paper.model import model_rows
from cosim.paper.row import FIGURES, HOW_MEANING, MEANING, MODEL, THEOREM_2, Row, Verdict
from cosim.paper.theorem_1 import theorem_1_rows
from cosim.paper.theorem_2 import remark_rows, theorem_2_rows

TITLE = "Delay-dependent H∞ Control for Autonomous Underwater Vehicle"
AUTHOR = "X. Yang"


@dataclass(frozen=True, eq=False)
class Report:
    """The results for all claims.

    summary : the report in a few sentences.
    rows : in the order of the paper.
    table2 : the columns of Table 2.
    curves : of Figures 2 and 3.
    """

    summary: tuple[str, ...]
    rows: list[Row]
    table2: list[Entry]
    curves: Curves

    @property
    def counts(self) -> dict[Verdict, int]:
        """Number of rows per verdict, for all verdicts."""
        verdicts = Counter(row.verdict for row in self.rows)
        return {verdict: verdicts[verdict] for verdict in Verdict}

    @property
    def errors(self) -> dict[str, list[str]]:
        """Each error of the paper once, by the row it is counted at: the rows that show it."""
        failed: dict[str, list[str]] = {}
        for row in self.rows:
            for error in row.errors:
                failed.setdefault(error, []).append(row.what)
        return failed

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "paper": {"title": TITLE, "author": AUTHOR},
            "summary": list(self.summary),
            "errors": self.errors,
            "verdicts": {str(verdict): count for verdict, count in self.counts.items()},
            "meaning": {str(verdict): text for verdict, text in MEANING.items()}
            | {str(how): text for how, text in HOW_MEANING.items()},
            "rows": [row.to_json() for row in self.rows],
            "table2": [entry.to_json() for entry in self.table2],
            "figures": {"2 and 3": self.curves.to_json()},
        }


@one_thread
def reproduce(report_progress: Progress = silent, *, limit: float = DELAY_LIMIT) -> Report:
    """Compute every claim of the paper.

    Parameters
    ----------
    report_progress : called with the current step and the share done.
    limit : largest delay that searches for a greatest delay try [s].

    Raises
    ------
    InputError : `limit` is not a valid delay.
    """
    system = paper_example.system()

    def within(low: float, high: float) -> Progress:
        return lambda what, share: report_progress(what, low + share * (high - low))

    report_progress("section 2, the vehicle", 0.0)
    rows = model_rows()
    report_progress("Theorems 1 and 2, block by block", 0.12)
    rows += [*lemma_rows(), *theorem_1_rows()]
    proof = [*theorem_2_rows(), *misprint_rows()]
    known = solve_example(within(0.15, 0.3))
    with_printed_gain = every_delay(system, [paper_example.PRINTED_K])
    example = example_rows(known, with_printed_gain)
    everywhere = every_delay(system)
    table = table_2(everywhere, within(0.3, 0.97), limit)
    rows += [*proof, *remark_rows(known, table), *example, *table_rows(table, everywhere)]
    report_progress("figures", 0.97)
    drawn = curves()
    rows += figure_rows(drawn)
    report_progress("done", 1.0)
    return Report(_summary_sentences(rows, known, table, everywhere), rows, table, drawn)


def _summary_sentences(
    rows: Sequence[Row], known: Example, table: Sequence[Entry], everywhere: EveryDelay | None
) -> tuple[str, ...]:
    """Return one or two sentences for each part of the paper."""
    return (
        _model(rows),
        _theorem(rows),
        _example(known),
        _table(table, everywhere),
        _figures(rows),
    )


def _model(rows: Sequence[Row]) -> str:
    coefficients = [r for r in rows if r.section == MODEL and r.what.startswith("f(x), row")]
    met = sum(row.verdict in (Verdict.HOLDS, Verdict.CORRECTED) for row in coefficients)
    literal = sum(row.verdict is Verdict.HOLDS for row in coefficients)
    return (
        f"The vehicle: {met} of the {len(coefficients)} coefficients of f(x) follow from Eq. (3) "
        f"and Table 1 with their misprints corrected; as printed, {literal} do."
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
    return f"Theorem 2: its proof holds block by block, with {' and '.join(slips)} corrected.{harm}"


def _example(known: Example) -> str:
    floor = float(np.linalg.norm(known.system.D1, 2))
    K, least = known.by_theorem_1, known.searched.gamma
    proved = "no γ" if K.gamma is None else f"γ = {at_most(K.gamma, 5)}"
    return (
        f"Section 5: Theorem 2 cannot give γ = {paper_example.GAMMA:g}, since every γ of it "
        f"exceeds ‖D1‖ = {floor:g}. The printed K is certified for {proved}, its exact norm being "
        f"{K.exact_norm:.5g}; a better K for {at_most(least)}. The loop is stable, as claimed."
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
        f"Figures: the text has no data for the {count} figures; ours are drawn in their place and "
        "state their assumptions."
    )
