"""Every kind of finding: its number, level, reason, sections of the standards, and an example.

The table is `rules.toml`. An example on a `base` is a change of examples/<base>.xml that breaks
just this rule; the tests run each.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from cosim.core import InputError

_FOLDER = Path(__file__).parent
GROUPS: Mapping[str, str] = MappingProxyType(
    {
        "F": "The archive",
        "X": "XML",
        "D": "Definitions",
        "V": "Variables",
        "C": "Clocks",
        "S": "Model structure",
        "T": "Terminals and build descriptions",
        "B": "Binaries and other files",
        "R": "Runs (--run)",
    }
)
"""First letter of a rule's number -> what its rules are about."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of `cosim fmu check`.

    Attributes
    ----------
    code, number : its names; both stay from one version to the next.
    level : the usual one of its findings.
    why : why it matters, and what to do.
    fmi2, fmi3 : sections of FMI 2.0.4 and 3.0.2; empty where no standard asks for it.
    base, old, new : an example to run: in examples/<base>.xml, `old` becomes `new`.
    prose : another example, in words; empty with a `base`.
    """

    code: str
    number: str
    level: Literal["error", "warning", "note"]
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
        raise InputError.unknown("rule", name, [*RULES, *by_number], where="--rule")
    return found


def _rules() -> dict[str, Rule]:
    table = tomllib.loads((_FOLDER / "rules.toml").read_text("utf-8"))
    return {
        code: Rule(code, prose=fields.pop("example", ""), **fields)
        for code, fields in table.items()
    }


RULES: Mapping[str, Rule] = MappingProxyType(_rules())
"""Code -> rule, in the order of their numbers."""
