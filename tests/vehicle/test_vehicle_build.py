"""`cosim fmu build` with a vehicle: by name or file, and how it refuses."""

from __future__ import annotations

import sys
from pathlib import Path

from fmpy import read_model_description
from vehicle_files import EVERY_TERM, every_term

sys.path.insert(0, str(Path(__file__).parents[1] / "cli"))
from shell import cosim


def test_a_vehicle_file_becomes_an_fmu_with_its_numbers(tmp_path: Path) -> None:
    """Inputs, outputs, parameters with their units; the same as `cosim.build_fmu` makes."""
    (tmp_path / "mine.toml").write_text(EVERY_TERM, "utf-8")
    result = cosim("fmu", "build", "mine.toml", "--flavour", "python", "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    vehicle = every_term()
    assert result.json["inputs"] == list(vehicle.inputs)
    assert result.json["parameters"] == dict(vehicle.parameters)
    model = read_model_description(str(tmp_path / "mine.fmu"))
    found = {v.name: v for v in model.modelVariables}
    assert [n for n, v in found.items() if v.causality == "input"] == list(vehicle.inputs)
    assert [n for n, v in found.items() if v.causality == "output"] == list(vehicle.outputs)
    assert {n: float(found[n].start) for n in vehicle.parameters} == dict(vehicle.parameters)
    units = {
        "hydro.X_u": "kg/s",
        "hydro.X_abs_u_u": "kg/m",
        "hydro.Y_ur": "kg",
        "fading.Y_v": "s/m",
    }
    units |= {"hydro.N_uv": "kg", "hydro.K_p": "kg.m2/s", "hydro.Z_qdot": "kg.m", "mass": "kg"}
    units |= {"derivative.stern.M_uud": "kg", "limit.bow": "N", "lag.rudder": "s"}
    assert {name: found[name].unit for name in units} == units
    assert float(found["initial.nu.u"].start) == vehicle.trim["nu.u"]


def test_what_is_no_vehicle_is_refused(tmp_path: Path) -> None:
    """A name of nothing, an initial state, a file with a fault: its line."""
    (tmp_path / "mine.toml").write_text(EVERY_TERM, "utf-8")
    (tmp_path / "bad.toml").write_text(EVERY_TERM.replace("mass = 30.0", "mass = 0.0"), "utf-8")
    for arguments, words in (
        (["remus"], "there is no system or vehicle 'remus'"),
        (["mine.toml", "--initial", "1,2"], "set where it runs"),
        (["bad.toml"], "bad.toml:8: the value of 'body.mass'"),
    ):
        result = cosim("fmu", "build", *arguments, cwd=tmp_path)
        assert result.code == 2
        assert words in result.err
