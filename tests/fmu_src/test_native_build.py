"""What a build of native FMUs puts into the archive, and what it does without a compiler."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from c_compiler import c_compiler, compile_c
from driven import drive, started
from fmpy import extract, read_model_description
from fmpy.build import build_platform_binary
from fmpy.validation import validate_fmu
from shared import copied, sampled, slow_share_of

from cosim.core import InputError
from cosim.fmu.export import CATALOGUE, deterministic_zip, ensure_fmu, host
from cosim.fmu.inspect import inspect_fmu

NAMES = sorted(CATALOGUE)
ROOT = Path(__file__).resolve().parents[2]
VERSIONS = {"native": "2.0", "native-fmi3": "3.0"}


@pytest.fixture(params=VERSIONS)
def flavour(request: pytest.FixtureRequest) -> tuple[str, Path]:
    """Give each flavour with the folder of its FMUs."""
    fixture = {"native": "native_fmus", "native-fmi3": "native_fmus_of_fmi3"}[request.param]
    return request.param, request.getfixturevalue(fixture)


def description(path: Path) -> ET.Element:
    with zipfile.ZipFile(path) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))  # noqa: S314 - our own file


@pytest.mark.parametrize("name", NAMES)
def test_fmpy_validator_has_no_objections(flavour: tuple[str, Path], name: str) -> None:
    """FMPy's validator reports no problem for any FMU."""
    assert validate_fmu(str(flavour[1] / f"{name}.fmu")) == []


@pytest.mark.parametrize("name", NAMES)
def test_archive_is_whole(flavour: tuple[str, Path], name: str) -> None:
    """Binary for this machine, sources, documentation, licences; sorted, one fixed date."""
    version = VERSIONS[flavour[0]]
    with zipfile.ZipFile(flavour[1] / f"{name}.fmu") as archive:
        entries = archive.infolist()
    names = [entry.filename for entry in entries]
    assert names == sorted(names)
    assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}
    binary = f"binaries/{host().folder(version)}/{name}{host().suffix}"
    assert [n for n in names if n.startswith("binaries/")] == [binary]
    picture = "model.png" if version == "2.0" else "terminalsAndIcons/icon.png"
    assert {
        "modelDescription.xml",
        "documentation/index.html",
        "documentation/licenses/license.txt",
        "documentation/licenses/fmi-headers.txt",
        "sources/model.c",
        picture,
    } <= set(names)
    assert not any(n.endswith(".py") for n in names)


