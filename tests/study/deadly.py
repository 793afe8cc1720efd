"""Studies of one tiny FMU, whose every run is known in closed form.

x' = u - x by Euler steps of h from 1: x_k = u + (1 - u) (1 - h)^k. Beyond |u| = 600 a run kills its
process, unless another fault is given.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hostile.hostile_fmu import hostile_fmu, misbehaviour
from shared import made_once

from cosim.scenario import LoadedScenario, parse
from cosim.study import Plan, Study, plan_of

STEP, STEPS = 0.1, 20
SCENARIO = f"""
title = "x follows u"
[run]
end = {STEP * STEPS}
step = {STEP}
divergence = 1e9
[components.tiny]
fmu = "tiny.fmu"
[components.tiny.parameters]
"""
U = "components.tiny.parameters.u"
DEADLY = 667.0
MANIFEST, RUN_LOG, RESULTS = "study.json", "journal.jsonl", "results.parquet"
"""Files in the folder of a study, as the page about studies names them."""


def truth(u: float, k: int = STEPS) -> float:
    """x at the end."""
    return float(u + (1.0 - u) * (1.0 - STEP) ** k)


def folder() -> Path:
    """A folder with the FMU and the scenario, made once per session."""
    return made_once("deadly", _make)


def _make(path: Path) -> None:
    hostile_fmu(path, "2.0", "tiny")
    (path / "tiny.toml").write_text(_scenario("kill"))


def _scenario(fault: str) -> str:
    given = {"decay": 1.0, "x0": 1.0, **misbehaviour(fault, beyond=600.0, seconds=0.002)}
    return SCENARIO + "".join(f"{name} = {value}\n" for name, value in {"u": 0.0, **given}.items())


def base(fault: str = "kill", more: str = "") -> LoadedScenario:
    """The scenario, in which a fault happens where |u| is large; `more` : at its end."""
    text = _scenario(fault) + more
    return parse(text, name="tiny", where="tiny.toml", folder=folder())


def study(values: list[float], **more: Any) -> Study:
    """u takes these values; x at the end is measured."""
    return Study(
        **{
            "title": "x follows u",
            "scenario": "tiny.toml",
            "vary": [{"kind": "grid", "name": "u", "path": U, "values": values}],
            "metrics": {"x": "final.tiny.x"},
            **more,
        }
    )


def plan(values: list[float], fault: str = "kill", **more: Any) -> Plan:
    """The same, ready to be run."""
    return planned(study(values, **more), base(fault))


def planned(asked: Study, of: LoadedScenario) -> Plan:
    """A study of such a scenario, ready to be run."""
    return plan_of(asked, of, fmus=folder() / "fmus", flavour="native")
