"""Existing designs: named by `[design] file`, in the controller's FMU, or kept by an earlier run.

The last digits of a solver's answer differ from machine to machine, so a gain is designed once:
a design that a run had to make is kept beside the scenario, as `<stem>.design.json`, for the
next run. A controller FMU that carries its certificate is a design as well: `file` may name it, and
where a scenario has no [design] the FMU of its controller counts (`with_design_of_controller`).
The proof of an existing design is checked again, exactly, before it is used.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from cosim import hinf
from cosim.core import DESIGN_FILE, InputError, write_whole
from cosim.hinf import Result
from cosim.hinf.certificate import certificate_from_bytes, first_difference, read_certificate
from cosim.scenario.age_claim import age_in_words, feedback_of
from cosim.scenario.design_files import design_content
from cosim.scenario.feedback_age import FeedbackAge
from cosim.scenario.gain import (
    Problem,
    observes,
    problem_about,
    solve_sharply,
    with_known_age,
)
from cosim.scenario.plant import NO_PARAMETERS
from cosim.scenario.read import LoadedScenario
from cosim.scenario.schema import MADE_WITH, DesignPart

_MADE_FOR = "made_for"


@dataclass(frozen=True)
class DesignSource:
    """Where the design of a run comes from.

    Attributes
    ----------
    words : a sentence for people.
    file : its file, or its name among the designs of the package; None if only the trace has it.
    made : whether a solver made it for this run.
    """

    words: str
    file: str | None = None
    made: bool = False


def named_design(
    part: DesignPart, folder: Path, plant: Mapping[str, float] = NO_PARAMETERS
) -> tuple[Problem, Result, DesignSource]:
    """Read the design that `[design] file` names, check its proof, and find its problem.

    `folder` : start of relative paths; `plant` : as of `problem_about`.

    Raises
    ------
    InputError : no such design, its proof does not hold, or it is for another system.
    NotAchievableError : it is proved for exactly one measurement age.
    """
    name = str(part.file)
    where, content = design_content(name, folder)
    found = _proved(content, where, in_fmu=name.endswith(".fmu"))
    if part.outages and (observes(found) or found.guarantees.outages is None):
        raise InputError(
            "the proof of this design says nothing of outages",
            where=where,
            expected="guarantees.outages in its certificate",
            hint="cosim design --outages --save makes one; or leave out file, and one is made",
        )
    about = problem_about(part, found, where, folder, plant)
    return about, found, DesignSource(f"{name}, its proof checked again", name)


@lru_cache(maxsize=16)
def _proved(content: bytes, where: str, *, in_fmu: bool) -> Result:
    """Return the design in a file, its proof checked: once for the same bytes."""
    read = Result.from_certificate if in_fmu else Result.from_json
    return read(certificate_from_bytes(content, where), where=where)


def kept_or_made(
    loaded: LoadedScenario, problem: Problem, known: FeedbackAge | None = None
) -> tuple[Result, DesignSource]:
    """Return the design that an earlier run kept beside the scenario; else make and keep one.

    `known` : what the links justify of the age of the feedback; the gain is that for any age, its
    proof the better one of both.

    A kept design is used if it answers the same question: same system, same design constraints.
    A file that no run of this scenario wrote is never overwritten.

    Raises
    ------
    NotAchievableError : see `solve`.
    """
    part = loaded.scenario.design
    if part is None:
        raise ValueError("expected a scenario with [design]")
    linked = with_known_age(problem, known)
    made_for = {"scenario": f"{loaded.name}.toml", "question": _question(part, problem, linked)}
    path = None if loaded.file is None else loaded.file.with_suffix(".design.json")
    if path is None:
        return _made(problem, linked, part), _in_trace("the scenario is no file")
    try:
        found, why, ours = _kept(path, made_for, (linked, problem))
    except OSError as error:
        found, why, ours = None, f"{path}: {error.strerror}", False
    if found is not None:
        return found, DesignSource(f"{path}, {why}", str(path))
    made = _made(problem, linked, part)
    if ours and any(layer.path and layer.path[0] == "design" for layer in loaded.origin.layers):
        why, ours = "a setting changes [design]", False
    if not ours:
        return made, _in_trace(why)
    data = DESIGN_FILE.stamped({**made.to_json(), _MADE_FOR: made_for})
    text = json.dumps(data, indent=1, allow_nan=False)
    try:
        write_whole(path, f"{text}\n".encode())
    except OSError as error:
        return made, _in_trace(f"{path}: {error.strerror}")
    return made, DesignSource(f"made for this run ({why}), kept in {path}", str(path), made=True)


def _made(problem: Problem, linked: Problem, part: DesignPart) -> Result:
    """Design, and prove what [design] asks for beside gamma."""
    found = solve_sharply(problem, linked, part)
    return hinf.synthesis.with_outages(found) if part.outages else found


def _in_trace(why: str) -> DesignSource:
    return DesignSource(f"made for this run, kept in its trace alone: {why}", made=True)


def _question(part: DesignPart, problem: Problem, linked: Problem) -> Any:
    """Return what is asked of a gain beside its system, as JSON values."""
    asked = {key: getattr(part, key) for key in MADE_WITH} | {"k1": problem.k1, "k2": problem.k2}
    if part.outages:
        asked["outages"] = True
    age = feedback_of(linked.system)
    if linked is not problem and age is not None:  # only then: older files do not have it
        asked["feedback_age"] = age_in_words(age)
    for key, value in asdict(problem.design_constraints).items():
        if value is not None or key not in {"damping", "within"}:  # older files do not have these
            asked[key] = value
    return json.loads(json.dumps(asked))


def _kept(
    path: Path, made_for: Any, problems: Sequence[Problem]
) -> tuple[Result | None, str, bool]:
    """Return the design in a file if it fits; the reason; whether the file may be replaced."""
    if not path.exists():
        return None, "none was kept before", True
    try:
        data = read_certificate(path)
    except InputError:
        data = None
    mark = data.get(_MADE_FOR) if isinstance(data, dict) else None
    if not isinstance(mark, dict) or mark.get("scenario") != made_for["scenario"]:
        words = f"{path} is not one that a run of {made_for['scenario']} wrote, and stays as it is"
        return None, words, False
    if mark.get("question") != made_for["question"] or "measurements" in data:
        return None, "the one kept before answers another question", True
    try:
        found = Result.from_json(data, where=str(path))
    except InputError as error:
        return None, f"the one kept before is refused: {error.what}", True
    if observes(found):
        raise TypeError("a design that a run keeps has no measurements")
    differences = [first_difference(problem.system, found.system) for problem in problems]
    differs = None if None in differences else differences[-1]
    if differs is not None:
        return None, f"the one kept before is for another system: {differs}", True
    return found, "kept by an earlier run, its proof checked again", True
