"""Consoles, tables and number formats for text output."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from cosim.core import printable

NONE = "–"


def facts_table() -> Table:
    """Return an empty table for rows of label, value, and how the value was obtained."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_column(style="dim")
    return table


def titles_table(of: str, title: str, rows: list[dict[str, str]]) -> Table:
    """Return a table of the `name` and `title` of each row, with these two headings."""
    table = Table(box=None)
    table.add_column(of, style="bold")
    table.add_column(title)
    for row in rows:
        table.add_row(row["name"], row["title"])
    return table


class _Terminal(Console):
    """A console on which nothing that is printed steers the terminal but rich itself."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the parts of what is printed, names of others made harmless."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text), style, control)


def console(*, error: bool = False) -> Console:
    """Return the console for standard output, or for standard error (progress, messages)."""
    return _Terminal(stderr=error, highlight=False, markup=False, emoji=False)


def plain(text: object) -> Text:
    """Return text on one line, without control characters."""
    return Text("".join(c if c.isprintable() else "\ufffd" for c in str(text)))


def number(value: float | None, digits: int, unit: str = "") -> str:
    """Format a value with so many digits and its unit; a dash for None."""
    return NONE if value is None else f"{value:.{digits}g} {unit}".strip()
