"""Components in Python: nodes of the graph like any other, refused by name where they are not."""
# ruff: noqa: ARG002, RUF012 - components as a user writes them

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException

from cosim import Component, Scenario, open_session, pack, run, sweep
from cosim.core import ComponentError, InputError
from cosim.hinf import system_by_name
from cosim.trace import Trace


class Tank(Component):
    inputs, outputs = {"q": 1}, {"h": 1}

    def __init__(self, level: float = 1.0) -> None:
        self.h = level

    def start(self, t: float) -> Any:
        return {"h": [self.h]}

    def step(self, t: float, dt: float, u: Any) -> Any:
        self.h += dt * (u["q"][0] - 0.5 * self.h**0.5)
        return {"h": [self.h]}


class Law(Component):
    inputs, outputs = {"h": 1}, {"q": 1, "both": 2}

    def step(self, t: float, dt: float, u: Any) -> Any:
        return {"q": 0.5 + 0.3 * (2.0 - u["h"][0]), "both": [t, dt]}


def plain(until: float = 3.0) -> Scenario:
    return (
        Scenario(step=0.01, until=until)
        .add("tank", Tank())
        .add("law", Law)
        .connect("tank.h", "law.h")
        .connect("law.q", "tank.q")
    )


LINKED = (
    Scenario(step=0.01, until=3.0)
    .add("tank", Tank(1.5))
    .add("law", Law)
    .link("up", sample_time=0.1, delay=0.2, loss=0.2)
    .connect("tank.h", "law.h", over="up")
    .connect("law.q", "tank.q")
)


def test_it_steps_with_the_inputs_of_the_beginning_of_each_step() -> None:
    """To the last bit what the same loop by hand computes: a Jacobi exchange."""
    found = run(plain(), supervise=False)
    h, q, expected = 1.0, 0.0, [1.0]
    for _ in range(300):
        before = h
        h += 0.01 * (q - 0.5 * h**0.5)
        q = 0.5 + 0.3 * (2.0 - before)
        expected.append(h)
    assert found["tank.h"].values.tolist() == pytest.approx(expected, abs=1e-12)
    times, sizes = found["law.both"].values[1:].T
    assert times.tolist() == pytest.approx((np.arange(300) / 100).tolist())
    assert sizes.tolist() == pytest.approx([0.01] * 300)


def test_a_variable_meets_a_group_of_one() -> None:
    """Either way round: the plant's input is u[1], the law's output u."""

    class One(Component):
        inputs, outputs = {"v": 1}, {"u": 1}

        def step(self, t: float, dt: float, u: Any) -> Any:
            return {"u": 0.25}

    loop = Scenario(step=0.01, until=0.1).add("plant", system_by_name("paper").system)
    found = run(loop.add("law", One).connect("law.u", "plant.u"), supervise=False)
    assert found["plant.u[1]"].values[-1] == 0.25
    other = loop.add("law", One).connect("plant.x[1]", "law.v")
    assert run(other, supervise=False)["law.u"].values[-1] == 0.25


def test_each_run_has_a_copy_of_the_object() -> None:
    scenario = plain()
    first = run(scenario, supervise=False)
    assert np.array_equal(run(scenario, supervise=False)["tank.h"], first["tank.h"])
    two = (
        Scenario(step=0.1, until=1)
        .add("a", tank := Tank())
        .add("b", tank)
        .at(0.5, override={"a.h": 9.0})
    )
    found = run(two, supervise=False)
    assert found["b.h"].values[-1] < 1.0
    assert tank.h == 1.0


def test_it_flies_behind_links_with_events_and_sweeps() -> None:
    found = run(LINKED, supervise=False)
    assert len(found.dropped("up")) > 0
    outage = run(LINKED.at(1.0, lasts=1.0, outage=["up"]), supervise=False)
    assert not np.array_equal(outage["tank.h"], found["tank.h"])
    grid = {"links.up.delay": [0.1, 0.3]}
    frame = sweep(LINKED, grid, {"h": "final.tank.h"})
    assert frame["h"].nunique() == 2


_IN_A_FRESH_PROCESS = """
import sys
sys.path[:0] = {paths!r}
from test_component import LINKED
from cosim import open_session, run, sweep
assert len(sweep(LINKED, {{"run.seed": [1, 2]}}, workers=2)) == 2
supervised = run(LINKED)
assert supervised.supervised == "fork", supervised.supervised
with open_session(LINKED, supervise=False) as here:
    here.run(1.0)
    before = here.save()
    portable = here.save(portable=True)
    here.run(3.0)
    end = here["tank.h"]
    for one in (before, portable):
        here.restore(one)
        here.run(3.0)
        assert here["tank.h"] == end
assert supervised["tank.h"].values[-1] == end == run(LINKED, supervise=False)["tank.h"].values[-1]
print("alike")
"""


