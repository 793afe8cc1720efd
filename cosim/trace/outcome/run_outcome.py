"""The outcome of a run: one record that the run writes and every view reads.

It is the metadata record `cosim.result` of a trace. Texts stand there as they are, structures as
JSON, figures of links as `link.<name>.<figure>`; what an older version did not write is absent.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import StrictFloat, StrictInt, TypeAdapter
from pydantic.dataclasses import dataclass

from cosim.core import Fact
from cosim.trace.outcome.assertions import AssertionResult, failed_in
from cosim.trace.outcome.cause import Cause
from cosim.trace.outcome.read_json import FROM_FILE, as_text, each_valid, or_else
from cosim.trace.outcome.run_events import CONCLUSION, EventCount
from cosim.trace.rows.layout import HOST_PREFIX, parsed_json, result_of_link

if TYPE_CHECKING:
    from typing_extensions import TypeIs

OUTCOME_VERSION: Final = 2
"""Of the entries; it grows when one changes its meaning. 1, without this entry: no events."""

GOOD, BAD, OPEN = "good", "bad", "open"
_STATUSES = {
    "finished": (GOOD, "finished"),
    "limit_cycle": (BAD, "limit cycle"),
    "stopped": (OPEN, "stopped"),
    "diverged": (BAD, "diverged"),
    "failed": (BAD, "failed"),
}
_LIMIT_CYCLE = (
    "At the end commands go from limit to limit more than half of the time: the limits, not the "
    "feedback, bound the motion."
)
CONTRADICTION = (
    "Every assumption of the guarantee was met, and yet {}. This should not be possible: please "
    "report it, with the trace."
)
GREATEST_GROWTH = 100.0
"""So many times may a state be greater at the end than at the start, without a disturbance."""
_LINK = "link."
_STRUCTURES = ("metrics", "final", "cause", "assertions", "events")

Figures = Annotated[Mapping[str, Any], or_else({})]
"""JSON-safe values by name."""


@dataclass(frozen=True, kw_only=True, repr=False)
class RunOutcome:
    """The outcome of a run.

    Attributes
    ----------
    status : finished, limit_cycle, stopped, diverged or failed.
    reason : why, None when finished.
    cause : why the run did not reach its end, or what failed after it; None otherwise.
    steps : communication steps done; None if unknown.
    simulated_s : time reached [s]; None if unknown.
    assertions : results, in the order of the scenario.
    events : what happened during the run and how often, by the time at which it first did.
    version : of the record; 1, of older traces, has no events, which says nothing of the run.
    metrics, links, final : JSON-safe figures; `metrics` and `links` as in the documentation,
        `final` the last value of every output by `component.variable`.
    """

    status: Annotated[str, as_text()] = "finished"
    reason: Annotated[str | None, as_text()] = None
    cause: Annotated[Cause | None, or_else(None)] = None
    steps: Annotated[StrictInt | None, or_else(None)] = None
    simulated_s: Annotated[StrictFloat | None, or_else(None)] = None
    assertions: Annotated[tuple[AssertionResult, ...], each_valid(AssertionResult)] = ()
    events: Annotated[tuple[EventCount, ...], each_valid(EventCount)] = ()
    metrics: Figures = field(default_factory=dict)
    links: Annotated[Mapping[str, Figures], or_else({})] = field(default_factory=dict)
    final: Figures = field(default_factory=dict)
    version: Annotated[StrictInt, or_else(1)] = OUTCOME_VERSION

    def __repr__(self) -> str:
        at = "" if self.simulated_s is None else f" at {self.simulated_s:g} s"
        return f"<RunOutcome {self.headline}{at}>"

    @property
    def assumptions(self) -> Mapping[str, Any]:
        """Whether each assumption of the guarantee was met, by name; empty without a guarantee."""
        found = self.metrics.get("assumptions")
        return found if isinstance(found, dict) else {}

    @property
    def departures(self) -> Mapping[str, list[Mapping[str, Any]]]:
        """Why assumptions were not met: by assumption `place`, `expected`, `got`, and `at_s`."""
        found: dict[str, list[Mapping[str, Any]]] = {}
        listed = self.metrics.get("departures")
        if listed is None:
            listed = _older(self.metrics.get("plant_differences"))
        for each in listed if isinstance(listed, list) else ():
            if isinstance(each, dict):
                found.setdefault(str(each.get("assumption")), []).append(each)
        return found

    @property
    def facts(self) -> list[Fact]:
        """What else is to be known beside the verdict; empty in older traces."""
        listed = self.metrics.get("facts")
        read = (Fact.from_json(each) for each in (listed if isinstance(listed, list) else ()))
        return [fact for fact in read if fact is not None]

    @property
    def claimed(self) -> bool:
        """Whether the guarantee is claimed: there is one, and each of its assumptions was met."""
        return bool(self.assumptions) and not self._unmet

    @property
    def contradiction(self) -> str | None:
        """How the run left a bound although its guarantee is claimed; None where it did not.

        It may not happen: a proof, a measurement, or this program is wrong.
        """
        if not self.claimed:
            return None
        if self.status == "diverged":
            return "it diverged"
        metrics = self.metrics
        gain, gamma, growth = (metrics.get(key) for key in ("gain", "gamma", "state_growth"))
        if _is_number(gain) and _is_number(gamma) and gain > gamma:
            return f"its gain is {gain:.5g}, above gamma = {gamma:.5g}"
        if _is_number(growth) and growth > GREATEST_GROWTH:
            return f"without a disturbance its state grew {growth:.3g} times"
        outages = metrics.get("outages")
        if isinstance(outages, dict) and (
            outages.get("value_within_bound") is False
            or outages.get("weighted_gain_within_gamma") is False
        ):
            return "it left the bounds across outages"
        return None

    @property
    def as_expected(self) -> bool:
        """Whether every assertion has its expected verdict."""
        return all(verdict.as_expected for verdict in self.assertions)

    @property
    def tone(self) -> str:
        """Return "good", "bad", or "open" where nothing failed but not all is well."""
        tone = _STATUSES.get(self.status, (OPEN, ""))[0]
        if not self.as_expected or self.contradiction is not None:
            return BAD
        return OPEN if tone == GOOD and self._unmet else tone

    @property
    def headline(self) -> str:
        """Say how the run ended, the same in every view: "finished, 1 of 2 assertions failed"."""
        word = _STATUSES.get(self.status, (OPEN, self.status.replace("_", " ")))[1]
        parts = [word, failed_in(self.assertions)]
        if self.status == "finished" and self._unmet:
            parts.append(f"{len(self._unmet)} of {len(self.assumptions)} assumptions not met")
        if self.contradiction is not None:
            parts.append("against its guarantee")
        return ", ".join(filter(None, parts))

    @property
    def explanation(self) -> str:
        """Return the reason; for a limit cycle, what that means; "" where there is none."""
        if self.contradiction is not None:
            words = CONTRADICTION.format(self.contradiction)
            return f"{self.reason}. {words}" if self.reason else words
        return self.reason or (_LIMIT_CYCLE if self.status == "limit_cycle" else "")

    @property
    def conclusion(self) -> list[tuple[str, str, str]]:
        """The last lines of the log, which say how the run ended: level, name, message."""
        level = {GOOD: "info", OPEN: "warning", BAD: "error"}[self.tone]
        if self.status == "stopped":
            level = "info" if self.as_expected else level
        lines = [(level, CONCLUSION, ": ".join(filter(None, (self.headline, self.explanation))))]
        if self._unmet:
            names = ", ".join(name.replace("_", " ") for name in self._unmet)
            lines.append(("warning", CONCLUSION, f"the guarantee is not claimed: not met: {names}"))
        return lines

    @property
    def _unmet(self) -> list[str]:
        return [name for name, met in self.assumptions.items() if met is False]

    def to_json(self) -> dict[str, Any]:
        """Return everything as JSON values."""
        return {**self._fields(), "headline": self.headline}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> RunOutcome:
        """Return the outcome that `to_json` made a JSON object of.

        What is absent or of another form, as in files of older versions and other tools, has its
        default.
        """
        return _ADAPTER.validate_python({"version": 1, **data}, context=FROM_FILE)

    def _fields(self) -> dict[str, Any]:
        found: dict[str, Any] = _ADAPTER.dump_python(self, mode="json", by_alias=True)
        return found

    def entries(self, **host: str) -> dict[str, str]:
        """Return the entries of `cosim.result`; `host` : those of this machine, by name."""
        found: dict[str, str] = {}
        for key, value in self._fields().items():
            if key in _STRUCTURES:
                found |= {key: _json(value)} if value or key in ("metrics", "final") else {}
            elif key != "links" and value is not None:
                found[key] = str(value)
        for name, figures in self.links.items():
            found |= result_of_link(name, figures)
        return found | {f"{HOST_PREFIX}{name}": value for name, value in host.items()}


_ADAPTER: Final = TypeAdapter(RunOutcome)


def outcome_of(result: Mapping[str, str] | None) -> RunOutcome | None:
    """Read the outcome in the entries of `cosim.result`; None without them."""
    if result is None:
        return None
    links: dict[str, dict[str, Any]] = {}
    for key, value in result.items():
        link, dot, figure = key.removeprefix(_LINK).rpartition(".")
        if key.startswith(_LINK) and dot:
            links.setdefault(link, {})[figure] = _number(value)
    data: dict[str, Any] = {key: result[key] for key in ("status", "reason") if key in result}
    data |= {key: _number(result.get(key, "")) for key in ("version", "steps", "simulated_s")}
    data |= {key: parsed_json(result.get(key)) for key in _STRUCTURES}
    return RunOutcome.from_json({**data, "links": links})


def other_entries(result: Mapping[str, str]) -> dict[str, str]:
    """Return the entries of `cosim.result` that are no part of an outcome, nor of the host."""
    known = RunOutcome.__dataclass_fields__
    return {
        key: value
        for key, value in result.items()
        if key not in known and not key.startswith((HOST_PREFIX, _LINK))
    }


def _is_number(value: Any) -> TypeIs[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _older(differences: Any) -> list[dict[str, Any]]:
    """Return what traces of an earlier version say of the parameters of a plant."""
    return [
        {
            "assumption": "plant_as_designed",
            "place": each.get("parameter"),
            "expected": repr(each.get("designed")),
            "got": "absent" if each.get("value") is None else repr(each["value"]),
        }
        for each in (differences if isinstance(differences, list) else ())
        if isinstance(each, dict)
    ]


def _number(text: str) -> int | float | str:
    """Return a finite number; the text itself if it is none."""
    for kind in (int, float):
        try:
            value = kind(text)
        except ValueError:
            continue
        return value if math.isfinite(value) else text
    return text


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True, allow_nan=False)
