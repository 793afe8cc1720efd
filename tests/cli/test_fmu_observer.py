"""`cosim fmu controller` of an output feedback: its doubles, its proof, and what differs."""

from __future__ import annotations

import html
import json
import re
import zipfile
from pathlib import Path

import pytest
from cli.shell import cosim
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from cosim.fmu import build_fmu
from cosim.fmu.export import component_module, deterministic_zip
from cosim.hinf import analyse
from cosim.hinf.certificate import (
    certificate_bytes,
    output_feedback_to_json,
    pair_of,
    system_from_json,
)
from cosim.models import Delay, DelaySystem, Measurement
from cosim.trace import Trace


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A proved pair: an axis with late damping, a late position and a fresh speed."""
    axis = DelaySystem(
        A=[[0, 1], [0, -0.1]], B=[[0], [1]], delays=[Delay(0.5, [[0, 0], [0, -0.05]])], name="axis"
    )
    fix = Measurement("fix", [[1, 0]], 1.25, any_age=True)
    speed = Measurement("speed", [[0, 1]], 0.25, any_age=True, over="onboard")
    pair = pair_of(axis, [fix, speed], [[-0.06, -0.53]], [[[0.2], [0.01]], [[0.1], [0.4]]])
    found = analyse(pair.system, pair.gain)
    place = tmp_path_factory.mktemp("pair")
    whole = output_feedback_to_json(pair, dict(found.certificate))
    (place / "pair.json").write_text(json.dumps(whole), "utf-8")
    return place


def test_the_pair_is_packed_with_its_proof(folder: Path) -> None:
    """Every start value is the certificate's; its proof holds in place, in whole and alone."""
    saved = json.loads((folder / "pair.json").read_text())
    for name, more, form in (
        ("pair", ("--limits", "2"), "output-feedback"),
        ("alone", ("--observer",), "observer"),
    ):
        options = ("--flavour", "python", "--json")  # no compiler is waited for
        result = cosim(
            "fmu", "controller", "pair.json", "-o", f"{name}.fmu", *more, *options, cwd=folder
        )
        assert result.code == 0, result.err
        assert result.json["form"] == form
        fmu = folder / f"{name}.fmu"
        assert validate_fmu(str(fmu)) == []
        start = {v.name: v.start for v in read_model_description(str(fmu)).modelVariables}
        for i in (1, 2):
            assert float(start[f"L.fix[{i},1]"]) == saved["L"][0][i - 1][0]
            assert float(start[f"A1[2,{i}]"]) == saved["plant"]["delays"][0]["A"][1][i - 1]
        assert ("K[1,1]" in start) == (form == "output-feedback")
        assert float(start["age.fix"]) == 1.25
        with zipfile.ZipFile(fmu) as archive:
            assert archive.read("resources/certificate.json") == certificate_bytes(saved)
            page = archive.read("documentation/index.html").decode()
        assert "measurement fix of any age up to d = 1.25 s" in page
        checked = cosim("certificate", "check", fmu, "--json", cwd=folder)
        assert checked.code == 0, checked.err
        assert checked.json["system"]["name"] == "axis"


@pytest.mark.slow
def test_the_example_of_the_page_runs(folder: Path) -> None:
    """Plant, sensors, link and observer: no watchdog, every assumption met, and it settles."""
    data = json.loads((folder / "pair.json").read_text())
    plant = component_module("delayed_plant.variables").delayed_plant_spec
    build_fmu(plant(system_from_json(data["plant"]), name="plant"), folder, "python")
    options = ("-o", "loop.fmu", "--flavour", "python")
    assert cosim("fmu", "controller", "pair.json", *options, cwd=folder).code == 0
    with zipfile.ZipFile(folder / "loop.fmu") as archive:
        page = archive.read("documentation/index.html").decode()
    found = re.search(r'<code class="language-toml">(.*?)</code>', page, re.DOTALL)
    assert found is not None
    text = html.unescape(found[1]).replace("end = 20.0", "end = 60.0")
    (folder / "loop.toml").write_text(text, "utf-8")
    result = cosim("run", "loop.toml", "--json", cwd=folder)
    assert result.code == 0, result.err
    run = Trace(folder / "traces" / "loop.mcap")
    last = {
        name: run.signal(f"controller.{name}").values[-1] for name in ("assumption.met", "watchdog")
    }
    assert last == {"assumption.met": 1, "watchdog": 0}
    x = run.signal("plant.x[1]").values
    assert x[0] == 1.0
    assert abs(x[-1]) < 0.3
    assert abs(run.signal("controller.estimate[1]").values[-1] - x[-1]) < 0.05


@pytest.mark.parametrize(
    "name", ["K[1,2]", "L.fix[1,1]", "C.speed[1,2]", "A[1,2]", "A1[2,2]", "B[2,1]", "delay.d"]
)
def test_another_start_value_is_no_longer_certified(name: str, folder: Path) -> None:
    """Gain, injections or model: the check says which one differs."""
    if not (folder / "once.fmu").exists():
        options = ("-o", "once.fmu", "--flavour", "python")
        assert cosim("fmu", "controller", "pair.json", *options, cwd=folder).code == 0
    with zipfile.ZipFile(folder / "once.fmu") as archive:
        files = {entry: archive.read(entry) for entry in archive.namelist()}
    text = files["modelDescription.xml"].decode()
    begin = text.index('start="', text.index(f'name="{name}"')) + len('start="')
    changed = f"{text[:begin]}0.1234{text[text.index(chr(34), begin) :]}"
    files["modelDescription.xml"] = changed.encode()
    deterministic_zip(files, folder / "changed.fmu")
    checked = cosim("certificate", "check", "changed.fmu", cwd=folder)
    assert checked.code == 1
    assert f"{name} of the FMU is 0.1234" in checked.out.replace("\n", " ")


def test_what_cannot_be_packed_is_refused(folder: Path) -> None:
    """A proof that does not hold; and the observer of a design without one."""
    data = json.loads((folder / "pair.json").read_text())
    data["L"][0][0][0] = 0.3
    (folder / "other.json").write_text(json.dumps(data), "utf-8")
    result = cosim("fmu", "controller", "other.json", cwd=folder)
    assert result.code == 2
    assert "does not hold" in result.err
    assert cosim("design", "paper", "--save", "paper.json", cwd=folder).code == 0
    result = cosim("fmu", "controller", "paper.json", "--observer", cwd=folder)
    assert result.code == 2
    assert "there is no observer to pack" in result.err
