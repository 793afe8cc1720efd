"""Scenarios made in Python: objects as components, the TOML both ways, the words of errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from shared import fmu_store

from cosim import (
    CosimError,
    Delay,
    DelaySystem,
    Result,
    Scenario,
    Traces,
    analyse,
    pack,
    run,
)
from cosim.core import InputError
from cosim.hinf import system_by_name
from cosim.hinf.delay_lti import dead_time, feedback, lti

SYSTEM = system_by_name("paper").system


@pytest.fixture(scope="module")
def design() -> Result:
    """A proved gain of the paper's system."""
    return analyse(SYSTEM, [[0.3148, 0.2392]])


@pytest.fixture
def loop(design: Result) -> Scenario:
    return (
        Scenario(step=0.01, until=4, title="A loop in Python", seed=3)
        .add("plant", design.system, initial=[1.0, 0.0])
        .add("controller", design)
        .link("up", sample_time=0.1, delay=0.05, loss=0.1)
        .connect("plant.x", "controller.x", over="up")
        .connect("controller.u", "plant.u")
        .at(2, lasts=0.5, outage=["up"])
        .require("plant.x[1] < 2", name="stays near")
    )


def fly(scenario: Any, **more: Any) -> Any:
    return run(scenario, fmus=fmu_store("native"), **more)


def test_objects_fly_and_the_run_is_judged_by_the_proof_of_the_design(loop: Scenario) -> None:
    """The plant is the design's own system, so that its guarantee is asked for, and answered."""
    found = fly(loop)
    assert found.status == "finished"
    assert found["plant.x"].values[0].tolist() == [1.0, 0.0]
    assert found.assertions[0].as_expected
    assert found.assumptions["plant_as_designed"] is True
    assert found.assumptions["controller_as_designed"] is True
    assert len(found.dropped("up")) > 0


def test_the_toml_of_a_scenario_is_the_same_run(loop: Scenario, tmp_path: Path) -> None:
    """With FMUs and the design beside it, from wherever it is read."""
    path = loop.save(tmp_path / "kept" / "loop.toml")
    assert {one.name for one in path.parent.iterdir()} == {
        *("loop.toml", "plant.fmu", "controller.fmu", "controller.json")
    }
    mine, read = fly(loop), fly(path)
    again = fly(Scenario.load(path))
    for other in (read, again):
        assert np.array_equal(other["plant.x"].values, mine["plant.x"].values)
        assert other.assumptions == mine.assumptions
        assert other.links == mine.links


def test_a_scenario_is_not_changed_by_its_methods(loop: Scenario) -> None:
    """Each returns another; equal ones say the same."""
    other = loop.set("links.up.delay", 0.2)
    assert other != loop
    assert other.set("links.up.delay", 0.05) == loop
    assert loop.to_data()["links"]["up"]["delay"] == 0.05
    assert fly(loop, settings=["links.up.delay=0.2"]).links == fly(other).links


def test_a_built_in_scenario_is_read_and_changed() -> None:
    scenario = Scenario.load("paper-example").set("run.end", 1.0)
    assert fly(scenario).simulated_s == 1.0


def test_a_component_by_name_needs_no_object() -> None:
    sea = Scenario(step=0.1, until=1).add("sea", "WaveField", parameters={"Hs": 1.0})
    assert fly(sea)["sea.disturbance"].values.shape == (11, 4)


def test_arrays_of_numpy_are_values(loop: Scenario) -> None:
    gain = loop.connect("plant.x", "controller.x", matrix=np.eye(2))
    assert gain.to_data()["connections"][-1]["matrix"] == [[1.0, 0.0], [0.0, 1.0]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.link("up", dely=0.1), r"no key 'links\.up\.dely'"),
        (lambda s: s.connect("plant.q", "controller.x"), "no output 'q'"),
        (lambda s: s.at(20, outage=["up"]), "after the end of the run"),
        (lambda s: s.require("plant.x[1] <"), "assertions"),
        (lambda s: s.connect("plant.x", "controller.x", over="down"), "no link 'down'"),
    ],
)
def test_what_does_not_fit_has_the_message_of_a_file(
    loop: Scenario, change: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        fly(change(loop))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Scenario(step=0.1, until=1, sed=3), "no key 'sed'"),
        (lambda: Scenario(step=0.1, until=1).add("a", 3), "cannot be packed"),
        (lambda: Scenario(step=0.1, until=1).add("a", SYSTEM, limits=[1]), "no setting 'limits'"),
        (lambda: Scenario(step=0.1, until=1).add("a", SYSTEM, initial=[1]), "initial state"),
        (lambda: Scenario.load("no-such"), "no-such"),
    ],
)
def test_what_is_none_is_refused_at_once(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_it_shows_its_parts(loop: Scenario) -> None:
    assert repr(loop) == "<Scenario scenario: plant, controller; up>"


def test_a_loop_with_delays_flies_as_its_response_says() -> None:
    """A `DelayLTI` whose delays are between states is a plant; a dead time at its input a link."""
    late = feedback(lti(control.tf([1], [1, 0.3, 1])), 0.4 * dead_time(0.7))
    flight = run(
        Scenario(step=0.05, until=20).add("plant", late).at(0, set={"plant.u[1]": 1.0}),
        supervise=False,
    )
    exact = np.ravel(late.step_response(flight["plant.z[1]"].delivered).outputs)
    np.testing.assert_allclose(flight["plant.z[1]"].values, exact, atol=2e-6)
    with pytest.raises(InputError, match=r"kind='transport', delay=0\.5"):
        Scenario(step=0.1, until=1).add("plant", late * dead_time(0.5))
    with pytest.raises(InputError, match="without states"):
        Scenario(step=0.1, until=1).add("plant", lti(2.0))


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: run("paper-example", engine="fast"), "no engine 'fast'"),  # type: ignore[arg-type]
        (lambda: DelaySystem([[-1.0]], [[1.0]], delays=[0.5]), "delay 1: not a Delay"),  # type: ignore[list-item]
        (lambda: SYSTEM.with_(delay=[]), "did you mean delays"),
        (lambda: Traces(["a.mcap"]), r"Traces\(\*paths\)"),  # type: ignore[arg-type]
        (lambda: Delay("fast"), 'as "50 ms"'),
        (lambda: Delay(-1.0), "seconds >= 0"),
        (lambda: Result.from_json({"a": 1}), "'claim' is missing"),
        (lambda: Scenario(step=0.1, until=1, sed=3), "did you mean seed"),
        (lambda: pack(object(), "x.fmu"), "a system, a design"),
        (lambda: analyse(SYSTEM, "k"), "1 row of 2 finite numbers"),  # type: ignore[arg-type]
    ],
)
def test_a_mistake_is_an_error_of_this_package(ask: Any, words: str) -> None:
    """Which is a ValueError too, and says what would be right."""
    with pytest.raises(CosimError, match=words) as caught:
        ask()
    assert isinstance(caught.value, ValueError)
