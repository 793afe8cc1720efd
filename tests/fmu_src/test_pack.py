"""`pack`: what there is in Python as an FMU that other tools load."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from cosim import analyse, pack
from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.hinf import system_by_name
from cosim.vehicle import load_vehicle

SYSTEM = system_by_name("paper").system


def test_a_system_a_design_a_vehicle_and_a_component_are_packed(tmp_path: Path) -> None:
    """Each is valid, is loaded by another tool, and has the model name of its file."""
    design = analyse(SYSTEM, [[0.3148, 0.2392]])
    made = [
        pack(SYSTEM, tmp_path / "plant.fmu", initial=[1.0, 0.5]),
        pack(design, tmp_path / "gain.fmu", sample_time=0.1),
        pack(load_vehicle("nps-auv2"), tmp_path / "boat.fmu"),
        pack("Sensor", tmp_path / "Sensor.fmu", flavour="native-fmi3"),
    ]
    for path in made:
        assert validate_fmu(str(path)) == []
        assert len(simulate_fmu(str(path), stop_time=0.5, output_interval=0.1)) == 6
        assert describe_fmu(path).interface.identifier == path.stem
    assert describe_fmu(made[0]).ports["initial.x[2]"].start == 0.5
    assert describe_fmu(made[1]).ports["sample_time"].start == 0.1


@pytest.mark.parametrize(
    ("what", "settings", "message"),
    [
        (3.5, {}, "cannot be packed"),
        (SYSTEM, {"sample_time": 0.1}, "no setting 'sample_time'"),
        ("no-such", {}, "no system 'no-such'"),
        (SYSTEM, {"flavour": "rust"}, "no flavour 'rust'"),
        (SYSTEM, {"name": "no name"}, "no model name"),
    ],
)
def test_what_cannot_be_packed_is_refused(
    what: Any, settings: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        pack(what, tmp_path / "x.fmu", **settings)
    assert not list(tmp_path.iterdir())
