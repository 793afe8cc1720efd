"""`cosim fmu controller`: a saved design becomes an FMU with gain, limits and proof baked in."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim, trace_of
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from shared import fmu_store

from cosim.fmu.export import component_module
from cosim.hinf import design
from cosim.hinf.certificate import certificate_bytes
from cosim.models import Delay, DelaySystem
from cosim.trace import Trace

SPEC = component_module("hinf_controller.variables").SPEC


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Saved designs: of section 5, and of three states under two late commands."""
    folder = tmp_path_factory.mktemp("designs")
    assert cosim("design", "paper", "--save", "paper.json", cwd=folder).code == 0
    system = DelaySystem(
        A=np.array([[0.0, 1.0, 0.0], [0.0, -0.5, 0.2], [0.1, 0.0, -1.0]]),
        B=np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        C=np.array([[0.0], [1.0], [0.0]]),
        D=np.array([[1.0, 0.0, 0.0]]),
        delays=(Delay(0.1, np.zeros((3, 3)), feedback=True, any_age=True),),
        name='"""\nimport os',
    )
    found = design(system, (-1.0,), (1.0,))
    (folder / "three.json").write_text(json.dumps(found.to_json()), "utf-8")
    (folder / "vehicle.json").write_bytes(SPEC.certificate or b"")
    return folder


def pack(folder: Path, *arguments: str | Path) -> Any:
    result = cosim("fmu", "controller", *arguments, "--json", cwd=folder)
    assert result.code == 0, result.err
    return result.json


@pytest.mark.parametrize("name", ["paper", "three", "vehicle"])
def test_a_design_is_packed_with_its_proof(name: str, folder: Path) -> None:
    """Valid for another tool's eyes; its certificate is the design's, and is proved in place."""
    reply = pack(folder, f"{name}.json")
    fmu = folder / f"{name}.fmu"
    assert reply["fmu"] == fmu.name
    assert reply["model"] == name
    saved = json.loads((folder / f"{name}.json").read_text())
    assert reply["K"] == saved["K"]
    assert reply["claim"] == saved["claim"]
    assert validate_fmu(str(fmu)) == []
    with zipfile.ZipFile(fmu) as archive:
        assert archive.read("resources/certificate.json") == certificate_bytes(saved)
        page = archive.read("documentation/index.html").decode()
        for entry in archive.namelist():
            if entry.endswith(".py"):
                assert b"import os\n\n" not in archive.read(entry)[:200]
    assert "What is certified" in page
    checked = cosim("certificate", "check", fmu, "--json", cwd=folder)
    assert checked.code == 0
    assert checked.json["sha256"] == reply["certificate_sha256"]


def test_the_vehicle_form_is_that_of_the_catalogue(folder: Path) -> None:
    """A design for the vehicle: the variables of HinfController, other limits and sample time."""
    reply = pack(
        folder, "vehicle.json", "-o", "v.fmu", "--limits", "1800,900", "--sample-time", "0.1"
    )
    assert reply["form"] == "vehicle"
    model = read_model_description(str(folder / "v.fmu"))
    start = {v.name: v.start for v in model.modelVariables}
    assert list(start) == [v.name for v in SPEC.variables]
    assert float(start["limit.force"]) == 1800.0
    assert float(start["limit.moment"]) == 900.0
    assert float(start["sample_time"]) == 0.1


def test_commands_are_the_gain_times_the_state_within_the_limits(folder: Path) -> None:
    """Three states, two commands, in another tool's hands: u = K x, held within +-0.05 and +-9."""
    reply = pack(folder, "three.json", "--out", "made/held.fmu", "--limits", "0.05,9")
    assert reply["form"] == "system"
    K = np.array(reply["K"])
    assert K.shape == (2, 3)
    x = np.array([0.3, -0.2, 0.7])
    result = simulate_fmu(
        str(folder / "made" / "held.fmu"),
        start_values={f"x[{j + 1}]": value for j, value in enumerate(x)},
        stop_time=0.02,
        output_interval=0.01,
        output=["u[1]", "u[2]"],
    )
    expected = np.clip(K @ x, [-0.05, -9.0], [0.05, 9.0])
    assert abs(expected[0]) == 0.05  # one at its limit, one inside
    assert abs(expected[1]) < 9.0
    np.testing.assert_allclose([result["u[1]"][-1], result["u[2]"][-1]], expected, rtol=1e-15)


