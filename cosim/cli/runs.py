"""What the commands share that run something: where FMUs are, and how a run is reported."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from cosim import scenario
from cosim.cli.common import answer
from cosim.cli.run_view import demo_line, demo_view, outcome_view
from cosim.cli.terminal import typed
from cosim.core import (
    CheckFailedError,
    ComponentError,
    ContradictionError,
    StoppedError,
    TerminatedError,
)
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.trace import outcome as outcomes


@contextmanager
def interruptions_reported() -> Iterator[None]:
    """Say, when a supervised run is interrupted, what it has left.

    Raises
    ------
    StoppedError, TerminatedError : after Ctrl-C, or SIGTERM.
    """
    try:
        yield
    except (scenario.InterruptedRun, scenario.TerminatedRun) as ended:
        kind = StoppedError if isinstance(ended, scenario.InterruptedRun) else TerminatedError
        outcome = ended.outcome
        raise kind(
            "interrupted" if kind is StoppedError else "terminated",
            where=None if outcome.trace is None else str(outcome.trace),
            got=": ".join(filter(None, (outcome.headline, outcome.reason))),
            hint=f"the trace is complete up to t = {outcome.simulated_s:g} s",
        ) from None


def make_fmu_cache(
    fmus: Path, folder: Path | None = None, flavour: str = DEFAULT_FLAVOUR
) -> scenario.FmuCache:
    """Return the cache in which a run finds its FMUs, or builds them."""
    return scenario.FmuCache(root=fmus, folder=folder or Path.cwd(), flavour=flavour)


def report_outcome(
    outcome: scenario.Outcome,
    as_json: bool,  # noqa: FBT001 - as `answer`
    *,
    details: bool = False,
) -> None:
    """Print the outcome of a run, and leave with its exit code."""
    ended = outcomes.answer_of(outcome.scenario, outcome)
    then = () if outcome.trace is None else (typed("trace report", outcome.trace),)
    answer(
        as_json,
        outcome.to_json,
        lambda: outcome_view(outcome, details=details),
        line=ended.what,
        tone=ended.tone,
        then=then,
    )
    exit_with(outcome)


def report_demo(demo: scenario.Demo, as_json: bool, *, details: bool) -> None:  # noqa: FBT001
    """Print both runs of the demo."""
    traces = [str(outcome.trace) for outcome in demo.outcomes.values()]
    answer(
        as_json,
        demo.to_json,
        lambda: demo_view(demo, details=details),
        line=demo_line(demo),
        then=(typed("trace report", traces[-1]), typed("trace diff", *traces)),
    )


def exit_with(outcome: scenario.Outcome) -> None:
    """Leave with the exit code of a run.

    4 if it failed, 6 if it contradicts its guarantee, 1 if an assertion was not as expected.
    """
    if outcome.status == "failed":
        raise typer.Exit(ComponentError.exit_code)
    if outcome.contradiction is not None:
        raise typer.Exit(ContradictionError.exit_code)
    if not outcome.as_expected:
        raise typer.Exit(CheckFailedError.exit_code)
