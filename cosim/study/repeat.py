"""Repeat one run of a study alone, with a trace."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cosim.core import InputError
from cosim.scenario import Outcome
from cosim.study.folder import read_manifest, read_rows
from cosim.study.plan import Plan
from cosim.study.points import Points
from cosim.study.rare_study import RarePoints
from cosim.study.read import LoadedStudy
from cosim.study.stages import points_of_rows

_FOLLOWS = "later runs of a rare event follow from the results in its folder: `from` FOLDER"


def repeat_run(
    plan: Plan, run: int, trace: Path, *, limits: Sequence[str] = (), results: Path | None = None
) -> Outcome:
    """Execute one run of a study again, with a trace; its results are those of the study.

    Parameters
    ----------
    run : its number, counted from 0.
    limits : as for `cosim run --limit`.
    results : folder of the study; of a rare event, whose later points follow from earlier results.

    Raises
    ------
    InputError : there is no such run, or `results` is of another study.
    CosimError : the run cannot start, or the trace cannot be written.
    """
    if plan.job.study.rare is not None and run >= plan.count and results is not None:
        plan.runner.points = _points(plan, results)
    if not 0 <= run < plan.count:
        raise InputError(
            "the study has no such run",
            where=plan.job.study.title,
            expected=f"0 to {plan.count - 1}",
            got=str(run),
            hint=_FOLLOWS if plan.job.study.rare is not None and results is None else None,
        )
    plan.runner.limits = limits
    return plan.runner.record(run, trace)[0]


def check_unchanged(plan: Plan, loaded: LoadedStudy) -> None:
    """Check that a study loaded from the folder of its results still gives these results.

    Raises
    ------
    InputError : FMUs, scenario or design are others than then.
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
        hint="the same `fmus` and `flavour`; or the study's file, which runs it as it is now",
    )


def _points(plan: Plan, results: Path) -> Points | RarePoints:
    manifest = read_manifest(results)
    if manifest["digest"] != plan.job.digest:
        raise InputError(
            "this folder has the results of another study",
            where=str(results),
            expected=plan.job.study.title,
            got=repr(manifest["study"].get("title")),
        )
    with read_rows(results) as rows:
        return points_of_rows(plan.job.study, rows)
