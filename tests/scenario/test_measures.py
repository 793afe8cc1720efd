"""What an outcome says of a run does not depend on how it is cut into blocks, to the last bit."""

from __future__ import annotations

import operator
import random
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import whole_run
from cli.shell import SCENARIOS
from master.scalar import scalar_fmu
from random_runs import RandomRun, RandomRuns
from shared import fmu_store, sampled, slow_share_of

from cosim.master import EngineName, Pace, Run, System
from cosim.models import STATE, TABLE_1, thrust_map
from cosim.network import PacketLink
from cosim.scenario import (
    FmuCache,
    LoadedScenario,
    Outcome,
    PreparedScenario,
    builtin_names,
    execute_recorded,
    execute_unrecorded,
    load,
    prepare,
    supervision_of,
)

SYSTEMS = 200
VALID = sorted(map(str, (SCENARIOS / "valid").glob("*.toml")), key=lambda n: ("every-kind" in n, n))
AXES = {"u": "nu.u", "v": "nu.v", "w": "nu.w", "r": "nu.r", "psi": "eta.psi"}
COMMANDS = ("force.x", "force.y", "force.z", "moment.z")
VEHICLE = whole_run.Binding(
    tuple(STATE), COMMANDS, tuple(f"disturbance.{x}" for x in "uvwr"), thrust_map(TABLE_1)
)
PAPER = whole_run.Binding(("x[1]", "x[2]"), ("u[1]",), ("w[1]",))


