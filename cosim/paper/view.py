"""The report, formatted for a terminal."""

from __future__ import annotations

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim.paper.greatest_delays import ORDER, Entry
from cosim.paper.report import AUTHOR, TITLE, Report
from cosim.paper.row import MEANING, SECTIONS, TABLE, Row, Verdict

_STYLES = {
    Verdict.HOLDS: "green",
    Verdict.CORRECTED: "cyan",
    Verdict.DOES_NOT: "yellow",
    Verdict.IMPOSSIBLE: "bold red",
    Verdict.NOT_COMPARABLE: "dim",
}
_NONE = "–"


def paper_view(report: Report) -> RenderableType:
    """Show all rows by section, Table 2 in full, and the meaning of the verdicts."""
    parts: list[RenderableType] = [Text(f"{AUTHOR}, {TITLE}", style="bold"), Text()]
    for name in SECTIONS:
        if name == TABLE:
            parts += [_delays(report.table2), Text()]
        parts += [_claims(name, [row for row in report.rows if row.section == name]), Text()]
    parts += [_errors(report), Text()]
    sentences = Text("\n".join(f"• {sentence}" for sentence in report.summary))
    return Group(*parts, _summary(report), Text(), sentences)


def _claims(name: str, rows: list[Row]) -> Table:
    table = Table(
        title=name, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, expand=True
    )
    table.add_column("claim", style="bold", ratio=5)
    table.add_column("printed", ratio=4)
    table.add_column("computed", ratio=10)
    table.add_column("verdict", ratio=4)
    for row in rows:
        computed = Text(row.computed)
        if row.how is not None:
            computed.append(f" [{row.how}]", style="dim")
        if row.verdict is not Verdict.HOLDS:
            computed.append(f"\n{row.why}", style="dim")
        verdict = Text(str(row.verdict), style=_STYLES[row.verdict])
        table.add_row(row.what, row.printed, computed, verdict)
    return table


def _errors(report: Report) -> Table:
    """Show each error of the paper once, and in how many claims it shows."""
    rows = {row.what: row for row in report.rows}
    table = Table(
        title=f"Errors of the paper, each counted once: {len(report.errors)}",
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        expand=True,
    )
    table.add_column("error", style="bold", ratio=5)
    table.add_column("printed", ratio=6)
    table.add_column("shows in", justify="right", ratio=2)
    for error, claims in report.errors.items():
        printed = rows[error].printed if error in rows else _NONE
        table.add_row(error, printed, f"{len(claims)} claim{'s' if len(claims) > 1 else ''}")
    return table


def _delays(entries: list[Entry]) -> Table:
    table = Table(
        title="Table 2: greatest delay d* [s]",
        title_justify="left",
        title_style="bold",
        caption="corrected: Eq. (14) corrected, at the printed k1, k2; searched: k1, k2 free; "
        f"order {ORDER}: Bessel-Legendre of that order for the gain of 'corrected'; all certified",
        caption_justify="left",
    )
    for column in ("γ", "printed", "corrected", "searched", f"order {ORDER}", "in truth"):
        table.add_column(column, justify="right")
    table.add_column("verdict")
    for e in entries:
        none = "no delay" if e.witness >= 0 else _NONE
        table.add_row(
            f"{e.gamma:g}",
            f"{e.printed:.2f}",
            _NONE if e.corrected is None else f"{e.corrected:.4f}",
            _format_delay(e.searched, limit_reached=e.limit_reached),
            _format_delay(e.bessel_legendre, limit_reached=e.bessel_legendre_limit_reached),
            "every delay" if e.every_delay else none,
            Text(str(e.verdict), style=_STYLES[e.verdict]),
        )
    return table


def _format_delay(value: float | None, *, limit_reached: bool) -> str:
    if value is None:
        return _NONE
    return f"{'≥ ' if limit_reached else ''}{value:.4g}"


def _summary(report: Report) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    for verdict, count in report.counts.items():
        table.add_row(
            str(count), Text(str(verdict), style=_STYLES[verdict]), Text(MEANING[verdict])
        )
    return table
