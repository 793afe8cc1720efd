"""The outcome of a run of a scenario: what its trace records, and how it was executed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cosim.master import EngineChoice, Pace
from cosim.scenario.pinned import DesignSource
from cosim.trace import RunOutcome


@dataclass(frozen=True, kw_only=True)
class Outcome(RunOutcome):
    """The outcome of one run of a scenario: that of the trace, and how it was executed.

        >>> from cosim import DelaySystem, Scenario, run
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> outcome = run(lag, "lag.mcap")
        >>> outcome.status, outcome.simulated_s, outcome.steps, outcome.trace.name
        ('finished', 1.0, 10, 'lag.mcap')
        >>> round(outcome.final["lag.x[1]"], 3)
        0.368

    Attributes
    ----------
    trace : the file, None if none was written.
    engine : the engine used, and why.
    pace : real-time figures; None for a run at full speed.
    log_after_end : log lines while the slaves were ended, after the trace was complete: `level`,
        `name` of the component, `message`.
    design : where the design comes from; None without one.
    binaries : name of a component, or "the kernel" if it ran -> "prebuilt", or the source of its
        binary.
    supervised : how the child process of the components was started, "fork" or "spawn"; None if
        they ran in this process.
    """

    scenario: str
    title: str
    trace: Path | None
    content_hash: str | None
    steps: int
    simulated_s: float
    wall_s: float
    engine: EngineChoice
    pace: Pace | None = None
    log_after_end: tuple[dict[str, str], ...] = ()
    design: DesignSource | None = None
    binaries: Mapping[str, str] = field(default_factory=dict)
    supervised: str | None = None

    @property
    def binaries_text(self) -> str:
        """The binaries that ran, by their source, in words."""
        origins = dict.fromkeys(self.binaries.values())
        return "; ".join(
            f"{', '.join(name for name, of in self.binaries.items() if of == origin)} {origin}"
            for origin in origins
        )

    def to_json(self) -> dict[str, Any]:
        """Return everything, for `--json`."""
        data: dict[str, Any] = {
            "scenario": self.scenario,
            "title": self.title,
            **super().to_json(),
            "supervised": self.supervised,
            "trace": None if self.trace is None else str(self.trace),
            "content_hash": self.content_hash,
            "wall_s": self.wall_s,
            "engine": {"name": self.engine.name, "reason": self.engine.reason},
            "binaries": dict(self.binaries),
        }
        if self.design is not None:
            data["design"] = dict(vars(self.design))
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
    """Return the entries of `cosim.result`, with what depends on this machine."""
    host = {
        "engine": f"{outcome.engine.name}: {outcome.engine.reason}",
        "wall_s": repr(round(outcome.wall_s, 3)),
        "binaries": outcome.binaries_text,
        "supervised": outcome.supervised or "no",
    }
    if outcome.pace is not None:
        host["pace"] = json.dumps(pace_figures(outcome.pace), sort_keys=True)
    return outcome.entries(**host)
