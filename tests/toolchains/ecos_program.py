"""Ecos as a program in C++: a host with no Python in its process."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from toolchains.peer_run import EXTRA, TOOLS, installed

DIGITS = 0.5e-6  # it prints six places after the point


@dataclass(frozen=True)
class Simulated:
    """How the program ended, and its table: variable -> value at each point, the start first."""

    code: int
    output: str
    table: dict[str, NDArray[np.float64]]


def simulate(fmu: Path, step: float, end: float, folder: Path) -> Simulated:
    """Simulate one FMU with its own start values; the test is skipped without the program."""
    if not all(map(installed, TOOLS["ecos"].modules)):
        pytest.skip(f"needs ecospy and tbb: pip install auv-cosim[{EXTRA}]")
    program = folder / "ecos"
    shutil.copyfile(_packed("ecospy", "ecos"), program)
    program.chmod(0o755)
    options = ["--path", fmu, "--stepSize", step, "--stopTime", end, "--logLevel", "warn"]
    done = subprocess.run(  # noqa: S603 - a copy of the program that was installed
        [program, "simulate", *map(str, options)],
        cwd=folder,
        env={"LD_LIBRARY_PATH": str(_packed("tbb", "libtbb.so.12").parent), "HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    return Simulated(done.returncode, done.stdout + done.stderr, _table(folder / f"{fmu.stem}.csv"))


def _packed(distribution: str, name: str) -> Path:
    for file in importlib.metadata.files(distribution) or ():
        if file.name == name:
            return Path(os.fspath(file.locate()))
    pytest.skip(f"{distribution} has no {name} for this machine")


def _table(path: Path) -> dict[str, NDArray[np.float64]]:
    """Columns are named like `instance::eta.x[REAL]`."""
    if not path.exists():
        return {}
    # a name such as K[1,3] has a comma too, but no space after it
    head, *rows = (line.split(", ") for line in path.read_text("utf-8").splitlines())
    names = [name.partition("::")[2].rpartition("[")[0] or name for name in head]
    return dict(zip(names, np.array(rows, dtype=np.float64).T, strict=True))
