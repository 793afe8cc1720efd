"""Consoles, tables and number formats for text output."""

from __future__ import annotations

import shlex
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from cosim.cli.fit_table import fit_table
from cosim.core import printable

NONE = "–"
TONES = {"good": "green", "open": "yellow", "bad": "red", "": ""}
"""Colours of what went well, what is undecided, and what did not."""
Cell = str | Text


def facts(*rows: Iterable[Cell]) -> Table:
    """Return a table of label, value, and how the value was obtained."""
    columns = Column(style="bold"), Column(justify="right"), Column(style="dim")
    return table(columns, rows)


def table(
    columns: str | Iterable[str | Column], rows: Iterable[Iterable[Cell]], title: str | None = None
) -> Table:
    """Return a table without lines.

    columns : headings, in one text with `|` between them or one by one, or none. `>` before a
        heading: its column stands on the right; `*`, behind this: it is bold.
    """
    names = columns.split("|") if isinstance(columns, str) else columns
    made = [_column(name) if isinstance(name, str) else name for name in names]
    has_headings = any(column.header for column in made)
    lines = Table(*made, box=None, pad_edge=False, show_header=has_headings, title=title)
    lines.title_justify = "left"
    for row in rows:
        lines.add_row(*row)
    return lines


def _column(name: str) -> Column:
    heading = name.removeprefix(">")
    return Column(
        heading.removeprefix("*"),
        style="bold" if heading.startswith("*") else "",
        justify="right" if name.startswith(">") else "left",
    )


def typed(verb: str, *arguments: object) -> str:
    """Return a command as it is typed in a shell; `verb` : the words behind `cosim`."""
    return shlex.join(["cosim", *verb.split(), *map(str, arguments)])


def commands(*lines: str) -> Text:
    """Return what to do next: each command on a line of its own, never broken."""
    listed = "\n".join(f"  {line}" for line in lines)
    return Text(f"next:\n{listed}", no_wrap=True, overflow="ignore")


def titles_table(of: str, title: str, rows: list[dict[str, str]]) -> Table:
    """Return a table of the `name` and `title` of each row, with these two headings."""
    table = Table(box=None)
    table.add_column(of, style="bold")
    table.add_column(title)
    for row in rows:
        table.add_row(row["name"], row["title"])
    return table


class _Terminal(Console):
    """A console on which tables are whole, and nothing printed steers it but rich itself."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the parts of what is printed, names of others made harmless."""
        if isinstance(renderable, Table):
            renderable = fit_table(renderable, self, options or self.options, super().render)
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
