"""Runs made one after the other with the same slaves are those made alone, bit for bit."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign.c_fmu import c_fmu, every
from shared import sampled

from cosim.core import InputError
from cosim.master import Run, Session, System, make_schedule, receiving_order
from cosim.scenario import Outcome, assembled_system, load
from cosim.study import Plan, Study, plan_of


def drawn(path: str, least: float, most: float) -> dict[str, Any]:
    """An axis of random values."""
    return {"kind": "random", "path": path, "uniform": [least, most]}


SEEDS = {"kind": "replicates", "paths": ["run.seed", "components.sea.parameters.seed"], "count": 2}
LOSS = drawn("links.uplink.loss", 0.0, 0.6)
START = drawn("components.plant.parameters.initial.eta.x", -2.0, 2.0)
GUST = {"at": 0.2, "duration": 0.3, "override": {"plant.x[1]": 5.0}}
STUDIES: dict[str, tuple[str, float, list[dict[str, Any]]]] = {
    "packets": (
        "auv-acoustic",
        4.0,
        [
            LOSS,
            drawn("links.uplink.delay", 0.1, 0.4),
            drawn("links.downlink.jitter.width", 0.01, 0.2),
            drawn("components.sea.parameters.Hs", 0.0, 3.0),
            drawn("components.plant.parameters.force.x", -9.0, 9.0),
            {"kind": "grid", "path": "links.uplink.sample_time", "values": [1.0, 0.7]},
            START,
            SEEDS,
        ],
    ),
    "a live link": ("acoustic-range", 4.0, [LOSS, START]),
    "events, assertions": ("link-outage", 50.0, [drawn("links.uplink.delay", 0.1, 0.4)]),
    "a reference": (
        "heading-step",
        4.0,
        [START, {"kind": "grid", "path": "reference.points[0][1]", "values": [0.1, -0.1]}],
    ),
    "an override": (
        "paper-example",
        1.0,
        [
            drawn("components.plant.parameters.initial.x[1]", -1.0, 1.0),
            {"kind": "grid", "path": "events", "values": [[], [GUST], []]},
        ],
    ),
    "a step later": (
        "paper-example",
        1.0,
        [
            drawn("components.plant.parameters.initial.x[1]", -1.0, 1.0),
            {"kind": "grid", "path": "connections[0].policy", "values": ["previous", "hold"]},
        ],
    ),
    "a disturbance": ("auv-worst-case", 20.0, [drawn("links.uplink.delay", 0.1, 0.6)]),
    "steps, algorithms": (
        "paper-example",
        1.0,
        [
            drawn("components.plant.parameters.initial.x[1]", -1.0, 1.0),
            {"kind": "grid", "path": "run.step", "values": [0.01, 0.02]},
            {"kind": "grid", "path": "run.algorithm", "values": ["jacobi", "gauss-seidel"]},
        ],
    ),
    "what a loss does": (
        "burst-loss",
        4.0,
        [
            {"kind": "grid", "path": "links.uplink.on_loss", "values": ["hold", "zero"]},
            {"kind": "grid", "path": "links.uplink.quantization", "values": [0.0, 0.01]},
            SEEDS,
        ],
    ),
}


def study_of(name: str) -> Plan:
    """A short study of a built-in scenario with 3 samples of its axes."""
    scenario, end, axes = STUDIES[name]
    figures = ("metrics.gain", "metrics.message_age_s", "metrics.coupling_delay_s")
    study = Study(
        title="as alone",
        scenario=scenario,
        set={"run.end": end},
        vary=axes,
        samples=3 if any(axis["kind"] == "random" for axis in axes) else 1,
        metrics={**{path.replace(".", "_"): path for path in figures}},
    )
    return plan_of(study, load(scenario))


def rows_of(made: tuple[Outcome, Run]) -> tuple[Any, ...]:
    """Everything that is to be the same, the run's rows as bytes."""
    outcome, run = made
    inputs = [(one.name, column.name) for one in run.instances for column in one.input_columns]
    rows = [run.signal(*name).tobytes() for name in inputs]
    rows.append(np.ascontiguousarray(run.instances[0].rows[: run.count]).tobytes())
    data = outcome.to_json()
    for key in ("wall_s", "supervised"):
        data.pop(key)
    return rows, repr(run.statistics), repr(data)


