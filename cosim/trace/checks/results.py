"""The results of checks of a trace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "failed", "incomplete", "not checked"]

_MOST_REPORTED = 3


@dataclass(frozen=True)
class CheckResult:
    """The result of one check.

    Attributes
    ----------
    name : what was checked.
    verdict : "failed": something is wrong; "incomplete": nothing is wrong, but something is
        missing; "not checked": the trace has nothing to check.
    detail : what was found, in words.
    """

    name: str
    verdict: Verdict
    detail: str


def check_result(name: str, problems: Sequence[str], fine: str) -> CheckResult:
    """Return a check that failed if there are problems, with the first of them as its detail."""
    if not problems:
        return CheckResult(name, "ok", fine)
    more = f"; and {len(problems) - _MOST_REPORTED} more" if len(problems) > _MOST_REPORTED else ""
    return CheckResult(name, "failed", "; ".join(problems[:_MOST_REPORTED]) + more)


def with_missing(check: CheckResult, missing: Sequence[str], *, cut: bool) -> CheckResult:
    """Add missing parts to a check: it failed, or is incomplete if the file is cut short."""
    if not missing or check.verdict == "failed":
        return check
    reported = check_result(check.name, missing, "")
    return CheckResult(check.name, "incomplete", reported.detail) if cut else reported
