"""A study in one call: what the command line and a script start from."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path

from cosim.core import InputError, Progress
from cosim.scenario import LoadedScenario, load
from cosim.study.consistency import Place, nowhere
from cosim.study.execution import StudyResult, execute_study
from cosim.study.plan import Plan, make_plan
from cosim.study.read import load_study
from cosim.study.schema import Study
from cosim.study.study_runner import BaseScenario
from cosim.study.workers import WorkerPool, cluster, in_process, local

FMUS = Path("fmus")
STUDY_FLAVOUR = "native"
"""What flies where nobody says otherwise: a study is about many runs."""


def run_study(
    study: Study | str,
    out: Path,
    *,
    scenario: LoadedScenario | None = None,
    workers: int | str = 1,
    scheduler: str | None = None,
    fmus: Path = FMUS,
    flavour: str = STUDY_FLAVOUR,
    fresh: bool = False,
    progress: Progress | None = None,
) -> StudyResult:
    """Fly a study, or what is left of it, and write its table.

    Parameters
    ----------
    study : an object, a built-in name, or the path of a file.
    out : folder of the study.
    scenario : what is varied, in place of the one that the study names.
    workers : processes of this machine: 1 for this one, "all" for as many as there are cores.
    scheduler : address of a Dask scheduler, in place of `workers`.
    fmus, flavour : as for `cosim run`.
    fresh : throw away what the folder holds.
    progress : called with what is being done and the share that is done.

    Raises
    ------
    CosimError : a study that cannot be run; what is done stays, and the same call goes on.
    """
    place: Place = nowhere
    if isinstance(study, str):
        found = load_study(study)
        study, base, place = found.study, found.base, found.place
    else:
        base = scenario or load(study.scenario)
    plan = plan_of(study, scenario or base, place, fmus=fmus, flavour=flavour)
    return execute_study(plan, out, pool_for(workers, scheduler), fresh=fresh, progress=progress)


def plan_of(
    study: Study,
    base: LoadedScenario,
    place: Place = nowhere,
    *,
    fmus: Path = FMUS,
    flavour: str = STUDY_FLAVOUR,
) -> Plan:
    """A study and its scenario, checked.

    Raises
    ------
    InputError : see `make_plan`; or there is no compiler for native FMUs.
    """
    folder, root = base.folder.absolute(), fmus.absolute()
    of = BaseScenario(base.name, base.scenario, base.text, folder, root, flavour)
    try:
        return make_plan(study, of, place)
    except InputError as error:
        if "compiler" not in error.what:
            raise
        raise InputError(
            error.what,
            where=error.where,
            expected=error.expected,
            got=error.got,
            hint=f"{error.hint}; or take the python FMUs, which are slower: --flavour python",
        ) from error


def pool_for(
    workers: int | str, scheduler: str | None = None
) -> Callable[[], AbstractContextManager[WorkerPool]]:
    """Who flies: see `run_study`.

    Raises
    ------
    InputError : not a number of workers.
    """
    if scheduler is not None:
        return partial(cluster, scheduler)
    text = str(workers)
    if text == "all":
        number = _cores()
    elif text.isdecimal() and 1 <= int(text) <= 4096:
        number = int(text)
    else:
        raise InputError(
            "not a number of workers", where="--workers", expected="1, 2, ... or all", got=text
        )
    return in_process if number == 1 else partial(local, number)


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