@pytest.fixture(scope="module")
def random_runs(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> RandomRuns:
    folder = tmp_path_factory.mktemp("scalar")
    return RandomRuns(native_fmus, scalar_fmu(folder), scalar_fmu(folder, declared=False))


class Conditions:
    """Conditions about signals, links and time, with what each is at every point of a run."""

    def __init__(self) -> None:
        self._judges: dict[str, Callable[[Run], Any]] = {}

    def judged(self, text: str | None, run: Run) -> list[bool] | None:
        """Whether it holds, point by point."""
        return None if text is None else np.asarray(self._judges[text](run)).tolist()

    def some(self, r: random.Random, system: System) -> str:
        """Any one."""
        plant = system.components["plant"].description.ports
        name = next(f"plant.{n}" for n in ("eta.x", "x", "x[1]") if n in plant)
        end = float(system.comm_schedule.points_ns[-1]) / 1e9
        links = [n for n, link in system.links.items() if isinstance(link, PacketLink)]
        if links and r.random() < 0.4:
            what, bound = r.choice([("age", r.uniform(0, 0.5)), ("dropped", r.randint(0, 5))])
            sign, what, bound = r.choice(
                [("<", what, bound), (">", "delivered", r.randint(0, 9)), ("!=", "sequence", 3)]
            )
            return self._add("", f"{r.choice(links)}.{what}", sign, bound)
        if r.random() < 0.2:
            return self._add("", "t", ">", r.uniform(0, end))
        return self._add(r.choice(["", "not "]), name, "<", r.uniform(0, 5 if "eta" in name else 1))

    def _add(self, negated: str, name: str, sign: str, bound: float) -> str:
        compare = {"<": operator.lt, ">": operator.gt, "!=": operator.ne}[sign]

        def judge(run: Run) -> Any:
            there = compare(_values(run, name), bound)
            return ~there if negated else there

        text = f"{negated}{name} {sign} {bound!r}"
        self._judges[text] = judge
        return text

    def assertions(self, r: random.Random, system: System) -> dict[str, Any]:
        """Assertions of every form."""
        end = float(system.comm_schedule.points_ns[-1]) / 1e9
        found = []
        for _ in range(6):
            part: dict[str, Any] = {}
            if r.random() < 0.4:
                part["after"] = r.uniform(0, end)
            if r.random() < 0.4:
                part["before"] = r.uniform(part.get("after", 0.0), end)
            form = r.choice(["always", "eventually", "within", "since"])
            if form in ("always", "eventually"):
                part[form] = self.some(r, system)
            else:
                part["within"] = {"of": r.uniform(1e-9, 0.3 * end), "holds": self.some(r, system)}
                if form == "since":
                    part["within"]["when"] = self.some(r, system)
            found.append(part)
        return {"assertions": found}


def _values(run: Run, name: str) -> Any:
    first, _, rest = name.partition(".")
    if first in run.deliveries:
        state = run.deliveries[first].state(run.points_ns, broken_off=True)
        return np.asarray(getattr(state, "age_s" if rest == "age" else rest), float)
    return run.points_ns / 1e9 if name == "t" else run.signal(first, rest)


def check_rows(found: RandomRun, conditions: Conditions) -> None:
    """Compare what an outcome says of the rows with whole arrays."""
    system, run, outcome = found.system, found.run, found.outcome
    count = run.points_ns.size
    ends = {
        f"{one.name}.{c.name}": float(run.signal(one.name, c.name)[count - 1])
        for one in run.instances
        for c in one.output_columns
    }
    assert outcome.final == {n: x if np.isfinite(x) else None for n, x in ends.items()}
    metrics = outcome.metrics
    delays = whole_run.coupling_delays(run, system)
    if count > 1:
        assert metrics["coupling_delay_s"] == max(delays.values(), default=0.0)
        assert metrics.get("coupling_delays_s", delays) == delays
        late = {
            (str(c.source), str(c.target)): x for c, x in whole_run.cut_delays(run, system).items()
        }
        cut = metrics.get("cut_connections", ())
        assert {(one["from"], one["to"]): one["delay_s"] for one in cut} == late
    scenario = found.prepared.loaded.scenario
    for part, one in zip(scenario.assertions, outcome.assertions, strict=True):
        within = part.within
        holds = (part.always or part.eventually) if within is None else within.holds
        truths = conditions.judged(holds, run), conditions.judged(within and within.when, run)
        assert truths[0] is not None
        expected = whole_run.verdict_of(part, truths[0], truths[1], run, scenario.run.end)
        assert (one.result, one.at_s) == expected, part


def check_loop(found: RandomRun) -> None:
    """Compare what an outcome says of a loop that has a design."""
    system, run, metrics = found.system, found.run, found.outcome.metrics
    ages = whole_run.measured_ages(run, "plant", "controller", jacobi=system.algorithm == "jacobi")
    age = metrics["feedback_age"]["measured"]
    assert metrics["message_age_s"] == (None if ages is None else ages.greatest_ns / 1e9)
    assert (age is None) == (ages is None)
    if ages is not None:
        assert age == {
            "least_s": None if ages.least_ns is None else ages.least_ns / 1e9,
            "greatest_s": ages.greatest_ns / 1e9,
            "in_use_s": [x / 1e9 for x in ages.in_use_ns or ()],
        }
        assumed = metrics["assumptions"]
        assert assumed.get("measurements_equally_old", True) is ages.alike
        d = metrics["feedback_age"]["greatest_s"] * (1 + 1e-12)
        young = max(ages.greatest_ns, ages.first_ns) / 1e9 <= d and not ages.interrupted
        substituted = any(link["substitutions"] for link in run.statistics.values())
        assert assumed["message_age_within_design"] is (young and not substituted)
    controller = next(one for one in run.instances if one.name == "controller")
    given = controller.component.parameters
    bounds = (
        {n: given["limit.force" if "force" in n else "limit.moment"] for n in COMMANDS}
        if ("limit.force" in given)
        else {}
    )
    used = whole_run.saturation_of(run, "controller", bounds) if bounds else None
    if bounds:
        fraction, largest, cycling = used or (None, None, False)
        assert metrics["saturated_fraction"] == fraction
        assert metrics["largest_command"] == largest
        assert (found.outcome.status == "limit_cycle") is cycling
    prepared, problem = found.prepared, found.prepared.problem
    assert problem is not None
    if not _starts_at_rest(prepared):
        return  # its zero-state run is another run
    if problem.vehicle is not None and run.points_ns.size:
        greatest = {axis: float(np.abs(run.signal("plant", n)).max()) for axis, n in AXES.items()}
        bound = {axis: getattr(problem.vehicle.envelope, axis) for axis in AXES}
        assert metrics["envelope_use"] == {axis: greatest[axis] / bound[axis] for axis in AXES}
    if run.status != "failed" and run.points_ns.size:
        binding = PAPER if problem.vehicle is None else VEHICLE
        gain = whole_run.gain_of(run, "plant", binding, problem.system)
        assert metrics["gain"] == gain


def _starts_at_rest(prepared: PreparedScenario) -> bool:
    parameters = prepared.loaded.scenario.components["plant"].parameters
    paper = "DelayedPlant" in prepared.loaded.scenario.components["plant"].fmu
    starts = [x for name, x in parameters.items() if name.startswith("initial.")]
    return not any(starts) and bool(starts or not paper)


def some(members: Iterable[Any], number: int) -> list[Any]:
    """Every so many as they are; the others, or a share of them, as slow ones."""
    given = [*members]
    left = [one for i, one in enumerate(given) if i % number]
    return [*given[::number], *slow_share_of(left)]


@pytest.mark.parametrize("seed", some(range(SYSTEMS), 24))
def test_blocks_of_random_systems(random_runs: RandomRuns, seed: int, tmp_path: Path) -> None:
    """One block, blocks of a point, random blocks, and whole arrays: the same figures.

    Without `keep` a run has no rows that no route reads any more.
    """
    conditions = Conditions()
    found = random_runs.run(seed, conditions.assertions)
    if found is None:
        return
    if found.run.points_ns.size > 1:  # a run of one point has no schedules
        check_rows(found, conditions)
        if found.prepared.design is not None:
            check_loop(found)
    blocks_are_nothing(found.prepared, found.outcome, tmp_path)


def without_time(outcome: Outcome) -> dict[str, Any]:
    """The outcome, but for how long it took and what executed it."""
    found = replace(outcome, wall_s=0.0).to_json()
    return {key: value for key, value in found.items() if key not in ("engine", "binaries", "pace")}


@pytest.mark.parametrize(
    "name",
    [*slow_share_of(builtin_names()), *sampled(VALID, len(VALID) - 1)],
    ids=lambda name: Path(name).stem,
)
def test_blocks_of_scenarios(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Outcomes of runs that are measured in one block, and point by point, are the same."""
    monkeypatch.chdir(tmp_path)
    check_scenario(load(name), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_noise_of_several_measurements(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The energy of the noise of two measurements is the same sum, however a run is cut."""
    monkeypatch.chdir(tmp_path)
    seeds = [f"components.{name}.parameters.seed={seed}" for name in ("telemetry", "usbl")]
    check_scenario(load("auv-remote", [*seeds, "run.end=40.0"]), tmp_path)


def check_scenario(loaded: LoadedScenario, tmp_path: Path) -> None:
    """Compare the blocks of a scenario with one that has all rows."""
    prepared = prepare(loaded, FmuCache(fmu_store("native"), loaded.folder, flavour="native"))
    blocks_are_nothing(prepared, execute_unrecorded(prepared)[0], tmp_path)


class Instants:
    """A clock that goes by naps alone, each of which may last longer than it was meant to."""

    def __init__(self, *longer_s: float) -> None:
        self._now, self._longer_s = 0.0, longer_s
        self._random = random.Random(1)  # noqa: S311 - reproducible choices

    def pace(self) -> Pace:
        """A run goes on by as many points as are due: one, or those of the time overslept."""
        return Pace(clock=lambda: self._now, sleep=self._sleep)

    def _sleep(self, seconds: float) -> None:
        self._now += seconds + self._random.choice(self._longer_s)


def blocks_are_nothing(prepared: PreparedScenario, whole: Outcome, folder: Path) -> None:
    """Measure a run in blocks of a point, in random ones, at once, and without keeping rows."""
    alone = supervision_of(prepared.loaded.scenario, supervise=False)
    expected = repr(without_time(whole))
    assert repr(without_time(execute_unrecorded(prepared, keep=False)[0])) == expected
    ways: tuple[tuple[EngineName, Pace | None], ...] = (
        ("python", Instants(0.0).pace()),
        ("auto", Instants(0.0, 0.0, 0.1, 0.3, 2.0).pace()),
        ("auto", None),
    )
    for engine, pace in ways:  # a run that is recorded is measured as soon as its rows are there
        _, found, _ = execute_recorded(
            prepared, folder / f"{engine}.mcap", engine=engine, pace=pace, supervision=alone
        )
        assert repr(without_time(found)) == expected
