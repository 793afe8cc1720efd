"""Every kind of finding: its number, level, reason, sections of the standards, and an example.

The table is `rules.md`, which is also the page of the documentation. An example
"fmi3: `old` -> `new`" is a change of examples/fmi3.xml that breaks just this rule; the tests make
each. A backslash stands before a bar and before the n of a line's end.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, cast

from cosim.core import InputError

_FOLDER = Path(__file__).parent
_PAGE = (_FOLDER / "rules.md").read_text("utf-8")
_ROW = re.compile(r"^\| ([A-Z]\d\d) \| `(.*?)` \| (.*) \|$", re.MULTILINE)
_CHANGE = re.compile(r"(fmi\d): `(.*)` -> (?:`(.*)`|nothing)")
Level = Literal["error", "warning", "note"]
"""How bad a finding is."""
GROUPS: Mapping[str, str] = MappingProxyType(
    dict(re.findall(r"^## ([A-Z]): (.*)$", _PAGE, re.MULTILINE))
)
"""First letter of a rule's number -> what its rules are about."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of `cosim fmu check`.

    Attributes
    ----------
    code, number : its names; both stay from one version to the next.
    level : the usual one of its findings.
    runs : whether an FMU that breaks it can be run: what it means is clear all the same.
    why : why it matters, and what to do.
    fmi2, fmi3 : sections of FMI 2.0.4 and 3.0.2; empty where no standard asks for it.
    base, old, new : an example to run: in examples/<base>.xml, `old` becomes `new`.
    prose : another example, in words; empty with a `base`.
    """

    code: str
    number: str
    level: Level
    runs: bool
    why: str
    fmi2: str = ""
    fmi3: str = ""
    base: str = ""
    old: str = ""
    new: str = ""
    prose: str = ""

    @property
    def sections(self) -> str:
        """The sections of the standards, in words; empty without one."""
        both = (("FMI 2.0.4", self.fmi2), ("FMI 3.0.2", self.fmi3))
        return "; ".join(f"{standard}, {section}" for standard, section in both if section)

    @property
    def example(self) -> str:
        """What breaks it, on one line."""
        text = self.prose or self.new.strip() or f"without {self.old.strip()}"
        return " ".join(text.split())

    def broken(self) -> str:
        """Return the model description that breaks it; the rule has a `base`."""
        return example_description(self.base).replace(self.old, self.new, 1)

    def to_json(self) -> dict[str, Any]:
        """Return the rule as `cosim fmu check --rule` prints it."""
        return {
            "number": self.number,
            "code": self.code,
            "level": self.level,
            "runs": self.runs,
            "why": self.why,
            "sections": self.sections,
            "example": self.example,
            "instead_of": " ".join(self.old.split()),
        }


def example_description(base: str) -> str:
    """Return a model description without faults: "fmi2" or "fmi3"."""
    return (_FOLDER / "examples" / f"{base}.xml").read_text("utf-8")


def rule_named(name: str) -> Rule:
    """Return the rule of a number or code, such as V11 or start-missing.

    Raises
    ------
    InputError : there is none; names the nearest.
    """
    by_number = {rule.number: rule for rule in RULES.values()}
    found = RULES.get(name.lower()) or by_number.get(name.upper())
    if found is None:
        raise InputError.unknown("rule", name, [*RULES, *by_number], where="`rule`")
    return found


def _rule(number: str, code: str, rest: str) -> Rule:
    level, fmi2, fmi3, why, example = re.split(r"(?<!\\) ?\| ", rest)
    change = _CHANGE.fullmatch(example)
    parts = ("", "", "") if change is None else change.groups("")
    base, old, new = map(_plain, parts)
    prose = "" if base else _plain(example.replace("`", ""))
    why = _plain(why.replace("`", ""))
    level, _, unclear = level.partition(", ")
    of = cast("Level", level), not unclear
    return Rule(code, number, *of, why, fmi2, fmi3, base, old, new, prose)


def _plain(cell: str) -> str:
    """Return the text of a cell or code span."""
    return re.sub(r"\\(.)", lambda found: "\n" if found[1] == "n" else found[1], cell)


RULES: Mapping[str, Rule] = MappingProxyType(
    {found[1]: _rule(*found) for found in _ROW.findall(_PAGE)}
)
"""Code -> rule, in the order of their numbers."""
