"""What became of the assertions of a run: written at its end, read by all that tell of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

Result = Literal["holds", "fails", "undecided"]


@dataclass(frozen=True)
class AssertionResult:
    """What became of one assertion.

    Attributes
    ----------
    words : the assertion.
    name : that the scenario gives it; None if it gives none.
    result : "undecided" where a run was stopped before it could be told.
    expected : what it was expected to be.
    at_s : where it was decided: the first point that breaks an `always`, that fulfils an
        `eventually`, from which a `within` was not fulfilled in time; None where there is none.
    """

    words: str
    name: str | None
    result: Result
    expected: Literal["holds", "fails"]
    at_s: float | None

    @property
    def as_expected(self) -> bool:
        """Whether it came out as expected; what a run did not get to is no disappointment."""
        return self.result in (self.expected, "undecided")

    @property
    def summary(self) -> str:
        """Passed, failed or undecided; and what it was, where that is not what one would think."""
        if self.result == "undecided":
            return "undecided: the run ended before"
        if self.expected == "fails":
            passed = "passed: it fails, as expected"
            return passed if self.as_expected else "failed: it holds, but was expected to fail"
        return "passed" if self.as_expected else "failed"

    def to_json(self) -> dict[str, Any]:
        """For `--json` and the trace."""
        return {
            "assertion": self.words,
            "name": self.name,
            "result": self.result,
            "expected": self.expected,
            "as_expected": self.as_expected,
            "at_s": self.at_s,
        }


def assertions_in(result: Mapping[str, Any] | None) -> list[AssertionResult]:
    """The assertions in the result of a trace (as `describe` gives it), those that failed first.

    What others wrote in their place is no assertion.
    """
    listed = (result or {}).get("assertions")
    found = [
        AssertionResult(
            words=str(entry.get("assertion")),
            name=None if entry.get("name") is None else str(entry["name"]),
            result=entry["result"],
            expected="fails" if entry.get("expected") == "fails" else "holds",
            at_s=at if isinstance(at := entry.get("at_s"), float) and math.isfinite(at) else None,
        )
        for entry in (listed if isinstance(listed, list) else ())
        if isinstance(entry, dict) and entry.get("result") in get_args(Result)
    ]
    return sorted(found, key=lambda each: each.as_expected)


def failed_in(assertions: list[AssertionResult]) -> str:
    """How many failed, in words; "" if none did."""
    failed = sum(not each.as_expected for each in assertions)
    return f"{failed} of {len(assertions)} assertions failed" if failed else ""
