"""What a build puts into an FMU: the same bytes, a valid description, units, dependencies."""

from __future__ import annotations

import dataclasses
import hashlib
import subprocess
import sys
import zipfile
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, UNITS, Variable, ensure_fmu

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cosim.fmu.export import ComponentSpec

NAMES = sorted(CATALOGUE)
PAPER = CATALOGUE["PaperController"]
ROOT = Path(__file__).resolve().parents[2]

# What each unit is made of, spelled out a second time: force = mass length / time^2, ...
KG, M, S, RAD = "kg", "m", "s", "rad"
FACTORS: Mapping[str, tuple[list[str], list[str]]] = MappingProxyType(
    {
        "m": ([M], []),
        "m/s": ([M], [S]),
        "m/s2": ([M], [S, S]),
        "rad": ([RAD], []),
        "rad/s": ([RAD], [S]),
        "rad/s2": ([RAD], [S, S]),
        "rad/m": ([RAD], [M]),
        "1/s": ([], [S]),
        "s": ([S], []),
        "kg": ([KG], []),
        "kg.m": ([KG, M], []),
        "kg.m2": ([KG, M, M], []),
        "kg/m3": ([KG], [M, M, M]),
        "kg/m": ([KG], [M]),
        "kg/s": ([KG], [S]),
        "kg.m/s": ([KG, M], [S]),
        "kg.m2/s": ([KG, M, M], [S]),
        "m2": ([M, M], []),
        "s/m": ([S], [M]),
        "N": ([KG, M], [S, S]),
        "N.m": ([KG, M, M], [S, S]),
    }
)


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def description(path: Path) -> ET.Element:
    with zipfile.ZipFile(path) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))  # noqa: S314 - our own file


@pytest.mark.parametrize("name", NAMES)
def test_fmpy_validator_has_no_objections(fmus: Path, name: str) -> None:
    """FMPy's validator reports no problem for any FMU."""
    assert validate_fmu(str(fmus / f"{name}.fmu")) == []


def test_two_builds_give_the_same_bytes(fmus: Path, tmp_path: Path) -> None:
    """Another process, another folder, another hash seed: one SHA-256."""
    command = [sys.executable, str(ROOT / "build_fmu.py"), "--out", str(tmp_path)]
    command += ["--flavour", "python"]
    done = subprocess.run(  # noqa: S603 - our own script
        command,
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "4711", "TZ": "Asia/Tokyo"},
    )
    for name in NAMES:
        built = tmp_path / "python" / f"{name}.fmu"
        assert sha256(built) == sha256(fmus / f"{name}.fmu"), name
        assert f"{sha256(built)}  {built}" in done.stdout


