"""The results of a run's assertions, as the trace, the summary and the report have them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, computed_field
from pydantic.dataclasses import dataclass

from cosim.trace.outcome.read_json import BY_EITHER_NAME, AsJson, as_text, or_else

Result = Literal["holds", "fails", "undecided"]
"""How an assertion came out."""
_MOST = 4
"""Values that are said of one."""


@dataclass(frozen=True, kw_only=True, config=BY_EITHER_NAME)
class AssertionResult(AsJson):
    """The result of one assertion.

    Attributes
    ----------
    words : the assertion.
    name : its name in the scenario, or None.
    result : "undecided" if the run was stopped before it was decided.
    expected : the expected result.
    at_s : when it was decided [s]: the first point that breaks an `always`, that fulfils an
        `eventually`, or from which a `within` was not fulfilled in time; else None.
    values : of what it names, at the point where that was known; those that are finite.
    """

    words: Annotated[str, as_text(), Field(alias="assertion")]
    name: Annotated[str | None, as_text()] = None
    result: Result
    expected: Annotated[Literal["holds", "fails"], or_else("holds")] = "holds"
    at_s: Annotated[float | None, Field(allow_inf_nan=False), or_else(None)] = None
    values: Annotated[dict[str, float], or_else({})] = Field(default_factory=dict)

    @computed_field  # type: ignore[prop-decorator] # as pydantic has it
    @property
    def as_expected(self) -> bool:
        """Whether the result is the expected one, or undecided."""
        return self.result in (self.expected, "undecided")

    @property
    def place(self) -> str:
        """When it was decided and with which values, to stand behind the summary; "" if not."""
        when = "" if self.at_s is None else f" at {self.at_s:g} s"
        if not self.values or self.as_expected:
            return when
        listed = [f"{name} = {value:.4g}" for name, value in self.values.items() if name != "t"]
        more = ", ..." if len(listed) > _MOST else ""
        return f"{when}: {', '.join(listed[:_MOST])}{more}" if listed else when

    @property
    def summary(self) -> str:
        """Passed, failed or undecided in words, with the result where it was expected to fail."""
        if self.result == "undecided":
            return "undecided: the run ended before"
        if self.expected == "fails":
            passed = "passed: it fails, as expected"
            return passed if self.as_expected else "failed: it holds, but was expected to fail"
        return "passed" if self.as_expected else "failed"


def failed_in(assertions: Sequence[AssertionResult]) -> str:
    """Say how many assertions failed; "" if none did."""
    failed = sum(not each.as_expected for each in assertions)
    return f"{failed} of {len(assertions)} assertions failed" if failed else ""
