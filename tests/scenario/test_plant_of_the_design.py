"""A design is for the plant that flies, or the run says which parameter differs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim import hinf
from cosim.core import InputError
from cosim.models import TABLE_1, inertia
from cosim.scenario import (
    FmuCache,
    LoadedScenario,
    PreparedScenario,
    execute_unrecorded,
    parameters_of_plant,
    parse,
    prepare,
    problem_of,
)

SCENARIO = """\
title = "Two seconds"
connect = [
    "plant.eta -> controller.eta : up",
    "plant.nu -> controller.nu : up",
    "controller.force -> plant.force",
    "controller.moment -> plant.moment",
]
[run]
end = 2.0
step = 0.05
[components.plant]
fmu = "AuvPlant"
parameters = {{ {plant} }}
[components.controller]
fmu = "HinfController"
parameters = {{ {controller} }}
[links.up]
kind = "packet"
sample_time = 0.15
delay = 0.25
{design}
"""
FILE = '[design]\nsystem = "auv"\nfile = "auv-1.25s"\n'
BOX = "envelope = { u = 0.1, v = 0.1, w = 0.1, r = 0.03, psi = 0.1 }\n"
MADE = f'[design]\nsystem = "auv"\n{BOX}'
OWN = {"mass": 2700.0, "inertia.z": 7000.0, "damping.u": 0.1, "delay.d": 0.4}
TOML = ", ".join(f'"{name}" = {value}' for name, value in OWN.items())


@pytest.fixture(scope="module")
def fmu_cache(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> FmuCache:
    folder = tmp_path_factory.mktemp("plants")
    return FmuCache(native_fmus.parent, folder, flavour="native")


def loaded(plant: str = "", controller: str = "", design: str = MADE) -> LoadedScenario:
    text = SCENARIO.format(plant=plant, controller=controller, design=design)
    return parse(text, name="s", where="s.toml", folder=Path("no-such-folder"))


@pytest.fixture(scope="module")
def own(fmu_cache: FmuCache) -> PreparedScenario:
    """A vehicle of its own, and the design that is made for it."""
    return prepare(loaded(TOML), fmu_cache)


def metrics(prepared: PreparedScenario) -> Any:
    return execute_unrecorded(prepared)[0].metrics


def test_the_design_is_for_the_parameters_of_the_plant(own: PreparedScenario) -> None:
    """Model, envelope and thrust map are those of the vehicle that flies; the proof is of them."""
    assert own.problem is not None
    vehicle = own.problem.vehicle
    assert vehicle is not None
    assert {name: vehicle.parameters[name] for name in ("mass", "inertia.z")} == {
        "mass": 2700.0,
        "inertia.z": 7000.0,
    }
    assert vehicle.damping == (0.1, 0.05, 0.05, 0.05)
    assert vehicle.state_delay == own.problem.system.delays[0].d == 0.4
    mass = np.array(inertia({**TABLE_1, **OWN}))
    ports = own.fmus["controller"].ports
    starts = {name: port.start for name, port in ports.items()} | own.gain["controller"]
    used = [[starts[f"thrust_map[{i},{j}]"] for j in range(1, 5)] for i in range(1, 5)]
    assert np.array_equal(np.array(used), mass)
    found = metrics(own)
    assert found["assumptions"]["plant_as_designed"] is True
    assert "plant_differences" not in found


def test_table_1_flies_as_ever(fmu_cache: FmuCache) -> None:
    """Nothing is set but the gain, and the uncertainty is the published one."""
    prepared = prepare(loaded('"delay.d" = 0.5', design=FILE), fmu_cache)
    assert all(name.startswith("K[") for name in prepared.gain["controller"])
    assert prepared.problem is not None
    assert hinf.certificate.first_difference(prepared.problem.system, hinf.auv_system()) is None


def test_a_named_design_for_another_vehicle_is_refused(fmu_cache: FmuCache) -> None:
    """13.5 kg with the thrust map of 5.4 t: by the run and by the check, with both values."""
    light = loaded("mass = 13.5, length = 0.46", design=FILE)
    with pytest.raises(InputError, match=r"mass[\s\S]*5454[\s\S]*13\.5[\s\S]*length"):
        prepare(light, fmu_cache)
    # without [design] the built-in controller would fly with its own gain and thrust map
    with pytest.raises(InputError, match=r"mass[\s\S]*5454[\s\S]*13\.5"):
        prepare(loaded("mass = 13.5, length = 0.46", design=""), fmu_cache)
    assert prepare(loaded("mass = 6000.0", design=""), fmu_cache).design is None


def departure(assumption: str, place: str, expected: str, got: str) -> dict[str, str]:
    """Return what a run says of one parameter."""
    return {"assumption": assumption, "place": place, "expected": expected, "got": got}


def test_a_plant_that_differs_a_little_is_named(fmu_cache: FmuCache) -> None:
    """It flies, and the line "plant as designed" has the parameter with both values."""
    found = metrics(prepare(loaded('mass = "6 t", "delay.d" = 0.6', design=FILE), fmu_cache))
    assert found["assumptions"]["plant_as_designed"] is False
    assert [x for x in found["departures"] if x["assumption"] == "plant_as_designed"] == [
        departure("plant_as_designed", "plant.mass", "5454.0", "6000.0"),
        departure("plant_as_designed", "plant.delay.d", "0.5", "0.6"),
    ]


def test_a_thrust_map_of_its_own_is_named(fmu_cache: FmuCache) -> None:
    """The plant is as designed, what the controller makes of an acceleration is not."""
    found = metrics(
        prepare(loaded(controller='"thrust_map[1,1]" = 5000.0', design=FILE), fmu_cache)
    )
    assert found["assumptions"]["plant_as_designed"] is True
    assert found["assumptions"]["controller_as_designed"] is False
    named = [x["place"] for x in found["departures"] if x["assumption"] == "controller_as_designed"]
    assert named == ["controller.thrust_map[1,1]"]


def test_what_the_design_says_stands() -> None:
    """`damping` and `state_delay` of [design] are not those of the plant; a unit is converted."""
    design = f"{MADE}damping = [0.05, 0.05, 0.05, 0.05]\nstate_delay = 0.5\n"
    scenario = loaded('mass = "6 t", "damping.u" = 0.1, "delay.d" = 0.4', design=design).scenario
    plant = parameters_of_plant(scenario)
    assert plant == {"mass": 6000.0, "damping.u": 0.1, "delay.d": 0.4}
    assert scenario.design is not None
    found = problem_of(scenario.design, Path(), plant).vehicle
    usual = hinf.problem.AuvDesignSettings()
    assert found is not None
    assert (found.damping, found.state_delay) == (usual.damping, usual.state_delay)
    assert found.parameters["mass"] == 6000.0


def test_a_design_made_for_a_plant_may_be_named(
    own: PreparedScenario, fmu_cache: FmuCache, tmp_path: Path
) -> None:
    """The file of a design for this plant is as good as the design made for the run."""
    assert own.design is not None
    path = tmp_path / "own.json"
    path.write_text(json.dumps(own.design.to_json()))
    design = f'[design]\nsystem = "auv"\nfile = "{path}"\n{BOX}'
    found = prepare(loaded(TOML, design=design), fmu_cache)
    assert found.problem is not None
    assert found.problem.vehicle is not None
    assert found.problem.vehicle.parameters["mass"] == 2700.0
    with pytest.raises(InputError, match="another system"):
        prepare(loaded(design=design), fmu_cache)
