"""Tables on narrow terminals: a value may continue on the next line, and is never cut off."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable

from rich.cells import cell_len, set_cell_size
from rich.console import Console, ConsoleOptions
from rich.segment import Segment
from rich.style import StyleType
from rich.table import Table
from rich.text import Text

from cosim.core import printable

Render = Callable[[Table, ConsoleOptions], Iterable[Segment]]
Row = tuple[StyleType | None, tuple[Text, ...]]
"""Style and cells."""

_BREAK = re.compile(r"(?<=[_/])(?=\S)|(?<=[.,])(?=[^\s\d])")
"""Where a word may be broken: behind a separator, but not within a number."""
_NUMBER = re.compile(r"[-+\[(]*\d[\d.e+-]+[\]),;%]*")
_GAP = "  "


def fit_table(table: Table, console: Console, options: ConsoleOptions, render: Render) -> Table:
    """Return a table that is printed without loss: the same one if it is, or a narrow form.

    In the narrow form cells are broken between words and behind separators. If that is too wide
    as well, every cell has a line of its own, behind its heading; a row that has no headings
    becomes a paragraph.

    render : prints a table as rich does, which cuts off what does not fit.
    """

    def as_text(cell: object, style: StyleType) -> Text:
        text = cell.copy() if isinstance(cell, Text) else console.render_str(str(cell))
        text.stylize_before(style)
        return text

    headings = [as_text(column.header, "") for column in table.columns if table.show_header]
    cells = [[as_text(cell, column.style) for cell in column.cells] for column in table.columns]
    lines = "".join(segment.text for segment in render(table, options)).splitlines()
    printed = " ".join(set_cell_size(line, options.max_width) for line in lines)
    texts = (text.plain for column in (headings, *cells) for text in column)
    if _content(printable(" ".join(texts))) <= _content(printed):
        return table
    styles = (row.style for row in table.rows)
    rows = list(zip(styles, zip(*cells, strict=True), strict=True))
    columns = [[*headings[k : k + 1], *column] for k, column in enumerate(cells)]
    least = [
        max(_size(text, whole=column.no_wrap) for text in texts)
        for column, texts in zip(table.columns, columns, strict=True)
    ]
    room = options.max_width - len(_GAP) * (len(columns) - 1)
    if sum(least) <= room:
        return _narrowed(table, rows, _widths(columns, least, room))
    if not headings:
        return _as_paragraphs(table, rows, console, options.max_width)
    return fit_table(_as_pairs(table, headings, rows), console, options, render)


def _content(text: str) -> Counter[str]:
    """Count the letters and digits of a text, and its numbers of several digits."""
    words = text.split()
    return Counter((*"".join(words), *(word for word in words if _NUMBER.fullmatch(word))))


def _size(text: Text, *, whole: bool) -> int:
    """Return the least width of a text: of its longest line, or of what has no break in it."""
    pieces = text.plain.splitlines() if whole else _BREAK.sub(" ", text.plain).split()
    return max(map(cell_len, pieces), default=0)


def _widths(columns: list[list[Text]], least: list[int], room: int) -> list[int]:
    """Return the widths of columns in so much room; the widest become narrower."""
    widths = [max(_size(text, whole=True) for text in texts) for texts in columns]
    for _ in range(sum(widths) - room):
        widest = max((width, k) for k, width in enumerate(widths) if width > least[k])[1]
        widths[widest] -= 1
    return widths


def _empty(table: Table, *, show_header: bool) -> Table:
    """Return a table with the title and the caption of another."""
    return Table(
        box=None,
        pad_edge=False,
        show_header=show_header,
        title=table.title,
        title_style=table.title_style,
        title_justify=table.title_justify,
        caption=table.caption,
        caption_justify=table.caption_justify,
    )


def _narrowed(table: Table, rows: list[Row], widths: list[int]) -> Table:
    narrow = _empty(table, show_header=table.show_header)
    for column, width in zip(table.columns, widths, strict=True):
        narrow.add_column(column.header, justify=column.justify, overflow="fold", width=width)
    for style, texts in rows:
        narrow.add_row(*map(_broken, texts, widths), style=style)
    return narrow


def _as_pairs(table: Table, headings: list[Text], rows: list[Row]) -> Table:
    pairs = _empty(table, show_header=False)
    for k, (style, texts) in enumerate(rows):
        if k:
            pairs.add_row("", "")
        for heading, text in zip(headings, texts, strict=True):
            if text:
                pairs.add_row(heading, text, style=style)
    return pairs


def _as_paragraphs(table: Table, rows: list[Row], console: Console, max_width: int) -> Table:
    paragraphs = _empty(table, show_header=False)
    width = max(max_width - len(_GAP), 1)
    for style, texts in rows:
        text = _broken(Text(_GAP).join(filter(None, texts)), width)
        lines = text.wrap(console, width, overflow="fold")
        paragraphs.add_row(Text(f"\n{_GAP}").join(lines), style=style)
    return paragraphs


def _broken(text: Text, width: int) -> Text:
    """Break words that are longer than the width behind separators, where they have some."""
    breaks = []
    for word in re.finditer(r"\S+", text.plain):
        begin, line = word.start(), 0
        for piece in _BREAK.split(word[0]) if cell_len(word[0]) > width else ():
            if line and line + cell_len(piece) > width:
                breaks.append(begin)
                line = 0
            begin, line = begin + len(piece), line + cell_len(piece)
    return Text("\n").join(text.divide(breaks))
