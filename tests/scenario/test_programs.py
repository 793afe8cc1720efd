"""Programs as a Python user writes them, from the names of the front door alone."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from fmpy import simulate_fmu

from cosim import (
    Component,
    CosimError,
    Delay,
    DelaySystem,
    Result,
    Scenario,
    Trace,
    analyse,
    design,
    env,
    inject,
    link,
    open_session,
    pack,
    run,
    run_async,
    scenario_of,
    sweep,
)
from cosim.hinf.delay_lti import dead_time

SYSTEM = DelaySystem(
    A=[[0, 1], [-1, -0.5]],
    B=[[0], [1]],
    C=[[0], [1]],
    D=[[1, 0], [0, 0]],
    D2=[[0], [1]],
    delays=[Delay(0.6, feedback=True, any_age=True)],
)


@pytest.fixture(scope="module")
def d() -> Result:
    return design(SYSTEM)


@pytest.fixture(scope="module")
def s(d: Result) -> Scenario:
    return (
        Scenario(step=0.01, until=6)
        .add("plant", d.system, initial=[1, 0])
        .add("controller", d)
        .link("up", sample_time=0.1, delay=0.2, loss=0.1)
        .connect("plant.x", "controller.x", over="up")
        .connect("controller.u", "plant.u")
        .at(2, lasts=1, outage=["up"])
    )


def test_design_save_load(d: Result, tmp_path: Path) -> None:
    d.save(tmp_path / "g.json")
    assert Result.load(tmp_path / "g.json") == d


def test_python_control_with_a_dead_time_and_the_loop_of_a_design(d: Result) -> None:
    closed = (2 * control.tf([1], [1, 1]) * dead_time(0.5)).feedback()
    assert closed.step_response(10).outputs[-1] == pytest.approx(2 / 3, abs=1e-3)
    d.loop.step_response(5).plot()


def test_check_the_proof(d: Result) -> None:
    assert d.check().valid


def test_what_does_age_cost() -> None:
    gammas = [design(SYSTEM.with_(delays=[link(age)])).gamma for age in (0.2, 0.4)]
    assert gammas == sorted(gammas)


def test_fmus_of_an_own_plant_and_its_controller(d: Result, tmp_path: Path) -> None:
    pack(d.system, tmp_path / "plant.fmu")
    pack(d, tmp_path / "controller.fmu", sample_time=0.1)
    assert len(simulate_fmu(str(tmp_path / "controller.fmu"), stop_time=1.0)) > 1


def test_an_own_controller_by_hand(s: Scenario) -> None:
    with open_session(s) as q:
        while not q.ended:
            q["plant.u"] = [-0.3 * q["plant.x"][1]]
            q.step()
        assert abs(q["plant.x"]).max() < 1


def test_snapshots(s: Scenario) -> None:
    with open_session(s) as q:
        before = q.save()
        q.run(2)
        x = q["plant.x"]
        q.restore(before)
        q.run(2)
        assert np.array_equal(q["plant.x"], x)


def test_gymnasium(s: Scenario) -> None:
    e = env(s, act=["plant.u"], observe=["plant.x"], reward=lambda x, u: -x @ x - u @ u)
    x, _ = e.reset(seed=1)
    assert e.step([-0.3 * x[1]])[1] < 0
    e.close()


def test_many_runs_and_one_in_the_background(s: Scenario) -> None:
    grid = {"links.up.delay": [0.1, 0.2], "run.seed": range(1, 3)}
    assert len(sweep(s, grid)) == 4
    assert asyncio.run(run_async(s)).status == "finished"


def test_frames(s: Scenario) -> None:
    r = run(s)
    assert r.to_pandas("plant.x", align=0.1).shape == (61, 2)
    assert r.to_xarray(["plant.x", "controller.u"])["plant.x[1]"].dims == ("time",)
    assert len(r.dropped("up")) > 0
    assert len(r.plot("plant.x", "controller.u")) == 2


def test_a_trace_is_the_same_on_disk(s: Scenario, tmp_path: Path) -> None:
    r, t = run(s, tmp_path / "r.mcap"), Trace(tmp_path / "r.mcap")
    assert np.array_equal(r["plant.x"], t["plant.x"])
    heavier = s.set("components.plant.parameters.B[2,1]", 0.5)
    assert not np.array_equal(run(heavier)["plant.x"], t["plant.x"])


def test_replay(s: Scenario, tmp_path: Path) -> None:
    """The scenario of a trace, as it was and with another plant."""
    r = run(s, tmp_path / "r.mcap")
    again = scenario_of(tmp_path / "r.mcap")
    assert run(again, tmp_path / "again.mcap").diff(r).identical
    other = analyse(SYSTEM, [[-0.4, -0.4]])
    assert inject(tmp_path / "r.mcap", other, tmp_path / "other.mcap").status == "finished"
    heavier = again.set("components.plant.parameters.B[2,1]", 0.5)
    assert not run(heavier, tmp_path / "heavier.mcap").diff(tmp_path / "r.mcap").equal
    with pytest.raises(CosimError, match="wrote no trace"):
        run(s).diff(r)


def test_own_equations_in_python() -> None:
    class Tank(Component):
        inputs, outputs = {"q": 1}, {"h": 1}

        def start(self, t):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN202, ARG002
            self.h = 1.0

        def step(self, t, dt, u):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN202, ARG002
            self.h += dt * (u["q"][0] - 0.5 * self.h**0.5)
            return {"h": [self.h]}

    r = run(Scenario(step=0.1, until=60).add("tank", Tank, parameters={"q": 0.5}))
    assert r["tank.h"].values[-1] == pytest.approx(1.0)


def test_live(s: Scenario) -> None:
    seen: list[Any] = []
    run(s, on_row=lambda row: seen.append((row.t, row["plant.x"])))
    assert len(seen) == 601


def test_a_notebook_shows_it(s: Scenario) -> None:
    assert "<table>" in run(s)._repr_html_()
