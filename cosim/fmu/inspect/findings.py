"""The results of an inspection: code, level, place, fact, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from cosim.core import InputError
from cosim.fmu.inspect.rules import RULES, Level

LEVELS: tuple[Level, ...] = ("error", "warning", "note")
"""Levels of a finding, the gravest first."""

_MOST_OF_ONE_CODE = 25


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of checking an FMU.

    Attributes
    ----------
    code : its name in `RULES`.
    level : error (breaks the standard, or cannot work), warning (works in some tools only, or
        is likely a mistake), note (worth knowing).
    where : file inside the FMU, with the line, variable or symbol.
    what : the fact.
    """

    code: str
    level: Level
    where: str
    what: str

    @property
    def why(self) -> str:
        """Why it matters, and what to do."""
        return RULES[self.code].why

    def to_json(self) -> dict[str, str]:
        """Return the finding as the command line prints it."""
        rule = RULES[self.code]
        return {
            **asdict(self),
            "why": rule.why,
            "number": rule.number,
            "sections": rule.sections,
        }


def finding(code: str, where: str, what: str, *, level: Level | None = None) -> Finding:
    """Make a finding at its usual level, or at `level`."""
    return Finding(code, level or RULES[code].level, where, printable(what))


def refusal(what: str, path: Path, found: Finding, expected: str | None = None) -> InputError:
    """Turn a finding into the error that refuses to run the FMU."""
    where = f"{path}: {printable(found.where)}"
    return InputError(what, where=where, expected=expected, got=found.what, hint=found.why)


def printable(text: str, most: int = 400) -> str:
    """Make text of a foreign file safe to print: one line, no control characters."""
    clean = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
    return clean if len(clean) <= most else f"{clean[:most]}… ({len(clean)} characters)"


def first_few(names: Sequence[str]) -> str:
    """Join the first five names, and show that there are more."""
    return ", ".join(names[:5]) + (", …" if len(names) > 5 else "")


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Sort by level, then as found; drop repeated findings; cut and count many of one code."""
    kept: list[Finding] = []
    counts: dict[tuple[str, Level], int] = {}
    for each in dict.fromkeys(findings):
        kind = (each.code, each.level)
        counts[kind] = counts.get(kind, 0) + 1
        if counts[kind] <= _MOST_OF_ONE_CODE:
            kept.append(Finding(each.code, each.level, printable(each.where), each.what))
    kept += [
        Finding(code, level, "", f"and {n - _MOST_OF_ONE_CODE} more of this kind")
        for (code, level), n in counts.items()
        if n > _MOST_OF_ONE_CODE
    ]
    return sorted(kept, key=lambda each: LEVELS.index(each.level))