def test_twice_gives_the_same_bytes(folder: Path) -> None:
    """One design, one name, one file."""
    pack(folder, "paper.json", "-o", "a/same.fmu")
    pack(folder, "paper.json", "-o", "b/same.fmu")
    assert (folder / "a" / "same.fmu").read_bytes() == (folder / "b" / "same.fmu").read_bytes()
    assert sorted(p.name for p in (folder / "a").iterdir()) == ["same.fmu"]


def test_the_gain_of_a_run_is_exported_from_its_trace(folder: Path) -> None:
    """A trace carries its certificate: its gain becomes an FMU; so does that of an FMU."""
    reply = pack(folder, trace_of("paper-example"), "-o", "flown.fmu")
    assert reply["K"] == [[0.6432, -0.5679]]
    run = Trace(trace_of("paper-example")).run
    assert reply["certificate_sha256"] == run["certificate.sha256"]
    again = pack(folder, "flown.fmu", "-o", "again.fmu")
    assert again["certificate_sha256"] == reply["certificate_sha256"]
    refused = cosim("fmu", "controller", "flown.fmu", "--json", cwd=folder)
    assert refused.code == 2
    assert "would overwrite" in refused.error["what"]


SCENARIO = """
title = "A packed controller"
[run]
end = 0.5
step = 0.01
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "{fmu}"
[[connections]]
from = "plant.x"
to = "controller.x"
[[connections]]
from = "controller.u"
to = "plant.u"
"""

DESIGN = """
[design]
system = "paper"
gain = [[{gain}]]
k1 = [0.6]
k2 = [0.2]
"""


def test_it_runs_with_its_own_gain(folder: Path) -> None:
    """Nobody sets K: every command is K x of the sample before, K of the design."""
    fmu = Path(pack(folder, "paper.json", "-o", "own.fmu")["fmu"])
    (folder / "own.toml").write_text(SCENARIO.format(fmu=fmu), "utf-8")
    ran = cosim("run", "own.toml", "--fmus", fmu_store(), "--json", cwd=folder)
    assert ran.code == 0, ran.err
    trace = Trace(folder / "traces" / "own.mcap")
    x, u = trace.read("/controller/input"), trace.read("/controller/output")
    K = json.loads((folder / "paper.json").read_text())["K"][0]
    expected = K[0] * x["x[1]"] + K[1] * x["x[2]"]
    np.testing.assert_allclose(u["u[1]"][1:], expected[:-1], rtol=1e-14, atol=1e-14)
    assert np.abs(expected).max() > 0.1


def test_a_command_at_its_limit_is_an_assumption_not_met(folder: Path) -> None:
    """A packed limit counts like the vehicle's: the summary names it, and how long it held."""
    pack(folder, "paper.json", "-o", "tight.fmu", "--limits", "0.5")
    K = json.loads((folder / "paper.json").read_text())["K"][0]
    text = SCENARIO.format(fmu="tight.fmu") + DESIGN.format(gain=", ".join(map(repr, K)))
    (folder / "tight.toml").write_text(text, "utf-8")
    ran = cosim("run", "tight.toml", "--fmus", fmu_store(), "--json", cwd=folder)
    assert ran.code == 0, ran.err
    metrics = ran.json["metrics"]
    assert metrics["largest_command"] == {"u[1]": 0.5}
    assert metrics["saturated_fraction"] > 0.1
    assert metrics["assumptions"]["limits_not_reached"] is False
    run = Trace(folder / "traces" / "tight.mcap").run
    assert run["certificate.gain"].endswith("its FMU starts with it")


def test_text_output_shows_what_was_exported(folder: Path) -> None:
    """Without --json: the file, the bound and the hash."""
    seen = cosim("fmu", "controller", "paper.json", "-o", "seen.fmu", cwd=folder)
    assert seen.code == 0
    assert "seen.fmu" in seen.out
    assert "K[i,j]" in seen.out
    assert "gamma" in seen.out