def test_in_a_child_and_from_snapshots_it_is_the_same_run() -> None:
    """In an interpreter that has loaded no FMU, whose child is a fork of it."""
    code = _IN_A_FRESH_PROCESS.format(paths=sys.path)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)  # noqa: S603
    assert done.stdout.split() == ["alike"], done.stderr


def test_what_raises_ends_the_run_with_its_line() -> None:
    class Late(Component):
        outputs = {"y": 1}

        def step(self, t: float, dt: float, u: Any) -> Any:
            return {"y": 1.0 if t < 0.5 else u["none"]}

    found = run(Scenario(step=0.1, until=2).add("late", Late), supervise=False)
    assert found.status == "failed"
    assert "step raises KeyError: 'none'" in str(found.reason)
    assert f"{Path(__file__).name}, line" in str(found.reason)
    assert found["late.y"].values[1:6].tolist() == [1.0] * 5


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"z": 1.0}, "there is no output 'z'"),
        ({"y": [1.0, 2.0]}, "ValueError"),
        ({"y": float("nan")}, "y is not finite"),
        ({"y": "text"}, "ValueError"),
        (3.5, "outputs by name are expected"),
    ],
)
def test_what_is_no_value_of_an_output_is_refused(values: Any, message: str) -> None:
    class Wrong(Component):
        outputs = {"y": 1}

        def start(self, t: float) -> Any:
            return values

    with pytest.raises(ComponentError, match=message):
        run(Scenario(step=0.1, until=1).add("wrong", Wrong), supervise=False)


def test_a_step_that_returns_nothing_is_a_fault() -> None:
    """As where `return` is forgotten: the values before are not taken for its own."""

    class Silent(Component):
        outputs = {"y": 1}

        def step(self, t: float, dt: float, u: Any) -> Any:
            pass

    found = run(Scenario(step=0.1, until=1).add("silent", Silent), supervise=False)
    assert (found.status, found.simulated_s) == ("failed", 0.0)
    assert "outputs by name are expected" in str(found.reason)


def test_attributes_that_cannot_be_saved_are_named_when_they_are_missed() -> None:
    class Open(Tank):
        def start(self, t: float) -> Any:
            self.law = lambda h: -h
            return super().start(t)

    scenario = Scenario(step=0.1, until=1).add("tank", Open())
    with open_session(scenario, supervise=False) as session:
        before = session.save()
        session.step()
        with pytest.raises(ComponentError, match="could not be saved"):
            session.restore(before)


@pytest.mark.parametrize(
    ("component", "message"),
    [
        (Component(), "without outputs"),
        (type("Odd", (Component,), {"outputs": ["y"]})(), "have no numbers"),
        (type("Odd", (Component,), {"outputs": {"y": 0}})(), "have no numbers"),
        (type("Odd", (Component,), {"inputs": {"y": 1}, "outputs": {"y": 1}})(), "no names"),
        (type("Odd", (Component,), {"outputs": {"y[1]": 1}})(), "no names"),
        (type("Odd", (Component,), {"outputs": {"code.mark": 1}})(), "no names"),
    ],
)
def test_what_is_no_component_is_refused_when_it_is_added(component: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Scenario(step=0.1, until=1).add("odd", component)


def test_it_is_no_file_and_no_fmu_for_others(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no file"):
        plain().save(tmp_path / "a.toml")
    with pytest.raises(InputError, match="in its own process alone"):
        pack(Tank(), tmp_path / "tank.fmu")
    assert not list(tmp_path.iterdir())


def test_a_child_that_would_not_have_the_code_is_refused() -> None:
    run(plain(0.1), supervise=False)  # what it loads must not be forked
    with pytest.raises(InputError, match="would not have the Python code"):
        run(plain(0.1), supervise=True)
    with pytest.raises(InputError, match="would not have the Python code"):
        sweep(plain(0.1), {"run.seed": [1, 2]}, workers=2)


def test_another_process_refuses_it_by_name(tmp_path: Path) -> None:
    """Whatever stands at the address there: a rerun of its trace, another tool."""
    trace = tmp_path / "a.mcap"
    run(plain(0.5), trace, supervise=False)
    command = [sys.executable, "-m", "cosim", "trace", "rerun", str(trace), "--out"]
    done = subprocess.run(  # noqa: S603
        [*command, str(tmp_path / "b.mcap")], capture_output=True, text=True, check=False
    )
    assert done.returncode in (2, 4), done.stderr
    assert "Python code" in " ".join((done.stdout + done.stderr).split())
    scenario = Trace(trace).attachments["scenario.toml"].decode()
    fmu = next(line.split('"')[1] for line in scenario.splitlines() if line.startswith("fmu = "))
    with pytest.raises(FMICallException):
        simulate_fmu(fmu, stop_time=0.1)
