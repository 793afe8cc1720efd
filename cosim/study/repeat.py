"""Repeat one run of a study alone, with a trace."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cosim.core import InputError
from cosim.scenario import Outcome
from cosim.study.folder import read_manifest
from cosim.study.plan import Plan
from cosim.study.read import LoadedStudy


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


def check_unchanged(plan: Plan, loaded: LoadedStudy) -> None:
    """Check that a study loaded from the folder of its results still gives these results.

    Raises
    ------
    InputError : FMUs, scenario, design or software are others than then.
    """
    if loaded.digest is None or loaded.digest == plan.job.digest:
        return
    before = read_manifest(Path(loaded.where).parent).get("parts", {})
    changed = [name for name, value in plan.hashes.items() if before.get(name) != value]
    raise InputError(
        "the run would not be that of the study",
        where=loaded.where,
        expected=f"the same {', '.join(changed) or 'study'} as when the study was run",
        got=", ".join(f"{name} {plan.hashes[name][:12]}" for name in changed) or "another digest",
        hint="the same --fmus and --flavour; or the study's file, which runs it as it is now",
    )
