"""The reference of `cosim fmu check`, from its table of rules."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from cosim.fmu import GROUPS, RULES, Rule

_HEAD = """\
# Rules of `cosim fmu check`

Each finding of the check has a rule. Its number and name stay from one version to the next;
`cosim fmu check --rule V11` explains one. This page is generated from the table that the check
itself reads.

- An **error** breaks the standard, or cannot work anywhere.
- A **warning** works in some tools only, or is likely a mistake. What this tool could not read is
  a warning, too: it says nothing about the file.
- A **note** is worth knowing.

What the XML schemas of the standards say is one rule, `xml-schema`: the schemas that FMPy brings
are used as they are. Sections are of FMI 2.0.4 and 3.0.2; where none is given, no standard asks
for it.
"""


def page() -> str:
    """Return the page: a table for each group of rules."""
    return _HEAD + "\n" + "\n\n".join(_group(letter) for letter in GROUPS) + "\n"


def _group(letter: str) -> str:
    rows = [_row(rule) for rule in RULES.values() if rule.number.startswith(letter)]
    head = ["| rule | level | FMI 2 | FMI 3 | why, and what to do | breaks it |"]
    return "\n".join([f"## {GROUPS[letter]}", "", *head, "|---|---|---|---|---|---|", *rows])


def _row(rule: Rule) -> str:
    cells = (f"{rule.number} `{rule.code}`", rule.level, rule.fmi2, rule.fmi3)
    return "| " + " | ".join((*cells, _text(rule.why), "".join(_example(rule)))) + " |"


def _example(rule: Rule) -> Iterator[str]:
    if rule.prose:
        yield _text(rule.prose)
        return
    yield f"<code>{_text(rule.example)}</code>"
    if rule.new:
        yield f" instead of <code>{_text(' '.join(rule.old.split()))}</code>"


def _text(text: str) -> str:
    return escape(text, quote=False).replace("|", "&#124;").replace("*", "&#42;")
