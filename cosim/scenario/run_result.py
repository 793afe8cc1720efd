"""What `run` returns: the outcome of a run, and its rows, read as those of a trace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

from cosim.core import AnyPath, InputError, Seconds
from cosim.scenario.outcome import Outcome
from cosim.trace import Diff, Recorded, Table, TopicInfo, Trace, diff


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class RunResult(Outcome, Recorded):
    """The outcome of a run with its rows, in memory or in the file of its trace.

        >>> from cosim import run
        >>> result = run("paper-example", settings=["run.end=1"])
        >>> result.status, result.metrics["gain"] < result.metrics["gamma"]
        ('finished', True)
        >>> result["plant.x"].values.shape  # of a group, a column for each signal
        (101, 2)
        >>> result.to_pandas("plant.x", align=0.1).shape
        (11, 2)

    Attributes
    ----------
    rows : the rows: kept in memory, or the `Trace` that was written; None with `keep=False`.
    """

    rows: Recorded | None = None

    @classmethod
    def of(cls, outcome: Outcome, rows: Recorded | None) -> Self:
        """Return an outcome with rows; without them those of its trace, if one was written."""
        if rows is None and outcome.trace is not None:
            rows = Trace(outcome.trace)
        known = {one.name: getattr(outcome, one.name) for one in fields(outcome)}
        return cls(**known, rows=rows)

    def __repr__(self) -> str:
        signals = "no rows" if self.rows is None else f"{len(self.rows.signals)} signals"
        return f"<RunResult {self.scenario}: {self.headline} at {self.simulated_s:g} s, {signals}>"

    @property
    def where(self) -> str:
        """The name of the scenario."""
        return self.scenario

    @property
    def topics(self) -> dict[str, TopicInfo]:  # type: ignore[override]
        """The description of every topic, by its name."""
        return self._kept().topics

    def read_all(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: Seconds | None = None,
        end: Seconds | None = None,
    ) -> dict[str, Table]:
        """Read several topics, as `Trace.read_all`."""
        return self._kept().read_all(topics, start=start, end=end)

    def diff(self, other: AnyPath | RunResult) -> Diff:
        """Compare the trace of this run with another one; see `cosim.trace.diff`.

        Raises
        ------
        InputError : one of the runs wrote no trace.
        """
        a, b = (_file(x) if isinstance(x, RunResult) else x for x in (self, other))
        return diff(a, b)

    def _kept(self) -> Recorded:
        if self.rows is None:
            raise InputError(
                "the rows of this run were not kept",
                where=self.scenario,
                expected="keep=True, or a trace",
                hint=f"cosim.run({self.scenario!r})",
            )
        return self.rows


def _file(result: RunResult) -> Path:
    if result.trace is None:
        raise InputError(
            "this run wrote no trace, and traces are compared",
            where=result.scenario,
            expected="a trace",
            hint=f'cosim.run({result.scenario!r}, "a.mcap")',
        )
    return result.trace
