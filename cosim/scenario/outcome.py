"""The outcome of a run, as JSON and as metadata of the trace."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosim.core import ComponentError
from cosim.master import Cause, EngineChoice, Pace
from cosim.scenario.pinned import DesignSource
from cosim.trace import AssertionResult


@dataclass(frozen=True)
class Outcome:
    """The outcome of one run of a scenario.

    Attributes
    ----------
    status : finished, limit_cycle, stopped, diverged or failed.
    reason : why, None when finished.
    trace : the file, None if none was written.
    engine : the engine used, and why.
    pace : real-time figures; None for a run at full speed.
    assertions : verdicts, in the order of the scenario.
    log_after_end : log lines while the slaves were ended, after the trace was complete: `level`,
        `name` of the component, `message`.
    design : where the design comes from; None without one.
    cause : why the run did not reach its end, or what failed after it; None otherwise.
    supervised : how the child process of the components was started, "fork" or "spawn"; None if
        they ran in this process.
    steps : communication steps done.
    metrics, links, final : JSON-safe figures; `metrics` and `links` as in the documentation,
        `final` the last value of every output by `component.variable`.
    """

    scenario: str
    title: str
    status: str
    reason: str | None
    trace: Path | None
    content_hash: str | None
    steps: int
    simulated_s: float
    wall_s: float
    final: dict[str, float | None]
    metrics: dict[str, Any]
    links: dict[str, dict[str, Any]]
    engine: EngineChoice
    pace: Pace | None = None
    assertions: tuple[AssertionResult, ...] = ()
    log_after_end: tuple[dict[str, str], ...] = ()
    design: DesignSource | None = None
    cause: Cause | None = None
    supervised: str | None = None

    @property
    def as_expected(self) -> bool:
        """Whether every assertion has its expected verdict."""
        return all(verdict.as_expected for verdict in self.assertions)

    def to_json(self) -> dict[str, Any]:
        """Return everything, for `--json`."""
        data: dict[str, Any] = {
            "scenario": self.scenario,
            "title": self.title,
            "status": self.status,
            "reason": self.reason,
            "cause": None if self.cause is None else self.cause.to_json(),
            "supervised": self.supervised,
            "trace": None if self.trace is None else str(self.trace),
            "content_hash": self.content_hash,
            "steps": self.steps,
            "simulated_s": self.simulated_s,
            "wall_s": self.wall_s,
            "final": self.final,
            "metrics": self.metrics,
            "links": self.links,
            "engine": {"name": self.engine.name, "reason": self.engine.reason},
        }
        if self.design is not None:
            data["design"] = asdict(self.design)
        if self.assertions:
            data["assertions"] = [verdict.to_json() for verdict in self.assertions]
        if self.log_after_end:
            data["log_after_end"] = list(self.log_after_end)
        if self.pace is not None:
            data["pace"] = pace_figures(self.pace)
        return data


def pace_figures(pace: Pace) -> dict[str, float | int]:
    """Return how well a run kept to real time, scaled by its factor."""
    return {
        "factor": pace.factor,
        "points": pace.points,
        "overruns": pace.late,
        "largest_overrun_s": pace.largest_s,
        "mean_lateness_s": pace.mean_s,
    }


def result_entries(outcome: Outcome) -> dict[str, str]:
    """Return the entries of `cosim.result`: strings, host-dependent ones under `host.`."""
    entries = {
        "status": outcome.status,
        "steps": str(outcome.steps),
        "simulated_s": repr(outcome.simulated_s),
        "metrics": json.dumps(outcome.metrics, sort_keys=True, allow_nan=False),
        "final": json.dumps(outcome.final, sort_keys=True, allow_nan=False),
        "host.engine": f"{outcome.engine.name}: {outcome.engine.reason}",
        "host.wall_s": repr(round(outcome.wall_s, 3)),
        "host.supervised": outcome.supervised or "no",
    }
    if outcome.cause is not None:
        entries["cause"] = json.dumps(outcome.cause.to_json(), sort_keys=True, allow_nan=False)
    if outcome.assertions:
        verdicts = [verdict.to_json() for verdict in outcome.assertions]
        entries["assertions"] = json.dumps(verdicts, sort_keys=True, allow_nan=False)
    if outcome.pace is not None:
        entries["host.pace"] = json.dumps(pace_figures(outcome.pace), sort_keys=True)
    if outcome.reason is not None:
        entries["reason"] = outcome.reason
    return entries


def refused_entries(error: ComponentError) -> dict[str, str]:
    """Return the entries of `cosim.result` of a run whose components did not start."""
    cause = Cause.of_error(error, None)
    return {
        "status": "failed",
        "steps": "0",
        "simulated_s": "0.0",
        "metrics": "{}",
        "final": "{}",
        "cause": json.dumps(cause.to_json(), sort_keys=True, allow_nan=False),
        "reason": error.text(),
    }