NAMES = {"my-design.v2": "my_design_v2", "2nd": "M_2nd", "class": "M_class", "__x__": "x"}


@pytest.mark.parametrize("stem", NAMES)
def test_any_file_name_gives_a_model_name(stem: str, folder: Path) -> None:
    """What FMI, C and Python take, made from what the file is called; it loads and steps."""
    reply = pack(folder, "paper.json", "-o", f"{stem}.fmu")
    assert reply["model"] == NAMES[stem]
    result = simulate_fmu(str(folder / f"{stem}.fmu"), stop_time=0.02, output_interval=0.01)
    assert len(result) == 3


REFUSED = [
    (["absent.json"], "cannot be read"),
    (["text.json"], "not JSON"),
    (["bold.json"], "the proof of this design does not hold"),
    (["open.json"], "there is no gain to pack"),
    (["paper.json", "-o", "é.fmu"], "gives no model name"),
    (["paper.json", "-o", "/proc/none/x.fmu"], "the FMU cannot be written"),
    (["paper.json", "-o", "taken"], "the output is a folder"),
    (["paper.json", "--limits", "1,2"], "the limits do not fit the controller"),
    (["paper.json", "--limits", "-1"], "the limits do not fit the controller"),
    (["paper.json", "--limits", "nan"], "the limits do not fit the controller"),
    (["paper.json", "--limits", "a"], "not a list of numbers"),
    (["paper.json", "--sample-time", "-1"], "not a sample time"),
    (["paper.json", "--sample-time", "inf"], "not a sample time"),
    (["vehicle.json", "--limits", "2500"], "the limits do not fit the controller"),
]


@pytest.mark.parametrize(("arguments", "reply"), REFUSED, ids=str)
def test_what_cannot_be_exported_is_refused(arguments: list[str], reply: str, folder: Path) -> None:
    """Exit 2, in words, and no file."""
    (folder / "text.json").write_text("{", "utf-8")
    (folder / "taken").mkdir(exist_ok=True)
    bold = json.loads((folder / "paper.json").read_text())
    bold["claim"]["gamma"] = bold["variables"]["gamma"] = "5"
    (folder / "bold.json").write_text(json.dumps(bold), "utf-8")
    (folder / "open.toml").write_text("[system]\nA = [[-1.0]]\n", "utf-8")
    assert cosim("analyse", "open.toml", "--save", "open.json", cwd=folder).code == 0
    before = set(folder.rglob("*.fmu"))
    result = cosim("fmu", "controller", *arguments, "--json", cwd=folder)
    assert result.code == 2
    assert reply in result.error["what"]
    assert set(folder.rglob("*.fmu")) == before


def test_a_controller_that_reports_its_assumptions(folder: Path) -> None:
    """Ages from the certificate, the vehicle's own envelope, or the one that is given."""
    options = ("--watch", "--flavour", "python")
    pack(folder, "vehicle.json", "-o", "watched.fmu", *options)
    model = read_model_description(str(folder / "watched.fmu"))
    start = {v.name: v.start for v in model.modelVariables}
    assert [*start][: len(SPEC.variables)] == [v.name for v in SPEC.variables]
    assert float(start["age.state"]) == 1.25
    assert float(start["envelope.eta.psi"]) == 0.35
    assert "assumption.met" in start
    pack(folder, "three.json", "-o", "three-watched.fmu", *options, "--envelope", "0,0.5,2")
    start = {
        v.name: v.start
        for v in read_model_description(str(folder / "three-watched.fmu")).modelVariables
    }
    named = {name: float(x) for name, x in start.items() if name.startswith("envelope")}
    assert named == {"envelope.x[2]": 0.5, "envelope.x[3]": 2.0}
    assert float(start["age.state"]) == 0.1
    for wrong in (("--envelope", "1,1,1"), ("--watch", "--envelope", "1,1")):
        result = cosim("fmu", "controller", "three.json", *wrong, cwd=folder)
        assert result.code == 2
        assert "--envelope" in result.err
