"""Executes the runs of a study by number.

The runner keeps what runs have in common: descriptions of FMUs, and designs. The result of a run
depends on the study and on the run's number alone.
"""

from __future__ import annotations

import json
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from cosim.core import CosimError, InputError, NotAchievableError, default_method
from cosim.fmu import FmuDescription
from cosim.hinf import Result
from cosim.master import BROKEN, OVERDUE, Calls, Run, Supervisor
from cosim.scenario import (
    ALL_FIGURES,
    MADE_BEFORE,
    FmuCache,
    LoadedScenario,
    Outcome,
    PreparedScenario,
    Problem,
    RunSeries,
    ScenarioPart,
    Supervision,
    Wanted,
    execute_recorded,
    execute_unrecorded,
    has_signal_parts,
    parameters_of_plant,
    parse_limits,
    prepare,
    problem_about,
    problems_of_loaded,
    supervision_of,
)
from cosim.study.consistency import Place, nowhere
from cosim.study.measurement import needs_zero_state_run
from cosim.study.points import Points
from cosim.study.rare_study import RarePoints
from cosim.study.schema import Study
from cosim.study.varied import Variations

_DESIGNS_KEPT = 256
_NAMED_S, _NAMED_SHARE = 1.0, 0.1
"""How long a run that hangs is repeated: at least so long [s], or this share of its limit."""


@dataclass(frozen=True)
class BaseScenario:
    """The scenario that is varied (as in `LoadedScenario`), and its FMUs (as in `FmuCache`)."""

    name: str
    scenario: ScenarioPart
    text: str
    folder: Path
    fmus: Path
    flavour: str


@dataclass(frozen=True)
class DescribedFmuCache(FmuCache):
    """An FMU cache that looks every FMU up only once."""

    known: dict[str, FmuDescription] = field(default_factory=dict, compare=False)

    def find(self, fmu: str) -> FmuDescription:
        """Return an FMU by catalogue name or path."""
        if fmu not in self.known:
            self.known[fmu] = super().find(fmu)
        return self.known[fmu]


