"""The wheel: what is prebuilt in it, and that it runs where nothing can be compiled."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
from cli.shell import shared_run
from shared import made_once, share_of

from cosim.fmu import CATALOGUE, PLATFORMS

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[1]
PREBUILT = ROOT / "build" / "prebuilt"
"""Kept for the next build: it takes a minute to cross-compile."""


def build_wheel(folder: Path, **environment: str) -> tuple[Path, str]:
    """Build the wheel as a user does, with pip; return it and what was printed."""
    command = [sys.executable, "-m", "pip", "wheel", "--verbose", "--no-deps", "-w", str(folder)]
    done = subprocess.run(  # noqa: S603 - pip, on our own project
        [*command, str(ROOT)],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "PIP_CONSTRAINT": str(ROOT / "constraints.txt"), **environment},
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return next(folder.glob("*.whl")), done.stdout + done.stderr


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
    names = ["PaperController", *share_of(sorted(set(CATALOGUE) - {"PaperController"}))]
    command = [sys.executable, str(ROOT / "build_fmu.py"), *names, "--platforms", "all"]
    command += ["--flavour", "native", "--flavour", "native-fmi3", "--out", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own script
    for flavour in ("native", "native-fmi3"):
        for name in names:
            ready = package / "cosim" / "prebuilt" / flavour / f"{name}.fmu"
            assert ready.read_bytes() == (tmp_path / flavour / f"{name}.fmu").read_bytes()
            with zipfile.ZipFile(ready) as archive:
                binaries = [n for n in archive.namelist() if n.startswith("binaries/")]
            assert len(binaries) == len(PLATFORMS)
        assert {p.stem for p in ready.parent.iterdir()} == set(CATALOGUE)


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


def test_a_wheel_without_binaries_says_so(tmp_path: Path) -> None:
    """On request only."""
    wheel, printed = build_wheel(tmp_path, AUV_COSIM_PREBUILT="none")
    assert "this wheel has no prebuilt binaries" in printed
    with zipfile.ZipFile(wheel) as archive:
        assert not any("prebuilt/" in name for name in archive.namelist())
