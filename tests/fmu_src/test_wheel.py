"""The wheel: what is prebuilt in it, and that it runs where nothing can be compiled."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import fmpy
import pefile
import pytest
from cli.shell import shared_run
from docs.page_blocks import blocks_of
from driven import drive
from fmpy.validation import validate_fmu
from fmu.packed import functions_of_fmi2
from lxml import etree
from raw_fmu import RawFmu
from shared import made_once, share_of

from cosim.fmu.export import CATALOGUE, PLATFORMS

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
PREBUILT = ROOT / "build" / "prebuilt"
"""Kept for the next build: it takes a minute to cross-compile."""


def build_wheel(folder: Path, **environment: str) -> tuple[Path, str]:
    """Build the wheel as a user does, with pip; return it and what was printed."""
    command = [sys.executable, "-m", "pip", "wheel", "--verbose", "--no-deps", "-w", str(folder)]
    if find_spec("hatchling") is not None:  # quicker, and cross-compiled things are found again
        command.append("--no-build-isolation")
    done = subprocess.run(  # noqa: S603 - pip, on our own project
        [*command, str(ROOT)],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "PIP_CONSTRAINT": str(ROOT / "constraints.txt"), **environment},
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return next(folder.glob("*.whl")), done.stdout + done.stderr


MAGIC = {
    "x86_64-linux": (b"\x7fELF", b"\x3e\x00", 18),
    "aarch64-linux": (b"\x7fELF", b"\xb7\x00", 18),
    "x86_64-darwin": (b"\xcf\xfa\xed\xfe", b"\x07\x00\x00\x01", 4),
    "aarch64-darwin": (b"\xcf\xfa\xed\xfe", b"\x0c\x00\x00\x01", 4),
    "x86_64-windows": (b"MZ", b"PE\x00\x00\x64\x86", None),
}
"""Platform -> how its binaries begin, and its machine with the place where that stands."""


@pytest.fixture(scope="module")
def package() -> Path:
    """The wheel, unpacked."""

    def unpack(folder: Path) -> None:
        wheel, _ = build_wheel(folder, AUV_COSIM_PREBUILT=str(PREBUILT))
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / "package")

    return made_once("wheel", unpack) / "package"


def installed(package: Path, cwd: Path, *words: str) -> Any:
    """What `cosim WORDS --json` of the wheel says, with no program on the path and no home."""
    done = subprocess.run(  # noqa: S603 - our own package
        [sys.executable, "-m", "cosim", *words, "--json"],
        check=False,
        capture_output=True,
        text=True,
        cwd=cwd,
        env={
            "PATH": str(cwd),
            "HOME": str(cwd / "nowhere"),
            "PYTHONPATH": str(package),
            "PYTHONDONTWRITEBYTECODE": "1",
        },
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def test_fmus_in_the_wheel_are_those_of_the_script(package: Path, tmp_path: Path) -> None:
    """Byte for byte what `build_fmu.py --platforms all` makes, with five binaries each."""
    names = share_of(sorted(CATALOGUE))
    command = [sys.executable, str(ROOT / "build_fmu.py"), *names, "--platforms", "all"]
    command += ["--flavour", "native", "--flavour", "native-fmi3", "--out", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own script
    for flavour in ("native", "native-fmi3"):
        for name in names:
            ready = package / "cosim" / "prebuilt" / flavour / f"{name}.fmu"
            assert ready.read_bytes() == (tmp_path / flavour / f"{name}.fmu").read_bytes()
        assert {p.stem for p in ready.parent.iterdir()} == set(CATALOGUE)


def test_all_platforms_in_one_file(package: Path) -> None:
    """Five binaries, each for its machine; a glibc of 2012 is enough; the one for here runs."""
    folder = package / "cosim" / "prebuilt" / "native"
    with zipfile.ZipFile(folder / "PaperController.fmu") as archive:
        for name, (magic, machine, place) in MAGIC.items():
            p = PLATFORMS[name]
            binary = archive.read(f"binaries/{p.fmi2}/PaperController{p.suffix}")
            assert binary.startswith(magic)
            if place is None:
                assert machine in binary[:1024]
            else:
                assert binary[place : place + len(machine)] == machine
            assert b"fmi2DoStep" in binary
            versions = {v for v in binary.split(b"\0") if v.startswith(b"GLIBC_2.")}
            assert {int(v.split(b".")[1]) for v in versions} <= set(range(18))
    assert set(MAGIC) == set(PLATFORMS)
    assert validate_fmu(str(folder / "PaperController.fmu")) == []
    with RawFmu(folder / "PaperController.fmu") as raw:
        assert drive(raw.initialise(), "PaperController", 0, 10)


def test_nothing_is_compiled_where_it_is_installed(package: Path, tmp_path: Path) -> None:
    """A run, with the bits of one whose FMUs a compiler made here; a study; SSP; own FMUs."""
    run = installed(package, tmp_path, "run", "paper-example")
    assert set(run["binaries"].values()) == {"prebuilt"}
    assert "the kernel" in run["binaries"]
    here = shared_run("paper-example").json
    assert "prebuilt" not in here["binaries"].values()
    assert run["content_hash"] == here["content_hash"]
    installed(package, tmp_path, "study", "run", "delay-margin")
    installed(package, tmp_path, "ssp", "export", "auv-acoustic", "--links", "fmu")
    packed = installed(package, tmp_path, "fmu", "build", "paper", "--out", "plant.fmu")
    assert installed(package, tmp_path, "fmu", "check", packed["fmu"], "--run")["valid"]
    assert not list(tmp_path.rglob("fmus"))


def test_fmus_for_a_windows_machine_as_the_page_says(package: Path, tmp_path: Path) -> None:
    """Every command of the page about Simulink; then what a Windows machine needs of each FMU."""
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / "sitecustomize.py").write_text('import sys; sys.modules["ziglang"] = None\n')
    home = tmp_path / "home"
    home.mkdir()
    environment = {
        "PATH": str(home),
        "HOME": str(home / "nowhere"),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": os.pathsep.join([str(hidden), str(package)]),
    }

    def typed(line: str) -> None:
        program, *words = shlex.split(line)
        done = subprocess.run(  # noqa: S603 - what the page tells people to type
            [sys.executable, "-m", program, *words],
            check=False,
            capture_output=True,
            text=True,
            cwd=home,
            env=environment,
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"

    blocks = [one for one in blocks_of(ROOT / "docs/how-to/simulink.md") if one.is_run]
    for line in (line for block in blocks if block.language == "sh" for line in block.commands):
        typed(line)
    schemas = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"
    schema = etree.XMLSchema(etree.parse(str(schemas)))
    names = ("AuvPlant", "HinfController", "paper_controller")
    assert {path.stem for path in home.glob("*.fmu")} == set(names)
    for name in names:
        with zipfile.ZipFile(home / f"{name}.fmu") as archive:
            schema.assertValid(etree.fromstring(archive.read("modelDescription.xml")))
            library = archive.read(f"binaries/win64/{name}.dll")
        with pefile.PE(data=library) as pe:
            assert pe.FILE_HEADER.Machine == pefile.MACHINE_TYPE["IMAGE_FILE_MACHINE_AMD64"]
            exported = {one.name.decode() for one in pe.DIRECTORY_ENTRY_EXPORT.symbols}
            needed = {one.dll.decode().lower() for one in pe.DIRECTORY_ENTRY_IMPORT}
        assert exported >= {*functions_of_fmi2()}
        assert all(re.fullmatch(r"kernel32\.dll|api-ms-win-crt-.*\.dll", one) for one in needed)
        assert validate_fmu(str(home / f"{name}.fmu")) == []
    for verb, what in (("build AuvPlant", "AuvPlant"), ("controller paper.json", names[2])):
        rate = "" if verb.startswith("build") else "--name paper_controller --sample-time 0.01"
        typed(f"cosim fmu {verb} -o all.fmu --platforms all {rate}")
        assert (home / "all.fmu").read_bytes() == (home / f"{what}.fmu").read_bytes()


def test_a_wheel_without_binaries_says_so(tmp_path: Path) -> None:
    """On request only."""
    wheel, printed = build_wheel(tmp_path, AUV_COSIM_PREBUILT="none")
    assert "this wheel has no prebuilt binaries" in printed
    with zipfile.ZipFile(wheel) as archive:
        assert not any("prebuilt/" in name for name in archive.namelist())
