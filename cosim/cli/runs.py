"""What the commands share that run something: where FMUs are, and what an interruption leaves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cosim import scenario
from cosim.core import StoppedError, TerminatedError
from cosim.fmu import DEFAULT_FLAVOUR


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
            got=f"{outcome.headline}: {outcome.reason}",
            hint=f"the trace is complete up to t = {outcome.simulated_s:g} s",
        ) from None


def make_fmu_cache(
    fmus: Path, folder: Path | None = None, flavour: str = DEFAULT_FLAVOUR
) -> scenario.FmuCache:
    """Return the cache in which a run finds its FMUs, or builds them."""
    return scenario.FmuCache(root=fmus, folder=folder or Path.cwd(), flavour=flavour)
