"""What a check of a trace comes to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "failed", "incomplete", "not checked"]

_MOST_REPORTED = 3


@dataclass(frozen=True)
class Check:
    """One thing looked at.

    Attributes
    ----------
    name : what.
    verdict : "failed": it is not as it must be; "incomplete": right as far as it goes, but not
        all is there; "not checked": there is nothing to check it by.
    detail : what was found, in words.
    """

    name: str
    verdict: Verdict
    detail: str


def check_result(name: str, problems: Sequence[str], fine: str) -> Check:
    """A check that failed if there are problems, of which the first are told."""
    if not problems:
        return Check(name, "ok", fine)
    more = f"; and {len(problems) - _MOST_REPORTED} more" if len(problems) > _MOST_REPORTED else ""
    return Check(name, "failed", "; ".join(problems[:_MOST_REPORTED]) + more)


def with_missing(check: Check, missing: Sequence[str], *, cut: bool) -> Check:
    """The same, with what is not there: a fault, unless the file is cut short before it."""
    if not missing or check.verdict == "failed":
        return check
    reported = check_result(check.name, missing, "")
    return Check(check.name, "incomplete", reported.detail) if cut else reported
