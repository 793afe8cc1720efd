"""Studies of one tiny FMU, whose every run is known in closed form.

x' = u - x by Euler steps of h from 1: x_k = u + (1 - u) (1 - h)^k.
"""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import fmpy
from benchmarks._tiny import tiny_fmu
from shared import made_once

from cosim.scenario.read import parse
from cosim.study.plan import Plan, make_plan
from cosim.study.schema import Study
from cosim.study.study_runner import BaseScenario

STEP, STEPS = 0.1, 20
SCENARIO = f"""
title = "x follows u"
[run]
end = {STEP * STEPS}
step = {STEP}
divergence = 1e9
[components.tiny]
fmu = "tiny1.fmu"
[components.tiny.parameters]
"u[1]" = 0.0
"""
U = 'components.tiny.parameters."u[1]"'
DEADLY, FAILING, SLOW = 667.0, -667.0, 100.0


def truth(u: float, k: int = STEPS) -> float:
    """x at the end."""
    return float(u + (1.0 - u) * (1.0 - STEP) ** k)


def folder() -> Path:
    """A folder with the FMU and the scenario, made once per session."""
    return made_once("deadly", _make)


def _make(path: Path) -> None:
    plain = tiny_fmu(1, path)
    source = Path(__file__).with_name("deadly.c")
    library = path / f"tiny1{fmpy.sharedLibraryExtension}"
    command = ["cc", "-O1", "-shared", "-fPIC", "-DN=1", str(source), "-o", str(library)]
    subprocess.run(command, check=True)  # noqa: S603 - our own source
    made = path / "made.fmu"
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(made, "w") as new:
        for entry in old.namelist():
            binary = entry.startswith("binaries/")
            new.writestr(entry, library.read_bytes() if binary else old.read(entry))
    shutil.move(made, plain)
    (path / "tiny.toml").write_text(SCENARIO)


def base() -> BaseScenario:
    """The scenario."""
    where = folder()
    loaded = parse(SCENARIO, name="tiny", where="tiny.toml", folder=where)
    return BaseScenario("tiny", loaded.scenario, SCENARIO, where, where / "fmus", "native")


def study(values: list[float], **more: Any) -> Study:
    """u takes these values; x at the end is measured."""
    return Study(
        **{
            "title": "x follows u",
            "scenario": "tiny.toml",
            "vary": [{"kind": "grid", "name": "u", "path": U, "values": values}],
            "metrics": {"x": "final.tiny.x[1]"},
            **more,
        }
    )


def plan(values: list[float], **more: Any) -> Plan:
    """The same, ready to be run."""
    return make_plan(study(values, **more), base())
