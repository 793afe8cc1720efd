"""Repeat one run of a study alone, with a trace."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cosim.core import InputError
from cosim.scenario import Outcome
from cosim.study.plan import Plan


def repeat_run(plan: Plan, run: int, trace: Path, *, limits: Sequence[str] = ()) -> Outcome:
    """Execute one run of a study again, with a trace; its results are those of the study.

    Parameters
    ----------
    run : its number, counted from 0.
    limits : as for `cosim run --limit`.

    Raises
    ------
    InputError : there is no such run.
    CosimError : the run cannot start, or the trace cannot be written.
    """
    if not 0 <= run < plan.count:
        raise InputError(
            "the study has no such run",
            where=plan.job.study.title,
            expected=f"0 to {plan.count - 1}",
            got=str(run),
        )
    plan.runner.limits = limits
    return plan.runner.record(run, trace)[0]
