"""The whole report: every claim of the paper, computed now."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from cosim.core import Progress, silent
from cosim.hinf import DELAY_LIMIT, one_thread
from cosim.models import paper_example
from cosim.paper.every_delay import every_delay
from cosim.paper.example import example_rows, solve_example
from cosim.paper.figures import Curves, curves, figure_rows
from cosim.paper.lemmas import lemma_rows
from cosim.paper.misprints import misprint_rows
from cosim.paper.model import model_rows
from cosim.paper.remarks import remark_rows
from cosim.paper.row import HOW_MEANING, MEANING, Row, Verdict
from cosim.paper.summary import summary_sentences
from cosim.paper.table_2 import Entry, table_2
from cosim.paper.table_rows import table_rows
from cosim.paper.theorem_1 import theorem_1_rows
from cosim.paper.theorem_2 import theorem_2_rows

TITLE = "Delay-dependent H∞ Control for Autonomous Underwater Vehicle"
AUTHOR = "X. Yang"


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that came out.

    summary : the report in a few sentences.
    rows : in the paper's order.
    table2 : its columns in full.
    curves : of Figures 2 and 3.
    """

    summary: tuple[str, ...]
    rows: list[Row]
    table2: list[Entry]
    curves: Curves

    @property
    def counts(self) -> dict[Verdict, int]:
        """Rows per verdict, all verdicts."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in Verdict}

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "paper": {"title": TITLE, "author": AUTHOR},
            "summary": list(self.summary),
            "verdicts": {str(verdict): count for verdict, count in self.counts.items()},
            "meaning": {str(verdict): text for verdict, text in MEANING.items()}
            | {str(how): text for how, text in HOW_MEANING.items()},
            "rows": [row.to_json() for row in self.rows],
            "table2": [entry.to_json() for entry in self.table2],
            "figures": {"2 and 3": self.curves.to_json()},
        }


@one_thread
def reproduce(
    report_progress: Progress = silent,
    *,
    limit: float = DELAY_LIMIT,
) -> Report:
    """Compute every row.

    Parameters
    ----------
    report_progress : hears what is being done, and the share of the whole that is.
    limit : where searches for a greatest delay end [s].

    Raises
    ------
    InputError : `limit` is no delay.
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
    return Report(summary_sentences(rows, known, table, everywhere), rows, table, drawn)
