"""Docstrings as Markdown, for mkdocstrings: headings and entries as this project writes them.

A section is a heading with a line below it; an entry is `name : text`, or `name, name : text`,
continued by indented lines. There are no types: annotations have them.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

_HEADING = re.compile(r"^(?P<title>[A-Z][A-Za-z ]+)\n-{3,}\n", re.MULTILINE)
_ENTRY = re.compile(
    r"^(?P<names>`?\*{0,2}[\w.\[\]`*]+(?:, [\w.\[\]`*]+)*`?) ?: (?P<text>\S)", re.MULTILINE
)


def as_markdown(text: str) -> str:
    """Return a docstring as Markdown."""
    text = _HEADING.sub(lambda found: f"**{found['title']}**\n\n", text)
    blocks: list[str] = []
    for block in text.split("\n\n"):
        lines = block.splitlines()
        if block.startswith(">>> "):
            blocks.append(f"```pycon\n{block}\n```")
        elif all(line.startswith("    ") for line in lines) and blocks and not _is_list(blocks[-1]):
            blocks.append(block)  # a formula, or a program
        else:
            blocks.append("\n".join(_lines(lines)))
    return "\n\n".join(blocks).replace("::\n", ":\n")


def _is_list(block: str) -> bool:
    return block.startswith("- ")


def _lines(lines: list[str]) -> list[str]:
    """Return the lines of a paragraph, its entries as a list."""
    entries = any(_ENTRY.match(line) for line in lines)
    found: list[str] = []
    for line in lines:
        entry = _ENTRY.match(line)
        safe = _outside_code(line)
        if entry:
            names = ", ".join(f"`{name.strip('`')}`" for name in entry["names"].split(", "))
            found += ["", f"- {names}: {_outside_code(line[entry.start('text') :])}"]
        elif entries and line.startswith("    ") and found:
            found.append(f"    {safe.strip()}")
        else:
            found.append(safe)
    return found


def _outside_code(line: str) -> str:
    """Keep what is not in backticks from being read as HTML, emphasis or a link."""
    parts = re.split(r"(`[^`]*`)", line)
    parts[::2] = [re.sub(r"([<*\[\]_])", _escaped, part) for part in parts[::2]]
    return "".join(parts)


def _escaped(found: re.Match[str]) -> str:
    return "&lt;" if found[0] == "<" else f"\\{found[0]}"


class Docstrings(griffe.Extension):
    """Rewrites every docstring when it is read."""

    def on_instance(self, *, obj: griffe.Object, **_more: Any) -> None:
        """Replace the docstring of an object."""
        if obj.docstring:
            obj.docstring.value = as_markdown(obj.docstring.value)
