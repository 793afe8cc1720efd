"""Find the line of a key in a TOML file, for messages.

`tomllib` gives no positions. This scan handles headers, dotted and quoted keys and multi-line
values of a file that has already been parsed; where it finds nothing it returns None.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from itertools import takewhile
from typing import NamedTuple

_HEADER = re.compile(r"^\s*(\[\[|\[)\s*(?P<keys>[^\]]+?)\s*\]")
_ASSIGNMENT = re.compile(
    r"""^\s*(?P<keys>(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*="""
)
_PART = re.compile(r"""[A-Za-z0-9_-]+|"[^"]*"|'[^']*'""")


class Place(NamedTuple):
    """A line (from 1), and how many keys of the path are there."""

    line: int
    depth: int


def place_of(text: str, path: Sequence[str | int]) -> Place | None:
    """Find the longest prefix of `path` that is in `text`; None if none is.

    `path` has a string per key and an integer per place in an array of tables.
    """
    best: tuple[int, int] | None = None
    table: list[str | int] = []
    counts: dict[tuple[str | int, ...], int] = {}
    for number, line in _statements(text):
        header = _HEADER.match(line)
        if header:
            keys = _placed(_split(header["keys"]), counts, begins=header[1] == "[[")
            table, found = keys, keys
        else:
            assignment = _ASSIGNMENT.match(line)
            if not assignment:
                continue
            found = [*table, *_split(assignment["keys"])]
        depth = _common(found, path)
        # a table that is only named by what stands in it has the line of the first of these
        if depth in (len(found), len(path)) and (best is None or depth > best[0]):
            best = (depth, number)
    return Place(best[1], best[0]) if best else None


def _placed(
    keys: Sequence[str | int], counts: dict[tuple[str | int, ...], int], *, begins: bool
) -> list[str | int]:
    """Return the path of a header, with the places in arrays of tables; `begins` : another one."""
    path: list[str | int] = []
    for k, name in enumerate(keys):
        path.append(name)
        here = tuple(path)
        if begins and k == len(keys) - 1:
            counts[here] = counts.get(here, -1) + 1
        if here in counts:
            path.append(counts[here])
    return path


def line_of(text: str, path: Sequence[str | int]) -> int | None:
    """Return the line (from 1) of the longest prefix of `path` that is in `text`, or None."""
    found = place_of(text, path)
    return found.line if found else None


def _statements(text: str) -> list[tuple[int, str]]:
    """Return the lines that begin a statement, without the inside of multi-line values."""
    result = []
    lines = text.splitlines()
    i = 0
    while i < len(lines):
        start = i
        if _ASSIGNMENT.match(lines[i]):
            # a value continues until its lines parse by themselves
            while i + 1 < len(lines) and not _parses("\n".join(lines[start : i + 1])):
                i += 1
        result.append((start + 1, lines[start]))
        i += 1
    return result


def _parses(statement: str) -> bool:
    try:
        tomllib.loads(statement)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _split(keys: str) -> list[str | int]:
    return [part.strip("\"'") for part in _PART.findall(keys)]


def _common(a: Sequence[str | int], b: Sequence[str | int]) -> int:
    return len(list(takewhile(lambda pair: pair[0] == pair[1], zip(a, b, strict=False))))
