"""Terminals and build descriptions, by the schemas of FMI 3.0 and by what they say."""

from __future__ import annotations

import shlex
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest
from c_compiler import c_compiler
from fmpy import read_model_description
from fmpy.model_description import read_build_description
from lxml import etree

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, component_module
from cosim.network import PacketLink

PATH = "terminalsAndIcons/terminalsAndIcons.xml"
SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"


def terminals(xml: bytes) -> dict[str, dict[str, str]]:
    """Name of a terminal -> member or place -> variable; valid by the schema."""
    root = etree.fromstring(xml)
    schema = etree.XMLSchema(file=str(SCHEMA))
    assert schema.validate(root), schema.error_log
    found = {}
    for terminal in root.iter("Terminal"):
        members = {
            row.get("memberName", str(place)): row.get("variableName")
            for place, row in enumerate(terminal.iter("TerminalMemberVariable"), 1)
        }
        assert terminal.get("name") not in found
        assert len(members) == len(terminal)
        found[terminal.get("name")] = members
    return found


def packed(path: Path) -> dict[str, dict[str, str]]:
    """The terminals of an FMU."""
    with zipfile.ZipFile(path) as archive:
        return terminals(archive.read(PATH))


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_flavour_has_the_terminals(
    fmus: Path, native_fmus: Path, native_fmus_of_fmi3: Path, name: str
) -> None:
    """In FMI 2.0.4 as in 3.0; each variable exists and is connected to others."""
    texts = set()
    for folder in (fmus, native_fmus, native_fmus_of_fmi3):
        with zipfile.ZipFile(folder / f"{name}.fmu") as archive:
            texts.add(archive.read(PATH))
    (xml,) = texts
    model = read_model_description(str(native_fmus / f"{name}.fmu"))
    outer = {v.name for v in model.modelVariables if v.causality in ("input", "output")}
    for members in terminals(xml).values():
        assert set(members.values()) <= outer


def test_vehicle_and_controller_match(native_fmus: Path) -> None:
    """Pose, twist and wrench: the same members, of outputs here and of inputs there."""
    ours, theirs = (packed(native_fmus / f"{name}.fmu") for name in ("AuvPlant", "HinfController"))
    assert ours["pose"] == {axis: f"eta.{axis}" for axis in ("x", "y", "z", "psi")}
    assert ours["twist"] == {axis: f"nu.{axis}" for axis in "uvwr"}
    assert set(ours["wrench"]) == {"force.x", "force.y", "force.z", "moment.z"}
    for name in ("pose", "twist", "wrench"):
        assert ours[name] == theirs[name]


def test_links_have_what_is_sent_and_received(tmp_path: Path) -> None:
    """An array of what goes in, and one of what comes out, by place."""
    link = component_module("link_channel.variables")
    lanes = [link.LinkSignal(), link.LinkSignal()]
    spec = link.packet_spec("Link", PacketLink("link", sample_time_ns=1), lanes)
    found = packed(build_fmu(spec, tmp_path, "python"))
    assert found == {"u": {"1": "u[1]", "2": "u[2]"}, "y": {"1": "y[1]", "2": "y[2]"}}


def test_options_of_a_build_belong_to_a_compiler(native_fmus_of_fmi3: Path) -> None:
    """FMI 3.0, 2.4.10: one configuration without a platform, for all that have none."""
    path = native_fmus_of_fmi3 / "AuvPlant.fmu"
    (first, *_) = read_build_description(str(path))  # validates
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read("sources/buildDescription.xml"))
        names = {n.removeprefix("sources/") for n in archive.namelist() if n.endswith(".c")}
    assert set(first.sourceFileSets[0].sourceFiles) == names
    sets = list(root.iter("SourceFileSet"))
    assert all(s.get("compiler") and s.get("language") == "C99" for s in sets)
    assert sets[0].get("compiler") == "gcc"
    assert {len(s) for s in sets} == {len(names)}
    platforms = [one.get("platform") for one in root]
    assert platforms[0] is None
    assert None not in platforms[1:]
    assert len(set(platforms)) == len(platforms)


_NOTED = """\
import os, sys
with open({noted!r}, "a") as noted:
    print(*sys.argv[1:], file=noted)
os.execvp({command!r}, [*{words!r}, *sys.argv[1:]])
"""


def test_an_fmu_is_compiled_with_the_options_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who compiles its sources as the build description says has the bits of its binary."""
    words, noted, script = c_compiler(), tmp_path / "noted", tmp_path / "noting.py"
    script.write_text(_NOTED.format(noted=str(noted), command=words[0], words=words))
    monkeypatch.setenv("CC", shlex.join([sys.executable, str(script)]))
    path = build_fmu(CATALOGUE["PaperController"], tmp_path, "native-fmi3", prebuilt=False)
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read("sources/buildDescription.xml"))
    options = next(root.iter("SourceFileSet")).get("compilerOptions", "").split()
    (used,) = noted.read_text().splitlines()
    chosen = [word for word in used.split() if word.startswith(("-std", "-O", "-f"))]
    assert chosen == [*options, "-fPIC"]
