"""The built-in scenarios of a vehicle with an observer: designs, FMUs that follow, play-out."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from shared import fmu_store

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.fmu.export import FmuTarget, design_part_spec, design_parts, export_controller
from cosim.hinf.certificate import constant_ages_claimed, first_difference, pair_from_json
from cosim.scenario import FmuCache, execute_unrecorded, load, prepare
from cosim.trace import Trace
from tests.benchmarks.vehicle_designs import COMMAND_AGE, MEASURED, question

DESIGNS = Path(str(files("cosim.scenario").joinpath("library", "designs")))


def stored(name: str) -> Any:
    """A design of the library, as JSON values."""
    return json.loads((DESIGNS / f"{name}.json").read_bytes())


@pytest.mark.parametrize("name", MEASURED)
def test_a_design_is_about_the_vehicle_of_the_gallery_and_its_sensors(name: str) -> None:
    """Made again from the vehicle's file but for the solver: plant, ages, noise, and the note."""
    system, measured, note = question(name)
    data = stored(name)
    pair = pair_from_json(data)
    assert first_difference(system, pair.plant) is None
    for one, own in zip(measured, pair.measurements, strict=True):
        assert (one.name, one.C.tolist()) == (own.name, own.C.tolist())
        assert one.delay(8).d == own.delay(8).d
        assert np.allclose(one.noise, own.noise, rtol=1e-3)
    assert (data["command_age"], data["command_any_age"]) == (COMMAND_AGE[name], True)
    assert constant_ages_claimed(data) == {}
    kept = data["plant_note"]
    assert {key: kept[key] for key in ("model", "trim", "source", "parameters")} == {
        key: json.loads(json.dumps(note[key])) for key in ("model", "trim", "source", "parameters")
    }
    assert np.allclose(kept["thrust_map"], note["thrust_map"])


def test_each_part_of_a_design_is_an_fmu_by_name(tmp_path: Path) -> None:
    """Of a design of the package and of a file alike; others are refused with what there is."""
    data = stored("auv-survey")
    assert design_parts(data) == ["plant", "controller", "onboard", "usbl"]
    (tmp_path / "own.json").write_text(json.dumps(data))
    cache = FmuCache(tmp_path / "fmus", tmp_path)
    found = cache.find("own.json:usbl")
    assert [v for v in found.ports if v.startswith("u[")] == ["u[1]", "u[2]"]
    assert found.path == cache.find("own.json:usbl").path
    for wrong, hint in (
        ("auv-survey:usb", "usbl"),
        ("auv-1.25s:plant", "cosim vehicle fly"),
        ("auv-surve:plant", "auv-survey"),
    ):
        with pytest.raises(InputError) as refused:
            cache.find(wrong)
        assert hint in refused.value.text()


def test_the_controller_of_a_design_knows_limits_trim_and_thrust_map() -> None:
    """What the design file says of its plant, in the plant's own units."""
    data = stored("auv-survey")
    start = {v.name: v.start for v in design_part_spec(data, "controller", name="c").variables}
    note = data["plant_note"]
    assert start["limit.thruster.surge"] == 2500.0
    assert start["thrust_map[4,2]"] == note["thrust_map"][3][1] != 0.0
    assert start["envelope[7]"] == note["envelope"]["nu.w"][1]
    assert start["age.usbl"] == 13.1


@pytest.mark.slow
def test_an_exported_controller_of_a_vehicle_commands_its_actuators(tmp_path: Path) -> None:
    """As the one of a scenario: limits, trim, thrust map; limits that are given replace them."""
    data, kind = stored("auv-survey"), FmuTarget("python")
    limits = [100.0, 200.0, 300.0, 400.0]
    for name, more in (("own", {}), ("less", {"limits": limits})):
        export_controller(data, tmp_path / f"{name}.fmu", where="test", kind=kind, **more)
    own, less = (describe_fmu(tmp_path / f"{name}.fmu").ports for name in ("own", "less"))
    spec = design_part_spec(data, "controller", name="own")
    assert {name: port.start for name, port in own.items()} == {
        v.name: v.start for v in spec.variables
    }
    assert [less[f"limit.thruster.{x}"].start for x in ("surge", "sway", "heave", "yaw")] == limits
    export_controller(data, tmp_path / "o.fmu", where="test", kind=kind, observer=True)
    alone = describe_fmu(tmp_path / "o.fmu").ports
    assert {"u[1]", "trim.usbl[1]", "envelope[7]"} <= set(alone)


