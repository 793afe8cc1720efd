"""Run a study with one call, for scripts and the command line."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path

from cosim.core import AnyPath, InputError, Progress
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.scenario import LoadedScenario, load
from cosim.study.consistency import Place, changed_error, nowhere
from cosim.study.execution import StudyResult, execute_study
from cosim.study.local_workers import local
from cosim.study.plan import Plan, make_plan
from cosim.study.read import load_study
from cosim.study.schema import Study
from cosim.study.study_runner import BaseScenario
from cosim.study.workers import WAIT_S, WorkerPool, cluster, in_process

FMUS = Path("fmus")


def run_study(
    study: Study | AnyPath,
    out: AnyPath,
    *,
    scenario: LoadedScenario | None = None,
    workers: int | str = 1,
    scheduler: str | None = None,
    fmus: AnyPath = FMUS,
    flavour: str = DEFAULT_FLAVOUR,
    fresh: bool = False,
    limits: Sequence[str] = (),
    time_limit_s: float | None = None,
    runs: str | None = None,
    wait_s: float | None = WAIT_S,
    progress: Progress | None = None,
) -> StudyResult:
    """Execute a study, or the rest of it, and write its table.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario, run_study
        >>> from cosim.study import Study
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> rate = "components.tank.parameters.A[1,1]"
        >>> study = Study(
        ...     title="two rates", scenario="tank", metrics={"level": "final.tank.x[1]"},
        ...     vary=[{"kind": "grid", "path": rate, "values": [-0.5, -1]}],
        ... )
        >>> done = run_study(study, Path("rates"), scenario=tank.loaded())
        >>> done.runs, done.statuses, done.results.name
        (2, {'finished': 2}, 'results.parquet')

    Parameters
    ----------
    study : a Study, the name of a built-in study, or the path of a file.
    out : folder of the study.
    scenario : the scenario to vary, instead of the one that the study names.
    workers : number of processes on this machine: 1 for this one, "all" for one per core.
    scheduler : address of a Dask scheduler, instead of `workers`.
    fmus, flavour : as for `cosim run`.
    fresh : delete the results in the folder.
    limits : of each run, as for `cosim run --limit`. Without one of "run" a run may take 50 times
        as long as the first one, and at least 60 s.
    time_limit_s : wall-clock time after which no further run begins [s].
    runs : execute these only, "FIRST:END": `merge_studies` joins the folders of parts.
    wait_s : how long to wait for workers when there are none [s]; None: for ever.
    progress : called with the current step and the share done.

    Raises
    ------
    CosimError : the study cannot be run; runs that are done are kept, and the same call continues.
    """
    place: Place = nowhere
    if not isinstance(study, Study):
        found = load_study(str(study))
        study, base, place = found.study, found.base, found.place
    else:
        base = scenario or load(study.scenario)
    plan = plan_of(study, scenario or base, place, fmus=fmus, flavour=flavour)
    return execute_study(
        plan,
        Path(out),
        pool_for(workers, scheduler, wait_s),
        fresh=fresh,
        limits=limits,
        time_limit_s=time_limit_s,
        runs=None if runs is None else plan.part(runs),
        progress=progress,
    )


def plan_of(
    study: Study,
    base: LoadedScenario,
    place: Place = nowhere,
    *,
    fmus: AnyPath = FMUS,
    flavour: str = DEFAULT_FLAVOUR,
) -> Plan:
    """Check a study and its scenario; return the plan of its runs.

    Raises
    ------
    InputError : see `make_plan`; or there is no compiler for native FMUs.
    """
    folder, root = base.folder.absolute(), Path(fmus).absolute()
    of = BaseScenario(base.name, base.scenario, base.text, folder, root, flavour)
    try:
        return make_plan(study, of, place)
    except InputError as error:
        if "compiler" not in error.what:
            raise
        hint = f"{error.hint}; or use the python FMUs, which are slower: `flavour` python"
        raise changed_error(error, hint=hint) from error


def pool_for(
    workers: int | str, scheduler: str | None = None, wait_s: float | None = WAIT_S
) -> Callable[[], AbstractContextManager[WorkerPool]]:
    """Return what opens the worker pool; for the parameters see `run_study`.

    Raises
    ------
    InputError : `workers` is not a number of workers.
    """
    if scheduler is not None:
        return partial(cluster, scheduler, wait_s)
    text = str(workers)
    if text == "all":
        number = _cores()
    elif text.isdecimal() and 1 <= int(text) <= 4096:
        number = int(text)
    else:
        raise InputError(
            "not a number of workers", where="`workers`", expected="1, 2, ... or all", got=text
        )
    return in_process if number == 1 else partial(local, number)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