class StudyRunner:
    """Executes the runs of one study.

    Parameters
    ----------
    hashes : SHA-256 by FMU reference, from the process that started the study.
    designs : result of `designs_made` of another runner of the same study.
    place : gives the place of a key of the study, for messages.

    Attributes
    ----------
    limits, run_limit_s : as in `cosim.study.batch.Job`.
    wanted : the figures that the metrics are made of.
    """

    def __init__(
        self,
        study: Study,
        base: BaseScenario,
        hashes: Mapping[str, str] | None = None,
        designs: Mapping[str, str] | None = None,
        *,
        place: Place = nowhere,
    ) -> None:
        self.study, self.base = study, base
        self.points: Points | RarePoints = (
            Points(study, place("vary", 0)) if study.rare is None else RarePoints(study)
        )
        self.variations = Variations(study, base.scenario, place)
        self._hashes = hashes or {}
        # by hash an FMU is found at once; by name the cache first checks that it is up to date
        self.fmu_cache = DescribedFmuCache(base.fmus, base.folder, self._hashes, base.flavour)
        self._zero_state_run = needs_zero_state_run(study.metrics)
        self.wanted = Wanted(m.path for m in study.metrics.values() if m.path is not None)
        self.limits: Sequence[str] = ()
        self.run_limit_s: float | None = None
        self._supervisor: Supervisor | None = None
        self._calls: Calls | None = None
        self._overdue = False
        self._series: RunSeries | None = None
        self._last: tuple[ScenarioPart, PreparedScenario] | None = None
        self._given = designs or {}
        # one design serves the study: it is for the plant of its scenario
        self._plant = parameters_of_plant(base.scenario)
        self._designs: OrderedDict[str, tuple[Problem, Result] | NotAchievableError] = OrderedDict()

    def execute_run(self, run: int, wanted: Wanted = ALL_FIGURES) -> tuple[Outcome, Run]:
        """Execute one run without a trace; its outcome has the figures that are wanted.

        Raises
        ------
        InputError, NotAchievableError, ComponentError : the run cannot be executed.
        """
        prepared = self._prepared(self._loaded(run, ""))
        supervisor = self._supervisor
        if supervisor is not None:
            supervision = self._supervision(prepared.loaded.scenario)
            supervisor = supervisor if supervision.supervised else None
        if supervisor is not None:
            supervisor.begin(supervision.limits, prepared.fmus.values())
        return execute_unrecorded(
            prepared,
            zero_state_run=self._zero_state_run,
            supervisor=supervisor,
            series=self._series,
            wanted=wanted,
        )

    @property
    def is_supervised(self) -> bool:
        """Whether a `supervised` context is open."""
        return self._series is not None

    @contextmanager
    def supervised(self) -> Iterator[None]:
        """Execute runs in a child process in this context, where runs can be supervised.

        A run that ends the child, or exceeds a limit, has failed; the next one has a new child.
        Elsewhere they are executed in this process, one after the other, as one series.
        """
        if self._series is not None:
            yield
            return
        with closing(RunSeries()) as series, ExitStack() as opened:
            self._series = series
            if default_method() is not None:
                self._supervisor = opened.enter_context(Supervisor())
            if default_method() in ("fork", "fresh"):
                self._calls = opened.enter_context(closing(Calls([self])))
            try:
                yield
            finally:
                self._series = self._supervisor = self._calls = None

    def in_child(
        self, function: Callable[[StudyRunner, int], Any], runs: Sequence[int], result: Any
    ) -> Iterator[Any]:
        """Call a function of this runner and each run in a child process that is kept for all runs.

        Yield what it returns, of the type `result`, in order; None where there is no such child, or
        the run ended it, or exceeded a limit.
        """
        supervision = self._supervision(self._first_scenario)
        limits = supervision.limits
        # only a supervised run knows how long a call takes
        of_calls = limits.call is not None and limits.call < (limits.run or math.inf)
        if self._calls is None or not supervision.supervised or of_calls:
            yield from (None for _ in runs)
            return
        for found in self._calls(limits, _unsupervised, function, self, each=runs, result=result):
            self._overdue = found is OVERDUE
            yield None if found in (BROKEN, OVERDUE) else found
        self._overdue = False

    @cached_property
    def _first_scenario(self) -> ScenarioPart:
        """The scenario of the first run; the unchanged one where that is not valid."""
        try:
            return self.variations.scenario(self.points[0])
        except InputError:
            return self.base.scenario

    def supervise_no_more(self) -> None:
        """Execute runs in this process from now on, one after the other, as one series."""
        self._supervisor = self._calls = None
        self._series = self._series or RunSeries()

    def record(self, run: int, trace: Path, *, keep: bool = False) -> tuple[Outcome, Outcome, Run]:
        """Execute one run with a trace, which contains its scenario and can be rerun.

        Return the outcome in the trace, the one that `execute_run` gives, and the run.

        keep : whether the run keeps its rows.
        """
        text = self.variations.scenario(self.points[run]).to_toml()
        prepared = self._prepared(self._loaded(run, text))
        return execute_recorded(
            prepared,
            trace,
            supervision=self._supervision(prepared.loaded.scenario),
            zero_state_run=self._zero_state_run,
            keep=keep,
        )

    def _supervision(self, scenario: ScenarioPart) -> Supervision:
        """Return how runs of a scenario are supervised, within which limits."""
        found = supervision_of(scenario, self.limits)
        given = scenario.limits is not None and "run" in scenario.limits.model_fields_set
        if not given and "run" not in parse_limits(self.limits):
            found = replace(found, limits=replace(found.limits, run=self.run_limit_s))
        limit = found.limits.run
        if limit is None or not self._overdue:
            return found
        # the run has exceeded its limit, and is repeated to name the component that does not return
        waited = max(0.0, limit - max(_NAMED_S, _NAMED_SHARE * limit))
        return replace(found, limits=replace(found.limits, waited=waited))

    def leave_children(self) -> None:
        """Leave its children to the process that this one was forked from."""
        self._supervisor = self._calls = self._series = None

    def designs_made(self) -> dict[str, str]:
        """Return the designs made so far, as JSON by their [design] keys, for other runners."""
        return {
            key: json.dumps(made[1].to_json(), allow_nan=False)
            for key, made in self._designs.items()
            if not isinstance(made, NotAchievableError)
        }

    def problem_and_design(self, run: int) -> tuple[Problem | None, Any]:
        """Return the design problem and the design of a run."""
        prepared = self._prepared(self._loaded(run, ""))
        return prepared.problem, prepared.design

    def _loaded(self, run: int, text: str) -> LoadedScenario:
        """Return the scenario of a run; its text is only needed in a trace."""
        scenario = self.variations.scenario(self.points[run])
        name = f"{self.base.name}, run {run} of a study"
        return LoadedScenario(name, scenario, text, self.base.folder)

    def problems(self, run: int) -> list[CosimError]:
        """Return every error of the scenario of a run; nothing is run, and no gain designed."""
        try:
            return problems_of_loaded(self._loaded(run, ""), self.fmu_cache)
        except CosimError as error:
            return [error]

    def _prepared(self, loaded: LoadedScenario) -> PreparedScenario:
        if self._last is not None and _differ_in_numbers(self._last[0], loaded.scenario):
            return self._last[1].again(loaded)
        prepared = self._prepared_anew(loaded)
        self._last = loaded.scenario, prepared
        return prepared

    def _prepared_anew(self, loaded: LoadedScenario) -> PreparedScenario:
        for component in loaded.scenario.components.values():
            self._check_hash(component.fmu)
        part = loaded.scenario.design
        if part is None:
            return prepare(loaded, self.fmu_cache)
        key = json.dumps(part.model_dump(), sort_keys=True)
        if key in self._given and key not in self._designs:
            where = "the study's design"
            found = Result.from_json(json.loads(self._given[key]), where=where)
            self._keep(
                key, (problem_about(part, found, where, self.base.folder, self._plant), found)
            )
        known = self._designs.get(key)
        if isinstance(known, NotAchievableError):
            raise known.with_traceback(None)
        if known is not None:
            self._designs.move_to_end(key)
            return prepare(loaded, self.fmu_cache, saved=known, plant=self._plant)
        try:
            prepared = prepare(loaded, self.fmu_cache, of_links=False, plant=self._plant)
        except NotAchievableError as error:
            self._keep(key, error)
            raise
        if prepared.problem is not None and prepared.design is not None:
            self._keep(key, (prepared.problem, prepared.design))
        # as for all later runs: what an outcome says does not depend on which one was first
        return replace(prepared, source=MADE_BEFORE)

    def _keep(self, key: str, made: Any) -> None:
        self._designs[key] = made
        while len(self._designs) > _DESIGNS_KEPT:
            self._designs.popitem(last=False)

    def _check_hash(self, fmu: str) -> None:
        wanted = self._hashes.get(fmu)
        found = self.fmu_cache.find(fmu)
        if wanted is not None and found.sha256 != wanted:
            raise InputError(
                "this FMU is not the one that the study was started with",
                where=str(found.path),
                expected=f"SHA-256 {wanted}",
                got=found.sha256,
                hint="give every worker the same folder of FMUs: `fmus`",
            )


def _differ_in_numbers(one: ScenarioPart, other: ScenarioPart) -> bool:
    """Whether FMUs and design of one scenario are those of the other.

    `Variations` gives parts that do not differ as the same objects.
    """
    fmus = [part.fmu for part in one.components.values()]
    return (
        not has_signal_parts(other)
        and one.design is other.design
        and one.reference is other.reference
        and one.disturbance is other.disturbance
        and one.components.keys() == other.components.keys()
        and fmus == [part.fmu for part in other.components.values()]
        # without [design] that of the controller's FMU counts, if its parameters are not changed
        and (one.design is not None or not any(fmu.endswith(".fmu") for fmu in fmus))
    )


def _unsupervised(
    function: Callable[[StudyRunner, int], Any], runner: StudyRunner, run: int
) -> Any:
    """Call a function in the child, which is what ends if a run crashes."""
    runner.supervise_no_more()
    return function(runner, run)