def test_unknown_component_is_refused(tmp_path: Path) -> None:
    """The builder names what exists and leaves with 2."""
    command = [sys.executable, str(ROOT / "build_fmu.py"), "Submarine", "--out", str(tmp_path)]
    done = subprocess.run(  # noqa: S603 - our own script
        command, check=False, capture_output=True, text=True, env={"PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 2
    assert "Submarine" in done.stderr
    assert "AuvPlant" in done.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("name", NAMES)
def test_capabilities_are_declared(fmus: Path, name: str) -> None:
    """A Python host is needed; steps may vary; state can be saved; many fit into a process."""
    element = description(fmus / f"{name}.fmu").find("CoSimulation")
    assert element is not None
    flags = dict(element.attrib)
    assert flags.pop("modelIdentifier") == name
    assert flags == {
        "needsExecutionTool": "true",
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_output_states_its_dependencies(fmus: Path, name: str) -> None:
    """All outputs are listed; only z of DelayedPlant depends on inputs, on all of them."""
    root = description(fmus / f"{name}.fmu")
    variables = list(root.iter("ScalarVariable"))
    listed = {}
    for unknown in root.findall("./ModelStructure/Outputs/Unknown"):
        at = variables[int(unknown.attrib["index"]) - 1].attrib["name"]
        places = unknown.attrib["dependencies"].split()
        assert len(unknown.attrib["dependenciesKind"].split()) == len(places)
        listed[at] = [variables[int(place) - 1].attrib["name"] for place in places]
    outputs = [v.attrib["name"] for v in variables if v.attrib["causality"] == "output"]
    assert sorted(listed) == sorted(outputs)
    for output, inputs in listed.items():
        assert inputs == (["u[1]", "w[1]"] if output.startswith("z[") else []), output


@pytest.mark.parametrize("name", NAMES)
def test_outputs_are_exact_with_a_start(fmus: Path, name: str) -> None:
    """Importers need not guess: initial is written, with a start, except where FMI forbids it."""
    for variable in description(fmus / f"{name}.fmu").iter("ScalarVariable"):
        causality = variable.attrib["causality"]
        assert variable.attrib.get("initial") == (None if causality == "input" else "exact")
        assert "start" in variable[0].attrib
        assert variable.attrib["description"]


@pytest.mark.parametrize("name", NAMES)
def test_units_have_the_right_base_exponents(fmus: Path, name: str) -> None:
    """Each unit used is defined, and its exponents multiply out of its factors."""
    root = description(fmus / f"{name}.fmu")
    defined = {}
    for unit in root.findall("./UnitDefinitions/Unit"):
        base = unit.find("BaseUnit")
        assert base is not None
        defined[unit.attrib["name"]] = {k: int(v) for k, v in base.attrib.items()}
    used = {v[0].attrib["unit"] for v in root.iter("ScalarVariable") if "unit" in v[0].attrib}
    assert set(defined) == used
    for unit, exponents in defined.items():
        above, below = FACTORS[unit]
        total: dict[str, int] = {}
        for factors, sign in ((above, 1), (below, -1)):
            for symbol in factors:
                total[symbol] = total.get(symbol, 0) + sign
        assert exponents == total, unit


def test_every_unit_is_checked() -> None:
    """The table above has every unit."""
    assert set(FACTORS) == set(UNITS)


@pytest.mark.parametrize("name", NAMES)
def test_archive_is_plain_and_sorted(fmus: Path, name: str) -> None:
    """Sorted names, one fixed date, forward slashes, documentation and licence inside."""
    with zipfile.ZipFile(fmus / f"{name}.fmu") as archive:
        entries = archive.infolist()
        page = archive.read("documentation/index.html").decode()
    names = [entry.filename for entry in entries]
    assert names == sorted(names)
    assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}
    assert not any(
        "\\" in entry or entry.endswith("/") or "__pycache__" in entry for entry in names
    )
    assert {"modelDescription.xml", "documentation/licenses/license.txt"} <= set(names)
    for variable in read_model_description(str(fmus / f"{name}.fmu")).modelVariables:
        # in a table, or in its place in a matrix
        assert f">{variable.name}<" in page or f'title="{variable.name} = ' in page


@pytest.mark.parametrize("name", NAMES)
def test_nothing_inside_needs_numpy_or_this_project(fmus: Path, name: str) -> None:
    """No module of the FMU imports numpy or cosim where it would run."""
    with zipfile.ZipFile(fmus / f"{name}.fmu") as archive:
        for entry in archive.namelist():
            if entry.endswith(".py") and not entry.startswith("resources/pythonfmu/"):
                for line in archive.read(entry).decode().splitlines():
                    assert not line.startswith(
                        ("import numpy", "from numpy", "import cosim", "from cosim")
                    ), (entry, line)


def changed() -> list[Any]:
    """Every way to change a specification, one at a time."""
    spec = CATALOGUE["DelayedPlant"]
    first, *rest = spec.variables
    some = {
        "description": dataclasses.replace(spec, description="something else"),
        "step_size": dataclasses.replace(spec, step_size=0.02),
        "stop_time": dataclasses.replace(spec, stop_time=11.0),
        "constants": dataclasses.replace(spec, constants={**spec.constants, "more": 1}),
        "sources": dataclasses.replace(spec, sources=(*spec.sources, "cosim.models.auv")),
        "readme": dataclasses.replace(spec, readme=CATALOGUE["AuvPlant"].readme),
        "certificate": dataclasses.replace(spec, certificate=PAPER.certificate),
    }
    different: dict[str, Any] = {
        "unit": "m",
        "start": 1.5,
        "description": "else",
        "discrete": True,
        "minimum": -1.0,
        "maximum": 1.0,
    }
    for attribute, value in different.items():
        variable = dataclasses.replace(first, **{attribute: value})
        some[f"variable {attribute}"] = dataclasses.replace(spec, variables=(variable, *rest))
    extra = Variable("more", "parameter", "one more")
    some["one more variable"] = dataclasses.replace(spec, variables=(*spec.variables, extra))
    return [pytest.param(value, id=key) for key, value in some.items()]


def guid_of(spec: ComponentSpec, folder: Path) -> str:
    """The GUID of the FMU that is built of a component now."""
    return description(build_fmu(spec, folder, "python")).attrib["guid"]


@pytest.mark.parametrize("spec", changed())
def test_guid_changes_with_the_specification(
    spec: ComponentSpec, fmus: Path, tmp_path: Path
) -> None:
    """Whatever of a component changes, its GUID does."""
    assert guid_of(spec, tmp_path) != description(fmus / "DelayedPlant.fmu").attrib["guid"]


def test_guid_changes_with_one_byte_of_the_certificate(fmus: Path, tmp_path: Path) -> None:
    """The proof is part of the FMU, down to the last digit."""
    assert PAPER.certificate is not None
    other = dataclasses.replace(PAPER, certificate=PAPER.certificate.replace(b"8", b"9", 1))
    assert guid_of(other, tmp_path) != description(fmus / "PaperController.fmu").attrib["guid"]


def test_guid_changes_with_a_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One byte in a module that runs inside is enough; so is the version of PythonFMU."""
    monkeypatch.syspath_prepend(tmp_path)
    module = tmp_path / "one_more_module.py"
    plant = CATALOGUE["AuvPlant"]
    spec = dataclasses.replace(plant, sources=(*plant.sources, module.stem))
    module.write_text("ONE = 1\n")
    before = guid_of(spec, tmp_path)
    assert guid_of(spec, tmp_path) == before
    module.write_text("ONE = 2\n")
    assert guid_of(spec, tmp_path) != before
    module.write_text("ONE = 1\n")
    monkeypatch.setattr("importlib.metadata.version", lambda _name: "0.0")
    assert guid_of(spec, tmp_path) != before


def test_guid_changes_with_what_is_generated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The joining script and the units are part of the FMU, so they are part of the hash."""
    monkeypatch.syspath_prepend(tmp_path)
    plant = CATALOGUE["AuvPlant"]
    home, name = plant.slave.split(":")
    text = (
        f"from {home} import {name}\n\nclass One({name}):\n    pass\n\nclass Two(One):\n    pass\n"
    )
    (tmp_path / "two_slaves.py").write_text(text)
    # only the script names the one that is joined to the behaviour
    one, two = (dataclasses.replace(plant, slave=f"two_slaves:{it}") for it in ("One", "Two"))
    before = guid_of(one, tmp_path)
    assert guid_of(two, tmp_path) != before
    assert guid_of(one, tmp_path) == before
    monkeypatch.setitem(UNITS["m"], "m", 2)
    assert guid_of(one, tmp_path) != before


def test_guid_is_well_formed_and_in_the_file(fmus: Path) -> None:
    """The file's GUID is the component's, {8-4-4-4-12} hexadecimal digits."""
    for name in NAMES:
        assert not ensure_fmu(name, fmus.parent, flavour="python").new
        guid = description(fmus / f"{name}.fmu").attrib["guid"]
        assert [len(part) for part in guid.strip("{}").split("-")] == [8, 4, 4, 4, 12]
        assert int(guid.strip("{}").replace("-", ""), 16)


def test_only_what_is_out_of_date_is_built(tmp_path: Path) -> None:
    """A second call leaves the file alone; a damaged or foreign file is replaced."""
    built = ensure_fmu("WaveField", tmp_path)
    assert built.new
    good = built.path.read_bytes()
    assert not ensure_fmu("WaveField", tmp_path).new
    built.path.write_bytes(good[: len(good) // 2])
    assert ensure_fmu("WaveField", tmp_path).new
    assert built.path.read_bytes() == good
    other = ensure_fmu("PaperController", tmp_path)
    built.path.write_bytes(other.path.read_bytes())
    assert ensure_fmu("WaveField", tmp_path).new
    assert built.path.read_bytes() == good
    assert sorted(p.name for p in built.path.parent.iterdir()) == [
        "PaperController.fmu",
        "WaveField.fmu",
    ]


def test_building_leaves_sys_path_and_modules_unchanged(tmp_path: Path) -> None:
    """The builder imports the module that it builds; both are as before afterwards."""
    path, modules = list(sys.path), set(sys.modules)
    ensure_fmu("AuvPlant", tmp_path)
    assert sys.path == path
    assert not [m for m in set(sys.modules) - modules if m.startswith("AuvPlant")]


def test_wrong_tables_are_refused() -> None:
    """A name twice, or a dependency on what is no input, is said when the table is made."""
    spec = CATALOGUE["AuvPlant"]
    with pytest.raises(ValueError, match=r"named twice: force\.x"):
        dataclasses.replace(spec, variables=(*spec.variables, spec.variables[0]))
    loose = Variable("y", "output", "an output", depends_on=("eta.x",))
    with pytest.raises(ValueError, match="not inputs"):
        dataclasses.replace(spec, variables=(*spec.variables, loose))


_RUN_BEFORE = """
import sys
from pathlib import Path
import fmpy
fmpy.simulate_fmu("PaperController.fmu", stop_time=0.1)
import pythonfmu
assert not Path(pythonfmu.__file__).is_relative_to(sys.prefix), pythonfmu.__file__
from cosim import build_fmu
path = list(sys.path)
build_fmu("PaperController", Path("again"), flavour="python", prebuilt=False)
assert sys.path == path and sys.modules["pythonfmu"] is pythonfmu
"""


def test_a_build_does_not_depend_on_what_ran_before(tmp_path: Path) -> None:
    """An FMU flown in the same process brings a PythonFMU of its own, without binaries."""
    first = build_fmu("PaperController", tmp_path, flavour="python", prebuilt=False)
    subprocess.run([sys.executable, "-c", _RUN_BEFORE], cwd=tmp_path, check=True)  # noqa: S603
    assert (tmp_path / "again" / first.name).read_bytes() == first.read_bytes()