@pytest.mark.parametrize("name", sampled(STUDIES, 2))
def test_a_run_of_a_series_is_the_run_alone(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """In any order, rows, statistics and every figure; most with the slaves of the run before."""
    plan = study_of(name)
    alone = [rows_of(study_of(name).runner.execute_run(run)) for run in range(plan.count)]
    again: list[bool] = []
    before = Session.begin_again

    def counted(self: Session, *arguments: Any) -> None:
        again.append(True)
        before(self, *arguments)

    monkeypatch.setattr(Session, "begin_again", counted)
    plan.runner.supervise_no_more()
    order = [*range(plan.count)] * 2
    random.Random(7).shuffle(order)  # noqa: S311 - any order
    for run in order:
        assert rows_of(plan.runner.execute_run(run)) == alone[run], run
    assert again


_LENGTHS = """
title = "rows of so many numbers"
[run]
end = 1.0
step = 0.1
[components.e]
fmu = "{fmu}"
parameters = {{ n = 3, gain = 1.0, "Float64.row" = [[1, 2, 3], [4, 5, 6], [7, 8, 9]] }}
"""


def ended(plan: Plan, run: int) -> tuple[str, str]:
    """The status of a run; or what is refused, and the whole text of the error."""
    try:
        return plan.runner.execute_run(run)[0].status, ""
    except InputError as error:
        return error.what, error.text()


def test_what_fits_one_length_is_looked_at_again_for_another(tmp_path: Path) -> None:
    """A matrix that is the same in all runs of a series, and has too few rows in some."""
    fmu = c_fmu("every_fmi3.c", every(), tmp_path)
    (tmp_path / "lengths.toml").write_text(_LENGTHS.format(fmu=fmu))
    axes = [
        {"kind": "grid", "path": "components.e.parameters.n", "values": [3, 4, 2.5]},
        {"kind": "grid", "path": "components.e.parameters.gain", "values": [1.0, 2.0]},
    ]
    study = Study(title="lengths", scenario="lengths.toml", vary=axes, metrics={"x": "final.e.x"})
    scenario = load(str(tmp_path / "lengths.toml"))
    plan = plan_of(study, scenario)
    plan.runner.supervise_no_more()

    order = (0, 2, 1, 3, 4, 0, 5, 1, 2)
    seen = [ended(plan, run) for run in order]
    refused = "Float64.row is an array of another shape"
    expected = ["finished" if run < 2 else refused for run in order if run < 4]
    assert [what for run, (what, _) in zip(order, seen, strict=True) if run < 4] == expected
    alone = [ended(plan_of(study, scenario), run) for run in order]
    assert seen == alone  # 2.5 is no length: the place of the error is named as well


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "a number of the design": (
        "components.controller.parameters",
        {"values": [{}, {"K[1,1]": 0.1}]},
        "K[1,1] is a number of the design, and the scenario has another one",
    ),
    "a value that is not allowed": (
        "run.events",
        {"values": ["grid", "never"]},
        "the varied scenario is not allowed",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_run_is_refused_whatever_ran_before(name: str) -> None:
    """The first time and again, after a run that is refused and after one that is not."""
    path, values, refused = REFUSED[name]
    axis = {"kind": "grid", "path": path, **values}
    metrics = {"x": "final.plant.x[1]"}
    study = Study(
        title="refused",
        scenario="paper-example",
        set={"run.end": 0.1},
        vary=[axis],
        metrics=metrics,
    )
    plan = plan_of(study, load("paper-example"))
    plan.runner.supervise_no_more()
    order = (0, 1, 1, 0, 1)
    seen = [ended(plan, run) for run in order]
    alone = [ended(plan_of(study, load("paper-example")), run) for run in order[:2]]
    assert [what for what, _ in alone] == ["finished", refused]
    assert seen == [alone[run] for run in order]


_MEDIA = """
title = "each way over a medium of its own, or both over one"
run = { end = 3.0, step = 0.1 }
components = { plant = { fmu = "DelayedPlant" }, controller = { fmu = "PaperController" } }
connect = ["plant.x -> controller.x : up", "controller.u -> plant.u : down"]
[medium.one]
nodes = { a = [0], b = ["100 m"] }
data_rate = 1000
access = "aloha"
[medium.two]
nodes = { a = [0], b = ["100 m"] }
data_rate = 1000
access = "aloha"
[links.up]
kind = "packet"
medium = "one"
from = "a"
to = "b"
sample_time = 1.0
frame_size = "100 bit"
[links.down]
kind = "packet"
medium = "one"
from = "b"
to = "a"
sample_time = 1.0
frame_size = "100 bit"
[[events]]
when = "plant.x[1] > 2"
loss = { up = 0.9 }
"""


def test_a_link_is_made_anew_where_another_one_comes_to_its_medium(tmp_path: Path) -> None:
    """Links over one medium are adjustable together: `down` is where `up` is over the same one."""
    (tmp_path / "media.toml").write_text(_MEDIA)
    axis = {"kind": "grid", "path": "links.up.medium", "values": ["one", "two"]}
    metrics = {"x": "final.plant.x[1]"}
    study = Study(title="media", scenario="media.toml", vary=[axis], metrics=metrics)
    scenario = load(str(tmp_path / "media.toml"))
    plan = plan_of(study, scenario)
    plan.runner.supervise_no_more()
    alone = [rows_of(plan_of(study, scenario).runner.execute_run(run)) for run in (0, 1)]
    assert alone[0] != alone[1]
    for run in (1, 0, 1):
        assert rows_of(plan.runner.execute_run(run)) == alone[run]


def test_a_session_begins_again_as_a_new_one_begins() -> None:
    """Passes of the initialisation, and the first row, are those of a new one."""
    plan = study_of("packets")
    first, other = (system_of(plan, run) for run in (0, 1))
    late = replace(first.links["uplink"], delay_ns=0), replace(first.links["downlink"], delay_ns=0)
    at_once = with_links(first, *late)
    with Session(first) as session:
        for system in (other, at_once, first):
            assert session.can_begin_again(system)
            session.begin_again(system)
            with Session(system) as fresh:
                assert session.initial_passes == fresh.initial_passes
                mine, new = (one.instances[0].rows[0] for one in (session, fresh))
                assert mine.tobytes() == new.tobytes()
            session.run_until()


def test_a_session_does_not_begin_again_for_another_structure() -> None:
    """Another order of receiving, a link of another form, more messages, a slave that failed."""
    plan = study_of("packets")
    first = system_of(plan, 0)
    uplink = first.links["uplink"]
    reordered = with_links(first)
    order = receiving_order(reordered)
    other = order._replace(order=order.order[::-1])
    object.__setattr__(reordered, "receiving", (None, other))
    with Session(first) as session:
        assert session.can_begin_again(with_links(first))
        assert not session.can_begin_again(reordered)
        for change in ({"quantization": 0.5}, {"on_loss": "zero"}, {"sample_time_ns": 10**8}):
            assert not session.can_begin_again(with_links(first, replace(uplink, **change)))
        session.instances[0].slave.phase = "failed"
        assert not session.can_begin_again(first)


def system_of(plan: Plan, run: int) -> System:
    """The system of a run."""
    return assembled_system(plan.runner._prepared(plan.runner._loaded(run, "")))[0]


def with_links(system: System, *changed: Any) -> System:
    """The system with other links."""
    links = {**system.links, **{link.name: link for link in changed}}
    schedule = system.comm_schedule
    again = make_schedule(links, schedule.step_ns, schedule.end_ns, schedule.events)
    return replace(system, links=links, comm_schedule=again)
