"""The first sense of replay: a run again, from its trace alone.

The trace carries the scenario, the gain with its proof, and the SHA-256 of every FMU. FMUs
are found by that hash; the gain is taken as it flew, not designed again. The new run is
compared with the old one by content hash, and where they part, by topic.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.hinf import Design, design_from_json
from cosim.hinf.system_json import system_to_json
from cosim.scenario.execute import Prepared, Progress, fly, prepare
from cosim.scenario.gain import Problem, is_file, problem_of
from cosim.scenario.hangar import Hangar
from cosim.scenario.outcome import Outcome
from cosim.scenario.read import parse
from cosim.scenario.schema import DesignPart
from cosim.trace import DESIGN_ATTACHMENT, SCENARIO_ATTACHMENT, Table, Trace, content_hash


@dataclass(frozen=True)
class Rerun:
    """A trace, its run again, and whether they are the same.

    Attributes
    ----------
    identical : both content hashes are equal.
    differences : what differs, in words; empty when identical.
    """

    original: Path
    original_hash: str
    outcome: Outcome
    identical: bool
    differences: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Everything, for `--json`."""
        return {
            "original": str(self.original),
            "original_hash": self.original_hash,
            "identical": self.identical,
            "differences": list(self.differences),
            "rerun": self.outcome.to_json(),
        }


def rerun(
    path: Path, hangar: Hangar, *, output: Path | None = None, progress: Progress | None = None
) -> Rerun:
    """Run what a trace records again and compare.

    Parameters
    ----------
    path : a trace with its scenario attached; an unfinished one can be run again, but is
        never identical.
    hangar : where FMUs are looked for.
    output : where the new trace goes; nowhere if None.

    Raises
    ------
    InputError : not a trace of ours, or an FMU that cannot be found.
    """
    trace = Trace(path)
    before = content_hash(path)
    prepared = _prepared(trace, path, hangar, progress)
    with tempfile.TemporaryDirectory(prefix="cosim-rerun-") as folder:
        target = output or Path(folder, "rerun.mcap")
        outcome = fly(prepared, target, progress=progress)
        identical = outcome.content_hash == before
        differences = () if identical else tuple(_differences(trace, Trace(target)))
        if output is None:
            outcome = replace(outcome, trace=None)
    return Rerun(path, before, outcome, identical, differences)


def _prepared(trace: Trace, path: Path, hangar: Hangar, progress: Progress | None) -> Prepared:
    text = _attachment(trace, path, SCENARIO_ATTACHMENT, "scenario.sha256")
    name = trace.run.get("scenario", path.stem)
    loaded = parse(
        text.decode(), name=name, where=f"{path}: {SCENARIO_ATTACHMENT}", folder=hangar.folder
    )
    hashes = {
        part.fmu: trace.run.get(f"fmu.{component}.sha256", "")
        for component, part in loaded.scenario.components.items()
    }
    hangar = replace(hangar, wanted=hashes)
    saved = None
    if loaded.scenario.design is not None:
        data = json.loads(_attachment(trace, path, DESIGN_ATTACHMENT, "design.sha256"))
        found = design_from_json(data, where=f"{path}: {DESIGN_ATTACHMENT}")
        saved = (_problem(loaded.scenario.design, found, path), found)
    prepared = prepare(loaded, hangar, saved=saved, progress=progress)
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


def _problem(part: DesignPart, found: Design, path: Path) -> Problem:
    """What the design is about: from the scenario, or, for a system in a file, from its proof.

    Raises
    ------
    InputError : the design is about another system than the scenario names.
    """
    if is_file(part):
        return Problem(found.system, found.k1, found.k2, None)
    problem = problem_of(part, path.parent)
    if system_to_json(problem.system) != system_to_json(found.system):
        raise InputError(
            "the design in this trace is for another system",
            where=f"{path}: {DESIGN_ATTACHMENT}",
            expected=f"the system {part.system!r} as the scenario in the trace describes it",
            got=f"a design of {found.system.name!r} with other numbers",
        )
    return problem


def _attachment(trace: Trace, path: Path, name: str, digest: str) -> bytes:
    """An attachment, which must be the one whose hash the trace names under `digest`."""
    data = trace.attachments.get(name)
    if data is None:
        raise InputError(
            "this trace cannot be run again",
            where=str(path),
            expected=f"an attachment {name}, as cosim run writes it",
            got=", ".join(trace.attachments) or "no attachments",
        )
    recorded, found = trace.run.get(digest), hashlib.sha256(data).hexdigest()
    if recorded != found:
        raise InputError(
            f"{name} in this trace is not the one it was run with",
            where=str(path),
            expected=f"SHA-256 {recorded}",
            got=found,
        )
    return bytes(data)


def _differences(old: Trace, new: Trace) -> Iterator[str]:
    """What differs, topic by topic: the first message that does, and the largest difference."""
    if not old.finished:
        yield "the original did not finish: it has no result to compare"
    for topic in sorted(set(old.topics) | set(new.topics)):
        if topic in old.topics and topic in new.topics:
            yield from _differing_columns(old.read(topic), new.read(topic))
        else:
            yield f"{topic}: only in the {'new' if topic in new.topics else 'old'} trace"
    for name in ("run", "result"):
        ours, theirs = getattr(old, name) or {}, getattr(new, name) or {}
        for key in sorted(set(ours) | set(theirs)):
            if not key.startswith("host.") and ours.get(key) != theirs.get(key):
                yield f"cosim.{name} {key} differs"


def _differing_columns(a: Table, b: Table) -> Iterator[str]:
    if len(a) != len(b):
        yield f"{a.topic}: {len(a)} messages, now {len(b)}"
    n = min(len(a), len(b))
    if (a.log_time_ns[:n] != b.log_time_ns[:n]).any():
        yield f"{a.topic}: other times"
    for name, column in a.columns.items():
        other = b.columns.get(name)
        if other is None or column.dtype.kind not in "fiu":
            continue
        one, two = column[:n].astype(float), other[:n].astype(float)
        differs = np.flatnonzero(~((one == two) | (np.isnan(one) & np.isnan(two))))
        if differs.size:
            at = a.log_time_ns[differs[0]] / 1e9
            most = float(np.nanmax(np.abs(one - two)))
            yield f"{a.topic} {name}: from t = {at:g} s, at most {most:.3g}"
