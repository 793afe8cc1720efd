"""The results of a run's assertions, as the trace, the summary and the report have them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

Result = Literal["holds", "fails", "undecided"]
"""How an assertion came out."""


@dataclass(frozen=True)
class AssertionResult:
    """The result of one assertion.

    Attributes
    ----------
    words : the assertion.
    name : its name in the scenario, or None.
    result : "undecided" if the run was stopped before it was decided.
    expected : the expected result.
    at_s : when it was decided [s]: the first point that breaks an `always`, that fulfils an
        `eventually`, or from which a `within` was not fulfilled in time; else None.
    """

    words: str
    name: str | None
    result: Result
    expected: Literal["holds", "fails"]
    at_s: float | None

    @property
    def as_expected(self) -> bool:
        """Whether the result is the expected one, or undecided."""
        return self.result in (self.expected, "undecided")

    @property
    def summary(self) -> str:
        """Passed, failed or undecided in words, with the result where it was expected to fail."""
        if self.result == "undecided":
            return "undecided: the run ended before"
        if self.expected == "fails":
            passed = "passed: it fails, as expected"
            return passed if self.as_expected else "failed: it holds, but was expected to fail"
        return "passed" if self.as_expected else "failed"

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json` and the trace."""
        return {
            "assertion": self.words,
            "name": self.name,
            "result": self.result,
            "expected": self.expected,
            "as_expected": self.as_expected,
            "at_s": self.at_s,
        }


def assertions_in(listed: Any) -> list[AssertionResult]:
    """Read a JSON list of `AssertionResult.to_json`; entries of another form are left out."""
    return [
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


def failed_in(assertions: Sequence[AssertionResult]) -> str:
    """Say how many assertions failed; "" if none did."""
    failed = sum(not each.as_expected for each in assertions)
    return f"{failed} of {len(assertions)} assertions failed" if failed else ""
