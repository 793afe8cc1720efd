"""Check a study and make the job that workers execute."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.core import ComponentError, CosimError, InputError
from cosim.scenario import design_content, is_file, split
from cosim.study.batch import (
    TIMED_OUT,
    Job,
    Row,
    record_and_measure,
    run_and_measure,
    status_of,
    values_of,
)
from cosim.study.consistency import Place, changed_error, check_consistent, nowhere
from cosim.study.points import Points
from cosim.study.rare_study import ESTIMATOR
from cosim.study.schema import Axis, GridAxis, SampledAxis, Study
from cosim.study.study_runner import BaseScenario, StudyRunner
from cosim.study.units import units_of
from cosim.study.varied import check_parameter

TRIAL_S = 600.0
"""Wall-clock limit of the first run, if none is given [s]."""
BESIDE = ("title", "description", "traces", "stability", "stop")
"""Keys of a study that do not affect the results."""
RESULTS_SINCE = "0.1.0"
"""The version since which a run of a study has had the same results.

It is part of what results depend on, so that a folder is continued by every version that adds the
same rows to it. One that would add others puts its own version here.
"""


@dataclass(frozen=True)
class Plan:
    """A study that was checked and can be run.

    Attributes
    ----------
    job : the job for workers.
    runner : the runner of this process.
    content : what the results depend on, by parts.
    units : of the axes and metrics that have one, by name.
    """

    job: Job
    runner: StudyRunner
    content: dict[str, Any]
    units: dict[str, str]

    @property
    def hashes(self) -> dict[str, str]:
        """The hash of each part of the content."""
        return {name: part_hash(part) for name, part in self.content.items()}

    @property
    def count(self) -> int:
        """Number of runs."""
        return self.runner.points.count

    def part(self, text: str) -> range:
        """Return the runs "FIRST:END", without run END; either may be missing.

        Raises
        ------
        InputError : they are no runs of the study.
        """
        study = self.job.study
        if study.stop is not None or study.rare is not None:
            raise InputError(
                "the runs of this study follow from the results of earlier ones",
                where="`runs`",
                expected="a study without stop and rare",
                got="stop" if study.stop is not None else "rare",
            )
        first, colon, end = text.partition(":")
        numbers = [first.strip() or "0", end.strip() or str(self.count)]
        if colon and all(number.isdecimal() for number in numbers):
            found = range(int(numbers[0]), int(numbers[1]))
            if found and found[-1] < self.count:
                return found
        raise InputError(
            "not a part of the study's runs",
            where="`runs`",
            expected=f"FIRST:END within 0:{self.count}, without run END, as in 0:{self.count // 2}",
            got=text,
        )


def make_plan(study: Study, base: BaseScenario, place: Place = nowhere) -> Plan:
    """Check the paths of a study and find its FMUs.

    place : gives the place of a key, for messages.

    Raises
    ------
    InputError : a path, an FMU, or the name of a metric or an axis does not exist.
    """
    check_consistent(study, place)
    runner = StudyRunner(study, base, place=place)
    hashes = {fmu: runner.fmu_cache.find(fmu).sha256 for fmu in _fmus(study, base)}
    moved = {*study.set, *(place for axis in study.vary for place in axis.places)}
    fmus = {
        name: runner.fmu_cache.find(part.fmu)
        for name, part in base.scenario.components.items()
        if not moved & {f"components.{name}", f"components.{name}.fmu"}
    }
    for path in study.set:
        check_parameter(path, fmus, place("set", path))
    for i, axis in enumerate(study.vary):
        runner.variations.check_axis(axis, fmus, place("vary", i))
        for path in axis.places:
            _check_not_designed(path, base, place("vary", i))
    _check_values(runner, place)
    content = {
        "study": study.model_dump(mode="json", exclude=set(BESIDE)),
        "scenario": base.scenario.model_dump(mode="json", by_alias=True),
        "system": _system_file(base),
        "fmus": hashes,
        "software": RESULTS_SINCE,
    }
    if study.rare is not None:
        content["estimator"] = str(ESTIMATOR)
    part = base.scenario.design
    if part is not None and part.file is not None:
        content["design"] = hashlib.sha256(design_content(part.file, base.folder)[1]).hexdigest()
    digest = part_hash(content)
    digits = len(str(runner.points.most - 1))
    return Plan(Job(study, base, hashes, digest, digits), runner, content, units_of(study, fmus))


def trial_run(plan: Plan, runs: range, traces: Path | None = None) -> tuple[Row | None, float]:
    """Execute the first of the runs with all metrics, before any worker starts.

    Return its row, and the seconds that it took. `traces` : folder for its trace; None for none.
    If the first run fails, or takes longer than `TRIAL_S`, the last and a middle one are tried; the
    row is None if one of these succeeds.

    Raises
    ------
    CosimError : the error of the first run, such as a wrong metric, if all of them fail.
    """
    first: CosimError | None = None
    plan.runner.run_limit_s = TRIAL_S
    for run in _tried(runs):
        began = time.perf_counter()
        try:
            if traces is None:
                outcome, values = run_and_measure(plan.runner, run)
            else:
                trace = plan.job.trace_of(traces, run)
                outcome, values = record_and_measure(plan.runner, run, trace)
        except CosimError as error:
            first = first or error
            continue
        seconds = time.perf_counter() - began
        status, reason = status_of(outcome)
        if status == TIMED_OUT:
            first = first or ComponentError(
                f"the first runs of the study do not end: {reason}",
                where=f"run {run}",
                hint="a greater limit: `limit` run='1 h'; or look at it alone",
            )
        elif run != runs[0]:
            return None, seconds
        else:
            values = values_of(plan.runner.study, status, values)
            return Row(run, status, reason, seconds, values), seconds
    assert first is not None  # noqa: S101 - the loop ran
    raise first


def _tried(runs: range) -> Iterable[int]:
    """Return the runs of which one at least has to be possible."""
    return dict.fromkeys((runs[0], runs[-1], runs[len(runs) // 2]))


def check_runs(plan: Plan) -> None:
    """Ask of the runs that `trial_run` tries what can be asked without running them.

    Raises
    ------
    CosimError : the first error of the first of them, if all of them have errors.
    """
    first: CosimError | None = None
    for run in _tried(range(plan.count)):
        problems = plan.runner.problems(run)
        if not problems:
            return
        first = first or problems[0]
    if first is not None:
        raise first


def _check_not_designed(path: str, base: BaseScenario, where: str) -> None:
    """Refuse to change a gain that the design would overwrite."""
    part = base.scenario.design
    match split(path):
        case ("components", component, "parameters", str(name)):
            if part is not None and component == part.controller and name.startswith("K["):
                raise InputError(
                    f"{path} is set by the design of the scenario",
                    where=where,
                    expected="design.gain, or a scenario without [design]",
                    got=name,
                )


def _check_values(runner: StudyRunner, place: Place) -> None:
    """Check that one of three runs is a valid scenario; otherwise the study is at fault."""
    first: InputError | None = None
    for run in dict.fromkeys((0, runner.points.count - 1, runner.points.count // 2)):
        try:
            runner.variations.scenario(runner.points[run])
        except InputError as error:
            first = first or error
        else:
            return
    if first is not None:
        where = _cause(runner.study, str(first.where), place)
        raise changed_error(first, where=where, hint=None)


def _cause(study: Study, key: str, place: Place) -> str:
    """Return the place in the study that sets a faulty key of the scenario."""
    for path in study.set:
        if key.startswith(".".join(map(str, split(path)))):
            return f"{place('set', path)}: {key}"
    for i, axis in enumerate(study.vary):
        if any(key.startswith(".".join(map(str, split(path)))) for path in axis.places):
            return f"{place('vary', i)}: {key}"
    return f"{place('vary', 0)}: {key}"


def _fmus(study: Study, base: BaseScenario) -> list[str]:
    """Return every FMU that a run may need."""
    names = {part.fmu for part in base.scenario.components.values()}
    for path, value in study.set.items():
        names |= _named(path, [value])
    for axis in study.vary:
        for path in axis.places:
            names |= _named(path, _given(axis))
    return sorted(names)


def _named(path: str, values: list[Any]) -> set[str]:
    match split(path):
        case ("components", _, "fmu"):
            return {v for v in values if isinstance(v, str)}
    return set()


def _given(axis: Axis) -> list[Any]:
    if isinstance(axis, GridAxis):
        return [*(axis.values or []), *(v for row in axis.rows or [] for v in row)]
    return list(axis.choice or []) if isinstance(axis, SampledAxis) else []


def _system_file(base: BaseScenario) -> str | None:
    """Return the text of the system file that the design names, if it names one."""
    part = base.scenario.design
    if part is None or part.system is None or not is_file(part):
        return None
    path: Path = base.folder / part.system
    return path.read_text("utf-8") if path.is_file() else None


def extended_by(plan: Plan, before: Mapping[str, Any]) -> Callable[[int], int] | None:
    """Return what gives the numbers of the runs of a study with fewer samples in this one.

    None if `before`, its manifest, is of a study that differs otherwise, or whose points are not
    among the points of this one (a Latin hypercube).
    """
    study = plan.job.study
    try:
        fewer = Study.model_validate(before["study"])
    except ValueError:
        return None
    if (
        {**before.get("parts", {}), "study": None} != {**plan.hashes, "study": None}
        or fewer.samples >= study.samples
        or _without_samples(fewer) != _without_samples(study)
        or any(isinstance(axis, SampledAxis) and axis.kind == "latin" for axis in study.vary)
    ):
        return None
    if study.rare is not None:
        follows = study.rare.pilot is not None  # the sample; all the rest has other points
        return (lambda run: run) if follows else None
    points, more = Points(fewer), Points(study)
    return lambda run: points.extended(run, more)


def _without_samples(study: Study) -> Any:
    return study.model_dump(mode="json", exclude={*BESIDE, "samples"})


def part_hash(part: Any) -> str:
    """Return the hash of a part of what the results depend on."""
    return hashlib.sha256(json.dumps(part, sort_keys=True).encode()).hexdigest()
