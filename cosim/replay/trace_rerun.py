"""The first sense of replay: a run again, from its trace alone.

The trace carries the scenario, the gain with its proof, and the SHA-256 of every FMU. FMUs
are found by that hash; the gain is taken as it flew, not designed again. The new run is
compared with the old one by content hash, and where they part, signal by signal.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim.core import InputError, Progress
from cosim.hinf import design_from_json
from cosim.replay.trace_attachments import design_in, scenario_in, worst_case_in
from cosim.replay.wanted_fmus import build_wanted_fmus
from cosim.scenario import FmuCache, Outcome, PreparedScenario, execute_run, prepare, problem_about
from cosim.trace import DESIGN_ATTACHMENT, Trace, begins_with, content_hash, diff, differences


@dataclass(frozen=True)
class Rerun:
    """A trace, its run again, and whether they are the same.

    Attributes
    ----------
    identical : both content hashes are equal; of a run that did not finish: the new one begins
        with every message that there is.
    finished : whether the original did.
    differences : what differs, in words; empty when identical.
    """

    original: Path
    original_hash: str
    outcome: Outcome
    identical: bool
    finished: bool
    differences: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Everything, for `--json`."""
        return {
            "original": str(self.original),
            "original_hash": self.original_hash,
            "identical": self.identical,
            "finished": self.finished,
            "differences": list(self.differences),
            "rerun": self.outcome.to_json(),
        }


def rerun(
    path: Path, fmu_cache: FmuCache, *, output: Path | None = None, progress: Progress | None = None
) -> Rerun:
    """Run what a trace records again and compare.

    Parameters
    ----------
    path : a trace with its scenario attached, of a run that finished or not; of one that did
        not, what there is is compared with the beginning of the new run.
    fmu_cache : where FMUs are looked for.
    output : where the new trace goes; nowhere if None.

    Raises
    ------
    InputError : not a trace of ours, or an FMU that cannot be found.
    """
    trace = Trace(path)
    before = content_hash(path)
    prepared = _prepared(trace, path, fmu_cache, progress)
    with tempfile.TemporaryDirectory(prefix="cosim-rerun-") as folder:
        target = output or Path(folder, "rerun.mcap")
        outcome = execute_run(prepared, target, progress=progress)
        if trace.finished:
            identical = outcome.content_hash == before
        else:
            identical = begins_with(Trace(target), trace)
        lines: tuple[str, ...] = ()
        if not identical:
            lines = tuple(differences(diff(path, target, prefix=not trace.finished)))
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
    build_wanted_fmus(fmu_cache)
    saved = worst_case = None
    if loaded.scenario.design is not None:
        where = f"{path}: {DESIGN_ATTACHMENT}"
        found = design_from_json(design_in(trace), where=where)
        saved = (problem_about(loaded.scenario.design, found, where, None), found)
        worst_case = worst_case_in(trace, found.system.C.shape[1])
    prepared = prepare(loaded, fmu_cache, saved=saved, worst_case=worst_case, progress=progress)
    for component, fmu in prepared.fmus.items():
        wanted = trace.run.get(f"fmu.{component}.sha256")
        if fmu.sha256 != wanted:
            raise InputError(
                f"the FMU of {component!r} is another one than in the trace",
                where=str(fmu.path),
                expected=f"SHA-256 {wanted}",
                got=fmu.sha256,
                hint="rerun with the versions that cosim trace info names, or point --fmus "
                "to the folder with the FMUs of that run",
            )
    return prepared