@pytest.mark.parametrize("name", NAMES)
def test_no_tool_is_needed(native_fmus: Path, native_fmus_of_fmi3: Path, name: str) -> None:
    """No tool is needed; state can be saved; steps may vary; many fit into a process."""
    of_fmi2 = description(native_fmus / f"{name}.fmu").find("CoSimulation")
    assert of_fmi2 is not None
    assert dict(of_fmi2.attrib) == {
        "modelIdentifier": name,
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    of_fmi3 = description(native_fmus_of_fmi3 / f"{name}.fmu").find("CoSimulation")
    assert of_fmi3 is not None
    flags = dict(of_fmi3.attrib)
    assert flags.pop("modelIdentifier") == name
    assert flags == {
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
        "providesAdjointDerivatives": "true",
        "canReturnEarlyAfterIntermediateUpdate": "false",
        "providesIntermediateUpdate": "false",
        "hasEventMode": "false",
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_flavour_describes_the_same_variables(
    fmus: Path, native_fmus: Path, native_fmus_of_fmi3: Path, name: str
) -> None:
    """Names, references, units, starts, bounds, dependencies: one table for all."""

    def table(path: Path) -> list[tuple[object, ...]]:
        model = read_model_description(str(path))
        direct = {
            u.variable.name: sorted(v.name for v in u.dependencies or []) for u in model.outputs
        }
        return [
            (
                v.name,
                v.valueReference,
                v.causality,
                v.variability,
                v.initial,
                v.unit,
                float(v.start),
                v.min,
                v.max,
                v.description,
                {"Float64": "Real", "Int32": "Integer"}.get(v.type, v.type),
                direct.get(v.name),
            )
            for v in model.modelVariables
            if v.causality != "independent"
        ]

    expected = table(fmus / f"{name}.fmu")
    assert table(native_fmus / f"{name}.fmu") == expected
    assert table(native_fmus_of_fmi3 / f"{name}.fmu") == expected


@pytest.mark.parametrize("name", sampled(NAMES, 1))
def test_two_builds_give_the_same_bytes(
    name: str, native_fmus: Path, native_fmus_of_fmi3: Path, tmp_path: Path
) -> None:
    """Another process, another folder, another hash seed: one SHA-256."""
    command = [sys.executable, str(ROOT / "build_fmu.py"), name, "--out", str(tmp_path)]
    command += ["--flavour", "native", "--flavour", "native-fmi3"]
    done = subprocess.run(  # noqa: S603 - our own script
        command,
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={
            "PATH": str(Path(compiler_path()).parent),
            "PYTHONPATH": str(ROOT),
            "PYTHONHASHSEED": "4711",
            "TZ": "Asia/Tokyo",
        },
    )
    for folder, kind in ((native_fmus, "native"), (native_fmus_of_fmi3, "native-fmi3")):
        built = tmp_path / kind / f"{name}.fmu"
        digest = hashlib.sha256((folder / f"{name}.fmu").read_bytes()).hexdigest()
        assert f"{digest}  {built}" in done.stdout, kind


def compiler_path() -> str:
    found = shutil.which(c_compiler()[0])
    assert found is not None
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="reads ELF by nm")
@pytest.mark.parametrize("name", NAMES)
def test_binary_shows_fmi_and_needs_libc_alone(
    flavour: tuple[str, Path], name: str, tmp_path: Path
) -> None:
    """Exported: FMI's functions; needed: those of libc and libm; no path of the build inside."""
    version = VERSIONS[flavour[0]]
    prefix = f"fmi{version[0]}"
    with zipfile.ZipFile(flavour[1] / f"{name}.fmu") as archive:
        binary = archive.extract(f"binaries/{host().folder(version)}/{name}.so", tmp_path)

    def listed(*options: str) -> str:
        return subprocess.run(  # noqa: S603
            ["nm", "-D", *options, binary],  # noqa: S607
            check=True,
            capture_output=True,
            text=True,
        ).stdout

    exported = {line.split()[-1] for line in listed("--defined-only").splitlines()}
    assert all(symbol.startswith(prefix) for symbol in exported)
    needed = {
        line.split()[-1].partition("@")[0] for line in listed("--undefined-only").splitlines()
    }
    weak = {"_ITM_deregisterTMCloneTable", "_ITM_registerTMCloneTable", "__cxa_finalize"}
    assert needed - weak - {"__gmon_start__", "__stack_chk_fail"} <= {
        *("calloc", "free", "malloc", "realloc", "memcpy", "memmove", "memset", "memcmp"),
        *("strcmp", "strncmp", "strcpy", "strncpy", "strcat", "strcspn", "strlen", "strtod"),
        *("snprintf", "vsnprintf", "frexp", "log2", "pow", "ceil", "floor"),
        *("sin", "cos", "sincos", "exp", "log", "sqrt"),
    }
    content = Path(binary).read_bytes()
    assert b"cosim-native" not in content
    versions = [int(v) for v in re.findall(rb"\0GLIBC_2\.(\d+)", content)]
    assert max(versions) <= 17
    with zipfile.ZipFile(flavour[1] / f"{name}.fmu") as archive:
        declared = archive.read(f"sources/{prefix}Functions.h").decode()
    if version == "2.0":
        exchange = declared.rfind("Functions for FMI2 for Model Exchange")
        declared = declared[:exchange] + declared[declared.rfind("FMI2 for Co-Simulation") :]
    assert exported == set(re.findall(r"_Export fmi\d\w+TYPE\s+(\w+);", declared))


@pytest.mark.parametrize("name", slow_share_of(["AuvPlant", "WaveField"]))
def test_sources_inside_compile_and_give_the_same_bits(
    flavour: tuple[str, Path], name: str, tmp_path: Path
) -> None:
    """What `fmpy compile` makes of them runs as our binary does."""
    kind, folder = flavour
    cmake = pytest.importorskip("cmake")
    inside = tmp_path / "inside"
    extract(str(folder / f"{name}.fmu"), unzipdir=str(inside))
    (tmp_path / "build").mkdir()
    shutil.rmtree(inside / "binaries")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{cmake.CMAKE_BIN_DIR}:{Path(compiler_path()).parent}")
        build_platform_binary(inside, tmp_path / "build", all_warnings=True)
    if kind == "native":
        files = {
            str(p.relative_to(inside)): p.read_bytes() for p in inside.rglob("*") if p.is_file()
        }
        deterministic_zip(files, tmp_path / f"{name}.fmu")
        with started(tmp_path, name) as compiled, started(folder, name) as ours:
            assert drive(compiled, name, 0, 40) == drive(ours, name, 0, 40)
    else:
        assert len(list(inside.glob("binaries/*/*"))) == 1


def test_no_multiplication_is_fused_with_an_addition(native_fmus: Path, tmp_path: Path) -> None:
    """Even where the machine could, and whatever options a foreign build has."""
    if host().tuple_name != "x86_64-linux":
        pytest.skip("looks at instructions of x86_64")
    with zipfile.ZipFile(native_fmus / "AuvPlant.fmu") as archive:
        (tmp_path / "arithmetic.h").write_bytes(archive.read("sources/arithmetic.h"))
    source = tmp_path / "fused.c"
    source.write_text(
        '#include "arithmetic.h"\ndouble f(double a, double b, double c) { return a * b + c; }\n'
    )
    for options in (["-O2"], ["-O3", "-std=gnu99"]):
        assembly = tmp_path / "fused.s"
        compile_c(*options, "-mfma", "-w", f"-I{tmp_path}", "-S", "-o", str(assembly), str(source))
        text = assembly.read_text()
        assert "mulsd" in text
        assert "fmadd" not in text


def test_without_a_compiler_the_error_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is missing, and two ways to get it."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(InputError, match=r"need a C compiler(.|\n)*cross") as caught:
        ensure_fmu("PaperController", tmp_path, flavour="native")
    assert caught.value.exit_code == 2
    monkeypatch.setenv("CC", "no-such-compiler -O1")
    with pytest.raises(InputError, match="CC=no-such-compiler"):
        ensure_fmu("PaperController", tmp_path, flavour="native")
    assert not list(tmp_path.rglob("*.fmu"))


def test_compiler_that_fails_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own words reach the user."""
    monkeypatch.setenv("CC", "cc -no-such-option-anywhere")
    with pytest.raises(InputError, match="no-such-option-anywhere"):
        ensure_fmu("PaperController", tmp_path, flavour="native")


def test_up_to_date_means_this_machine_too(native_fmus: Path, tmp_path: Path) -> None:
    """Left alone when the GUID fits and the binary is there; built anew otherwise."""
    root = tmp_path / "fmus"
    copied(native_fmus, root / "native")
    assert not ensure_fmu("PaperController", root, flavour="native").new
    path = root / "native" / "PaperController.fmu"
    with zipfile.ZipFile(path) as archive:
        files = {n: archive.read(n) for n in archive.namelist() if not n.startswith("binaries/")}
    deterministic_zip(files, path)
    assert ensure_fmu("PaperController", root, flavour="native").new
    assert path.read_bytes() == (native_fmus / "PaperController.fmu").read_bytes()
    changed = files["modelDescription.xml"].replace(b'guid="{', b'guid="{0')
    deterministic_zip({**files, "modelDescription.xml": changed}, path)
    assert ensure_fmu("PaperController", root, flavour="native").new


def test_guid_tells_flavours_and_components_apart(
    native_fmus: Path, native_fmus_of_fmi3: Path
) -> None:
    """It stands in the file, by which it is up to date, and no two are alike."""
    found = set()
    for kind, folder in (("native", native_fmus), ("native-fmi3", native_fmus_of_fmi3)):
        key = "guid" if kind == "native" else "instantiationToken"
        found |= {description(folder / f"{name}.fmu").attrib[key] for name in NAMES}
        for name in NAMES:
            assert not ensure_fmu(name, folder.parent, flavour=kind).new
    assert len(found) == 2 * len(NAMES)


@pytest.mark.skipif(sys.platform != "linux", reason="names a Linux machine")
@pytest.mark.parametrize(
    ("machine", "name"),
    [("x86_64", "x86_64-linux"), ("i686", "x86-linux"), ("ppc64le", "ppc64-linux")],
)
def test_host_has_the_name_that_a_slave_is_loaded_by(
    native_fmus_of_fmi3: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    machine: str,
    name: str,
) -> None:
    """The folder that a build writes is the one that FMI 3 names and the loader looks into."""
    with zipfile.ZipFile(native_fmus_of_fmi3 / "WaveField.fmu") as archive:
        files = {n: archive.read(n) for n in archive.namelist() if not n.startswith("binaries/")}
    library = {f"binaries/{name}/WaveField.so": b"\x7fELF"}
    fits = deterministic_zip({**files, **library}, tmp_path / "fits.fmu")
    none = deterministic_zip(
        {**files, "binaries/riscv64-linux/WaveField.so": b"\x7fELF"}, tmp_path / "none.fmu"
    )
    monkeypatch.setattr("platform.machine", lambda: machine)
    assert host().tuple_name == name
    assert host().folder("3.0") == name
    found = [
        [f.what for f in inspect_fmu(p).findings if f.code == "binary-here"] for p in (fits, none)
    ]
    assert found == [[], [f"no binary for {name.replace('-', ' ')}"]]
