"""A short recorded run with a scene: a vehicle led along a path over links, one of them out."""

from __future__ import annotations

from pathlib import Path

from shared import fmu_store, made_once

from cosim.scenario import run

SCENARIO = """
extends = "set-point-path"
assertions = []
[run]
end = "20 s"
[reference]
target = "controller.reference"
axes = ["x", "y", "z", "psi"]
points = [["2 s", 0.0, 0.0, 0.0, 0.0], ["15 s", "2 m", "1 m", "-1 m", "20 deg"]]
[[events]]
at = "5 s"
for = "3 s"
outage = ["uplink"]
"""


def scene_run() -> Path:
    """The trace of the run, made once for all tests."""
    return made_once("runs/scene", _recorded) / "run.mcap"


def _recorded(folder: Path) -> None:
    scenario = folder / "short-path.toml"
    scenario.write_text(SCENARIO, encoding="utf-8")
    run(scenario, folder / "run.mcap", fmus=fmu_store(), supervise=False)
