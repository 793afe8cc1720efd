"""Measures do not depend on how a run is cut into blocks, to the last bit, nor on what is gone."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import whole_run
from cli.shell import SCENARIOS
from fed import Release, blocks_of_one, fed, random_blocks
from master.scalar import ns, scalar_fmu
from random_runs import RandomRuns
from shared import fmu_store, sampled, slow_share_of

from cosim.core import Findings
from cosim.fmu import describe_fmu
from cosim.hinf import auv_system
from cosim.hinf.problem import AuvDesignSettings
from cosim.master import Component, Connection, Endpoint, Run, System, make_schedule, simulate
from cosim.network import PacketLink, TransportLink
from cosim.scenario import (
    BoundExpression,
    FmuCache,
    LoadedScenario,
    Outcome,
    Scenario,
    builtin_names,
    execute_unrecorded,
    load,
    measure as measures_module,
    prepare,
)
from cosim.scenario.age import measured_ages
from cosim.scenario.assertions import assertion_results, bind_assertions
from cosim.scenario.coupling import coupling_delays
from cosim.scenario.cut_delays import cut_delays
from cosim.scenario.envelope import largest_magnitudes
from cosim.scenario.events import AssertionPart
from cosim.scenario.execute import assembled_system
from cosim.scenario.final_values import last_outputs
from cosim.scenario.guarantee.delivery_law import delivery_law
from cosim.scenario.limits import Saturation, measured_saturation
from cosim.scenario.measure import Measure, Measures, measured
from cosim.scenario.performance import binding_for, measured_gain
from cosim.scenario.run_measures import RunMeasures

SYSTEMS = 200
VEHICLE = auv_system(AuvDesignSettings())
VALID = sorted(map(str, (SCENARIOS / "valid").glob("*.toml")), key=lambda n: ("every-kind" in n, n))


@pytest.fixture(scope="module")
def random_runs(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> RandomRuns:
    folder = tmp_path_factory.mktemp("scalar")
    return RandomRuns(native_fmus, scalar_fmu(folder), scalar_fmu(folder, declared=False))


def assertions(r: random.Random, system: System) -> list[AssertionPart]:
    """Some of every form, about signals, links and time."""
    name = (
        "plant.eta.x"
        if "AuvPlant" in str(system.components["plant"].description.path)
        else "plant.x"
    )
    end = float(system.comm_schedule.points_ns[-1]) / 1e9
    links = [n for n, link in system.links.items() if isinstance(link, PacketLink)]

    def condition() -> str:
        if links and r.random() < 0.4:
            link = r.choice(links)
            what = r.choice([f"age < {r.uniform(0, 0.5)}", f"dropped < {r.randint(0, 5)}"])
            return f"{link}.{r.choice([what, f'delivered > {r.randint(0, 9)}', 'sequence != 3'])}"
        if r.random() < 0.2:
            return f"t > {r.uniform(0, end)}"
        return f"{r.choice(['', 'not '])}{name} < {r.uniform(0, 5 if 'eta' in name else 1)}"

    found = []
    for _ in range(6):
        window: dict[str, Any] = {}
        if r.random() < 0.4:
            window["after"] = r.uniform(0, end)
        if r.random() < 0.4:
            window["before"] = r.uniform(window.get("after", 0.0), end)
        form = r.choice(["always", "eventually", "within", "since"])
        if form in ("always", "eventually"):
            window[form] = condition()
        else:
            window["within"] = {"of": r.uniform(0, 0.3 * end), "holds": condition()}
            if form == "since":
                window["within"]["when"] = condition()
        found.append(AssertionPart(**window))
    return found


def scenario_of(parts: list[AssertionPart], system: System) -> Scenario:
    """What assertions need of a scenario."""
    end = float(system.comm_schedule.points_ns[-1]) / 1e9
    return cast(
        "Scenario",
        SimpleNamespace(assertions=parts, events=[], modes={}, run=SimpleNamespace(end=end)),
    )


def measures_of(system: System, parts: list[AssertionPart]) -> dict[str, Measure[Any]]:
    """Every measure that makes sense of a system."""
    plant = system.components["plant"].description.ports
    found: dict[str, Measure[Any]] = {
        "age": measured_ages("plant", "controller", system.algorithm),
        "coupling": coupling_delays(system),
        "cut": cut_delays(system),
        "largest": largest_magnitudes(
            "plant", [n for n, p in plant.items() if p.causality == "output"]
        ),
        "last outputs": last_outputs(),
        "saturation": measured_saturation("controller"),
        "gain": measured_gain("plant", VEHICLE),
        "assertions": assertion_results(scenario_of(parts, system), system, Findings()),
    }
    return found


def truths(system: System, run: Run) -> dict[str, Any]:
    """The same from whole arrays."""
    by_name = {s.name: s for s in run.instances}
    plant, controller = by_name["plant"], by_name["controller"]
    outputs = [c.name for c in plant.output_columns]
    count = run.points_ns.size
    bounds = {
        c.name: controller.component.parameters[
            "limit.moment" if c.name.startswith("moment") else "limit.force"
        ]
        for c in controller.output_columns
        if "limit.force" in controller.component.parameters
    }
    used = whole_run.saturation_of(run, "controller", bounds) if bounds else None
    binding = binding_for(plant, VEHICLE)
    return {
        "age": whole_run.measured_ages(
            run, "plant", "controller", jacobi=system.algorithm == "jacobi"
        ),
        "coupling": whole_run.coupling_delays(run, system),
        "cut": whole_run.cut_delays(run, system),
        "largest": {n: float(np.abs(run.signal("plant", n)).max()) for n in outputs},
        "last outputs": {
            s.name: {c.name: float(run.signal(s.name, c.name)[count - 1]) for c in s.output_columns}
            for s in run.instances
        },
        "saturation": None if used is None else Saturation(*used),
        "gain": None if binding is None else whole_run.gain_of(run, "plant", binding, VEHICLE),
    }


def verdicts(system: System, run: Run, parts: list[AssertionPart]) -> list[Any]:
    """The verdicts from whole arrays, their conditions evaluated at all points at once."""
    scenario = scenario_of(parts, system)
    _, bound = bind_assertions(scenario, system, Findings())

    def values(name: str) -> Any:
        first, _, rest = name.partition(".")
        if first in run.deliveries:
            state = run.deliveries[first].state(run.points_ns, broken_off=True)
            return np.asarray(getattr(state, "age_s" if rest == "age" else rest), float)
        return run.points_ns / 1e9 if name == "t" else run.signal(first, rest)

    def judged(condition: BoundExpression | None) -> Any:
        return condition and np.asarray(condition([values(n) for n in condition.names])).tolist()

    return [
        whole_run.verdict_of(part, judged(condition), judged(since), run, scenario.run.end)
        for part, condition, since in bound
    ]


def some(members: Iterable[Any], number: int) -> list[Any]:
    """Every so many as they are; the others, or a share of them, as slow ones."""
    given = [*members]
    left = [one for i, one in enumerate(given) if i % number]
    return [*given[::number], *slow_share_of(left)]


@pytest.mark.parametrize("seed", some(range(SYSTEMS), 24))
def test_blocks_of_random_systems(random_runs: RandomRuns, seed: int) -> None:
    """One block, blocks of one point, random blocks, and whole arrays: the same figures.

    A block sees neither rows that are yet to come nor rows that no route reads any more.
    """
    made = random_runs.run(seed)
    if made is None or not made[1].points_ns.size:
        return
    system, run = made
    parts = assertions(random.Random(seed), system)  # noqa: S311 - reproducible choices
    count = run.points_ns.size
    whole = {name: measured(run, one) for name, one in measures_of(system, parts).items()}
    for cuts in (blocks_of_one(count), random_blocks(count, seed)):
        measures = measures_of(system, parts)
        found = fed(run, list(measures.values()), cuts)
        assert repr(dict(zip(measures, found, strict=True))) == repr(whole)
    names = ("last outputs", "largest", "saturation", "gain", "cut")
    bare = [measures_of(system, parts)[name] for name in names]
    found = fed(run, bare, blocks_of_one(count), alone=True)
    assert repr(found) == repr([whole[name] for name in names])
    whole["gain"] = whole["gain"].gain
    expected = truths(system, run)
    assert repr({name: whole[name] for name in expected}) == repr(expected)
    if count > 1:  # a run of one point has no schedules
        found = [(verdict.result, verdict.at_s) for verdict in whole["assertions"]]
        assert found == verdicts(system, run, parts)


def without_time(outcome: Outcome) -> dict[str, Any]:
    """The outcome, but for how long it took."""
    return replace(outcome, wall_s=0.0).to_json()


@pytest.mark.parametrize(
    "name",
    [*slow_share_of(builtin_names()), *sampled(VALID, len(VALID) - 1)],
    ids=lambda name: Path(name).stem,
)
def test_blocks_of_scenarios(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Outcomes of runs that are measured in one block, and point by point, are the same.

    Once more the run itself, in random blocks without what is yet to come and what is gone.
    """
    blocks_are_nothing(load(name), tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_noise_of_several_measurements(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The energy of the noise of two measurements is the same sum, however a run is cut."""
    seeds = [f"components.{name}.parameters.seed={seed}" for name in ("telemetry", "usbl")]
    blocks_are_nothing(load("auv-remote", [*seeds, "run.end=40.0"]), tmp_path, monkeypatch)


def blocks_are_nothing(
    loaded: LoadedScenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Measure runs of a scenario in one block, point by point, and in random blocks."""
    monkeypatch.chdir(tmp_path)
    prepared = prepare(loaded, FmuCache(fmu_store("native"), loaded.folder, flavour="native"))
    whole, run = execute_unrecorded(prepared)
    monkeypatch.setattr(measures_module, "ROWS_AT_ONCE", 1)
    outcome, _ = execute_unrecorded(prepared, keep=False)
    assert repr(without_time(outcome)) == repr(without_time(whole))
    system, _ = assembled_system(prepared)
    found = []
    count = run.points_ns.size
    for cuts in ([0, count], random_blocks(count, seed=1, longest=500)):
        measures = RunMeasures(prepared, system)
        measures.begin(run.instances)
        with Release(run).readable() as release:
            for first, last in itertools.pairwise(cuts):
                release.advance(first, last)
                monkeypatch.setattr(measures_module, "ROWS_AT_ONCE", last - first)
                measures.rows_complete(first, last)
            found.append(repr(measures.figures(run)))
    assert found[0] == found[1]


def test_an_altered_value_is_found_wherever_blocks_end(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Between a value and the next one by a weight of 0: also at the last point of a block."""
    fmu = describe_fmu(scalar_fmu(tmp_path_factory.mktemp("altered")))
    link = TransportLink("wire", 0)
    connections = [Connection(Endpoint("a", "x"), Endpoint("b", "u"), "wire")]
    components = {name: Component(fmu, {"a": -1.0, "x0": 1.0}) for name in "ab"}
    schedule = make_schedule({"wire": link}, ns(0.1), ns(1.0), "grid", [])
    run = simulate(System(components, connections, {"wire": link}, {}, schedule), engine="python")
    route = run.instances[1].routes[0]
    for k in range(run.count - 1):
        before = run.instances[1].rows[k, route.targets].copy()
        run.instances[1].rows[k, route.targets] += 1.0
        whole = measured(run, delivery_law(connections))
        assert [departure.at_s for departure in whole] == [run.points_ns[k] / 1e9]
        for cuts in (blocks_of_one(run.count), random_blocks(run.count, k, 4)):
            assert fed(run, [delivery_law(connections)], cuts) == [whole]
        run.instances[1].rows[k, route.targets] = before


def test_own_points_before_a_block_remain_readable() -> None:
    """What a component reads at its own points is asked for until its next one: `unread` waits."""

    class Own:
        def __init__(self, every: int) -> None:
            self.last = np.arange(100) // every * every

    instances = [SimpleNamespace(name=str(n), own_points=Own(n), comm_points=None) for n in (1, 7)]
    measures = Measures([], at_once=True)
    measures.begin(cast("Any", instances))
    assert measures.unread == 0
    measures.rows_complete(0, 20)
    assert measures.unread == 14
    measures.rows_complete(20, 22)
    assert measures.unread == 21


def test_the_division_of_time_outlives_the_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is proved across outages is computed at the end, of points that were given back."""
    blocks_are_nothing(load("survey-outages", ["run.end=24.0"]), tmp_path, monkeypatch)
