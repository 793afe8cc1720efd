"""A scenario without [design] has the design of its controller's FMU, or is told why not."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import pytest
from cli.shell import cosim

from cosim.fmu.export import FmuTarget, export_controller, export_plant
from cosim.hinf import design, system_by_name
from cosim.scenario import FmuCache, PreparedScenario, load, prepare

SYSTEM = """
[system]
A = [[0.0, 1.0], [1.0, 0.0]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
[[system.delays]]
d = 0.1
feedback = true
any_age = true
"""
LOOP = """
title = "my own"
connect = ["plant.x -> controller.x", "controller.u -> plant.u"]
[run]
end = 0.5
step = 0.01
[components.plant]
fmu = "plant.fmu"
parameters = { "initial.x[1]" = 0.1 }
[components.controller]
fmu = "controller.fmu"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plant and its controller, as `cosim fmu` makes them."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "system.toml").write_text(SYSTEM, "utf-8")
    found = design(system_by_name(str(folder / "system.toml")).system, order=None)
    kind = FmuTarget("python", ())
    export_plant(str(folder / "system.toml"), folder / "plant.fmu", kind=kind)
    export_controller(found.certificate, folder / "controller.fmu", where="test", kind=kind)
    return folder


def prepared(folder: Path, text: str, *settings: str) -> PreparedScenario:
    """Prepare a scenario of the folder."""
    (folder / "loop.toml").write_text(text, "utf-8")
    loaded = load(str(folder / "loop.toml"), settings)
    return prepare(loaded, FmuCache(root=folder / "fmus", folder=loaded.folder))


def test_the_certificate_in_the_controller_counts(folder: Path) -> None:
    """A run without [design] is judged by it, its trace has it, and is run again like any other."""
    (folder / "loop.toml").write_text(LOOP, "utf-8")
    ran = cosim("run", "loop.toml", "--json", cwd=folder)
    assert ran.code == 0, ran.err
    assumptions = ran.json["metrics"]["assumptions"]
    assert assumptions.pop("message_age_within_design") is True
    assert "certificate_verified" in assumptions
    assert all(assumptions.values()), ran.json["metrics"]["departures"]
    named = "[design]\nfile = 'controller.fmu'"
    again = cosim("run", "loop.toml", "--json", "--set", "design.file=controller.fmu", cwd=folder)
    assert again.json["metrics"] == ran.json["metrics"], named
    assert again.json["content_hash"] == ran.json["content_hash"]
    trace = folder / "traces" / "loop.mcap"
    assert cosim("certificate", "check", trace, "--system", "system.toml", cwd=folder).code == 0
    moved = folder / "elsewhere"
    moved.mkdir()
    rerun = cosim("trace", "rerun", trace, "--fmus", folder, cwd=moved)
    assert rerun.code == 0, rerun.err


REASONS = {
    "another gain": ('fmu = "controller.fmu"', '\\g\nparameters = { "K[1,1]" = -2.0 }', "K[1,1]"),
    "no plant": (', "controller.u -> plant.u"', "", "no component follows it"),
    "two certificates": (
        "[components.controller]",
        '[components.spare]\nfmu = "controller.fmu"\n[components.controller]',
        "[design] file",
    ),
}


@pytest.mark.parametrize("reason", REASONS)
def test_a_certificate_that_does_not_count_says_why(reason: str, folder: Path) -> None:
    """The run goes on without a guarantee, and says what to write, or what is in the way."""
    old, new, words = REASONS[reason]
    assert old in LOOP
    found = prepared(folder, LOOP.replace(old, new.replace("\\g", old)))
    assert found.design is None
    assert found.source is not None
    assert words in found.source.words


def test_a_tampered_certificate_guarantees_nothing(folder: Path, tmp_path: Path) -> None:
    """Its proof is checked; named by [design] file it is refused."""
    shutil.copy(folder / "plant.fmu", tmp_path)
    with (
        zipfile.ZipFile(folder / "controller.fmu") as old,
        zipfile.ZipFile(tmp_path / "controller.fmu", "w") as new,
    ):
        for entry in old.namelist():
            content = old.read(entry)
            if entry == "resources/certificate.json":
                content = content.replace(b'"d":0.1', b'"d":9.1')
            new.writestr(entry, content)
    found = prepared(tmp_path, LOOP)
    assert found.design is None
    assert "does not count here" in str(found.source)
    (tmp_path / "named.toml").write_text(LOOP + '[design]\nfile = "controller.fmu"\n', "utf-8")
    refused = cosim("scenario", "check", "named.toml", cwd=tmp_path)
    assert refused.code == 2
    assert "proof of this design does not hold" in refused.out


def test_a_plant_without_certificate_is_no_design(folder: Path) -> None:
    """The FMU named in [design] has none: where it comes from is in the hint."""
    (folder / "named.toml").write_text(LOOP + '[design]\nfile = "plant.fmu"\n', "utf-8")
    refused = cosim("run", "named.toml", "--json", cwd=folder)
    assert "carries no certificate" in refused.error["what"]
    assert "cosim fmu controller" in refused.error["hint"]
