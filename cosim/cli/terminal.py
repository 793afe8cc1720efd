"""Where people read, and the table of facts that every answer has."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

NONE = "–"


def facts_table() -> Table:
    """Label, value, how it was obtained."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_column(style="dim")
    return table


def titles_table(of: str, title: str, rows: list[dict[str, str]]) -> Table:
    """Rows of `name` and `title`, under these two headings."""
    table = Table(box=None)
    table.add_column(of, style="bold")
    table.add_column(title)
    for row in rows:
        table.add_row(row["name"], row["title"])
    return table


def console(*, error: bool = False) -> Console:
    """Where people read: standard output, or standard error for progress and messages."""
    return Console(stderr=error, highlight=False)


def plain(text: object) -> Text:
    """Text as it is: what is in a file is no markup and cannot steer the terminal."""
    return Text("".join(c if c.isprintable() else "\ufffd" for c in str(text)))


def number(value: float | None, digits: int, unit: str = "") -> str:
    """So many digits and the unit, or a dash."""
    return NONE if value is None else f"{value:.{digits}g} {unit}".strip()
