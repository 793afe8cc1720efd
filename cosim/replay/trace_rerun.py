"""Rerun: repeat a run from its trace alone and compare.

The trace contains the scenario, the gain with its proof, and the SHA-256 of every FMU. FMUs are
found by that hash; the recorded gain is used, not designed again. The runs are compared by
content hash and, if they differ, signal by signal.
"""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim.core import AnyPath, CosimError, InputError, Progress
from cosim.fmu import own_folder
from cosim.fmu.export import CATALOGUE, FMI_VERSION, ensure_fmu
from cosim.hinf import Result
from cosim.replay.trace_attachments import design_in, scenario_in, worst_case_in
from cosim.scenario import (
    FmuCache,
    Outcome,
    PreparedScenario,
    execute_run,
    parameters_of_plant,
    prepare,
    problem_about,
)
from cosim.trace import Trace, begins_with, content_hash, diff, same_content
from cosim.trace.comparison import differences
from cosim.trace.rows import DESIGN_ATTACHMENT


@dataclass(frozen=True)
class Rerun:
    """A trace, its rerun, and whether they are equal.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.replay import rerun
        >>> from cosim.scenario import FmuCache
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> repeat = rerun("lag.mcap", FmuCache(Path("fmus"), Path()))
        >>> repeat.identical, repeat.finished, repeat.differences, repeat.outcome.status
        (True, True, (), 'finished')

    Attributes
    ----------
    identical : both content hashes are equal; for a trace that is cut short: the new one begins
        with all its messages.
    finished : whether the original trace is complete.
    differences : sentences; empty when identical.
    """

    original: Path
    original_hash: str
    outcome: Outcome
    identical: bool
    finished: bool
    differences: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return everything, for `--json`."""
        return {
            "original": str(self.original),
            "original_hash": self.original_hash,
            "identical": self.identical,
            "finished": self.finished,
            "differences": list(self.differences),
            "rerun": self.outcome.to_json(),
        }


def rerun(
    path: AnyPath,
    fmu_cache: FmuCache | None = None,
    *,
    output: AnyPath | None = None,
    progress: Progress | None = None,
) -> Rerun:
    """Repeat the run of a trace and compare.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.replay import rerun
        >>> from cosim.scenario import FmuCache
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> rerun("lag.mcap", FmuCache(Path("fmus"), Path()), output="again.mcap").identical
        True

    Parameters
    ----------
    path : a trace with its scenario attached; one that is cut short is compared with the
        beginning of the new run.
    fmu_cache : where FMUs are found; by default the folder `fmus`, where missing ones are built.
    output : file of the new trace; None: keep none.

    Raises
    ------
    InputError : not a trace of ours, or an FMU that cannot be found.
    """
    path, output = Path(path), None if output is None else Path(output)
    fmu_cache = fmu_cache or FmuCache(Path("fmus"))
    trace = Trace(path)
    before = content_hash(path)
    prepared = _prepared(trace, path, fmu_cache, progress)
    with tempfile.TemporaryDirectory(prefix="rerun-", dir=own_folder()) as folder:
        target = output or Path(folder, "rerun.mcap")
        outcome = execute_run(prepared, target, progress=progress)
        whole = trace.finished
        made = Trace(target)
        if whole:
            identical = outcome.content_hash == before or same_content(made, trace)
        else:
            identical = begins_with(made, trace)
        lines = () if identical else tuple(differences(diff(path, target, prefix=not whole)))
        if output is None:
            outcome = replace(outcome, trace=None)
    return Rerun(path, before, outcome, identical, trace.finished, lines)


def _prepared(
    trace: Trace, path: Path, fmu_cache: FmuCache, progress: Progress | None
) -> PreparedScenario:
    loaded = scenario_in(trace, fmu_cache.folder)
    hashes = {
        part.fmu: trace.run.get(f"fmu.{component}.sha256", "")
        for component, part in loaded.scenario.components.items()
    }
    fmu_cache = replace(fmu_cache, wanted=hashes)
    _build_wanted_fmus(fmu_cache)
    saved = worst_case = None
    if loaded.scenario.design is not None:
        where = f"{path}: {DESIGN_ATTACHMENT}"
        found = Result.from_json(design_in(trace), where=where)
        plant = parameters_of_plant(loaded.scenario)
        saved = problem_about(loaded.scenario.design, found, where, None, plant), found
        worst_case = worst_case_in(trace, found.system.C.shape[1])
    prepared = prepare(loaded, fmu_cache, saved=saved, worst_case=worst_case, progress=progress)
    # those that the scenario describes, as computed signals, are made of its own text: whether a
    # newer version makes them alike, the rows say
    for component in loaded.scenario.components:
        fmu, wanted = prepared.fmus[component], trace.run.get(f"fmu.{component}.sha256")
        if fmu.sha256 != wanted:
            raise InputError(
                f"the FMU of {component!r} is not the one in the trace",
                where=str(fmu.path),
                expected=f"SHA-256 {wanted}",
                got=fmu.sha256,
                hint="rerun with the versions that cosim trace info names, or point `fmus` "
                "to the folder with the FMUs of that run",
            )
    return prepared


def _build_wanted_fmus(fmu_cache: FmuCache) -> None:
    """Build wanted FMUs of the catalogue that are missing below the cache's root.

    The flavour of the run is known by the hash alone: that of the cache is tried first. An FMU
    that is still missing afterwards is reported where it is used.
    """
    there = {_sha256(path) for path in fmu_cache.root.rglob("*.fmu") if path.is_file()}
    flavours = [fmu_cache.flavour, *(f for f in FMI_VERSION if f != fmu_cache.flavour)]
    for name, wanted in fmu_cache.wanted.items():
        if name not in CATALOGUE or not wanted:
            continue
        for flavour in flavours:
            if wanted in there:
                break
            try:
                built = ensure_fmu(name, fmu_cache.root, flavour=flavour).path
            except (CosimError, OSError):  # no compiler, or a full disk: try the next flavour
                continue
            there.add(_sha256(built))


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
