"""Many runs of a scenario on a grid, from Python: a study whose table comes back as one frame."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cosim.core import AnyPath, InputError, Layer, Origin, Progress, optional, valid
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.scenario import Scenario, load
from cosim.study.running import FMUS, run_study
from cosim.study.schema import Study
from cosim.study.table import read_table

METRICS = {"headline": "headline", "gain": "metrics.gain", "gamma": "metrics.gamma"}
"""Figures that are kept unless others are named."""


def sweep(
    scenario: AnyPath | Scenario,
    grid: Mapping[str, Any],
    metrics: Mapping[str, Any] | None = None,
    *,
    workers: int | str = 1,
    out: AnyPath | None = None,
    fmus: AnyPath = FMUS,
    flavour: str = DEFAULT_FLAVOUR,
    limits: Iterable[str] = (),
    progress: Progress | None = None,
) -> Any:
    """Run a scenario at every point of a grid; return one row per run as a pandas DataFrame.

        >>> from cosim import DelaySystem, Scenario, sweep
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> runs = sweep(
        ...     tank, {"components.tank.parameters.A[1,1]": [-0.5, -1.0]},
        ...     metrics={"level": {"signal": "tank.x[1]", "reduce": "final"}},
        ... )
        >>> runs["status"].tolist(), runs["level"].round(2).tolist()
        (['finished', 'finished'], [0.37, 0.14])

    Parameters
    ----------
    scenario : a built-in name, a file, or one that was made in Python.
    grid : values by the dotted path of a key, as of `--set`; every combination is run.
    metrics : figures by the name of their column, as in [metrics] of a study: a path into the
        output of `cosim run --json`, or a signal that is reduced. By default headline, gain and
        gamma.
    workers : number of processes on this machine; "all": one per core.
    out : folder of the study, from which the same call continues; None: a temporary one.
    fmus, flavour, limits, progress : as of `run_study`.

    Returns
    -------
    frame : the columns of the grid, `status`, and the metrics; in order of the grid, the last key
        varying fastest.

    Raises
    ------
    InputError : an empty grid, a path or metric that does not exist, or pandas is not installed.
    CosimError : as `run_study`.
    """
    if workers != 1 and isinstance(scenario, Scenario):
        scenario.check_forks("worker processes", "workers", "workers=1")
    optional("pandas", extra="tables", what="the frame of a sweep needs pandas")
    loaded = scenario.loaded(flavour) if isinstance(scenario, Scenario) else load(str(scenario))
    names = {re.sub(r"\W+", "_", path).strip("_"): path for path in grid}
    if not grid or len(names) != len(grid):
        got = "no key" if not grid else "two keys with one name of a column"
        raise InputError("not a grid", where="grid", expected="keys that differ", got=got)
    vary = [
        {"name": name, "kind": "grid", "values": [*grid[path]], "path": path}
        for name, path in names.items()
    ]
    data = {
        "title": f"a sweep of {loaded.name}",
        "scenario": loaded.name,
        "vary": vary,
        "metrics": dict(metrics or METRICS),
    }
    study = valid(Study, data, Origin((Layer("sweep", ""),)))
    with tempfile.TemporaryDirectory(prefix="sweep-") as folder:
        place = Path(folder, "study") if out is None else Path(out)
        run_study(
            *(study, place),
            scenario=loaded,
            workers=workers,
            fmus=Path(fmus),
            flavour=flavour,
            limits=[*limits],
            progress=progress,
        )
        frame = read_table(place)[0].to_pandas()
    return frame[[*names, "status", *study.metrics]].rename(columns=names)