@pytest.mark.slow
def test_a_survey_can_be_repeated_from_its_trace(tmp_path: Path) -> None:
    """FMUs of a design are found again by what the scenario calls them."""
    words = ("--until", "20 s", "--fmus", fmu_store(), "--out", "s.mcap")
    assert cosim("run", "auv-survey", *words, cwd=tmp_path).code == 0
    again = cosim("trace", "rerun", "s.mcap", "--fmus", fmu_store(), cwd=tmp_path)
    assert again.code == 0, again.out + again.err


@pytest.mark.parametrize("name", MEASURED)
def test_commands_are_never_older_than_their_proof(name: str, tmp_path: Path) -> None:
    """From the estimate to the end of their use, held for a step; measured in the scenario."""
    prepared = prepare(load(name, ["run.end=20"]), FmuCache(fmu_store(), tmp_path))
    outcome, _ = execute_unrecorded(prepared, zero_state_run=False)
    ages = outcome.metrics["measurement_ages"]["commands"]
    assert 0.0 < ages["measured"]["greatest_s"] <= ages["greatest_s"] == COMMAND_AGE[name]
    assert outcome.metrics["assumptions"]["age_of_commands_within_design"]


def test_the_watchdog_stops_who_designs_for_fresh_fixes(tmp_path: Path) -> None:
    """Left as it is, the controller for fresh fixes commands safe values from 0.3 s on."""
    quiet = "components.controller.parameters"
    words = ("--until", "20 s", "--fmus", fmu_store(), "--out", "s.mcap")
    setting = ("--set", f'{quiet}={{"age.usbl" = 0.3}}')
    result = cosim("run", "auv-survey-naive", *setting, *words, cwd=tmp_path)
    assert "safe values are commanded" in result.out, result.err
    out = Trace(tmp_path / "s.mcap").read("/controller/output")
    assert not out["thruster.surge"][out.log_time_ns > 400_000_000].any()


STILL = {
    "sea": {"Hs": 0.0},
    "plant": {"initial.eta.x": 0.0},
    "telemetry": {**{f"noise[{i}]": 0.0 for i in range(1, 7)}, "sample_time": 0.25},
    "usbl": {"noise[1]": 0.0, "noise[2]": 0.0, "sample_time": 1.0},
}
"""Still water, and no noise: along its own axis the vehicle is as its linear model."""


@pytest.mark.parametrize(
    ("command_delay", "link", "error"),
    [
        (0.8, {}, 0.0),
        (0.0, {}, 0.04),  # it takes commands to act at once
        (0.8, {"playout": 0.0}, 0.01),  # they act when they come
        (0.8, {"jitter.width": 0.6}, 1e-5),  # some come after their play-out: they never act
    ],
)
def test_with_play_out_a_remote_observer_knows_what_acts_when(
    command_delay: float, link: dict[str, float], error: float, tmp_path: Path
) -> None:
    """A metre ahead over a link that jitters: with it the estimate is exact, and without it wrong.

    In any case the run says whether the observer knew.
    """
    own = {**STILL, "controller": {"sample_time": 0.25, "command.delay": command_delay}}
    changed = [f"links.commands.{key}={value}" for key, value in link.items()]
    for name, values in own.items():
        listed = ", ".join(f'"{key}" = {value}' for key, value in values.items())
        changed.append(f"components.{name}.parameters={{ {listed} }}")
    changed += ["run.end=15", "reference.points=[[0.0, 1.0, 0.0, 0.0], [60.0, 1.0, 0.0, 0.0]]"]
    prepared = prepare(load("auv-remote", changed), FmuCache(fmu_store(), tmp_path))
    outcome, run = execute_unrecorded(prepared, zero_state_run=False)
    off = np.abs(run.signal("plant", "eta.x") - run.signal("controller", "estimate[1]")).max()
    assert off < 1e-12 if error == 0.0 else off > error
    assert outcome.metrics["assumptions"]["observer_knows_commands"] == (error == 0.0)
    assert bool(outcome.links["commands"]["late"]) == ("jitter.width" in link)
