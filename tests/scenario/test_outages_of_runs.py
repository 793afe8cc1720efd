"""A run across outages: link up, with the fallback, or not covered; V and its bound."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from shared import copied, fmu_store, made_once

from cosim import hinf
from cosim.core import DESIGN_FILE
from cosim.models import Delay, DelaySystem

K = [[-0.06, -0.53]]
SYSTEM = DelaySystem(
    A=[[0, 1], [0, -0.05]],
    B=[[0], [1]],
    C=[[0], [1]],
    D=[[0.1, 0], [0, 0]],
    D2=[[0], [1]],
    delays=[Delay(1.25, np.zeros((2, 2)), feedback=True, any_age=True)],
    name="axis",
)

TOML = """
[system]
name = "axis"
A = [[0.0, 1.0], [0.0, -0.05]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[0.1, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
[[system.delays]]
d = 1.25
feedback = true
any_age = true
"""

SCENARIO = """
title = "One axis over a link that drops out"
[run]
end = 60.0
step = 0.05
seed = 3
[components.plant]
fmu = "axis.fmu"
[components.controller]
fmu = "gain.fmu"
[[connections]]
from = "plant.x"
to = "controller.x"
[[connections]]
from = "controller.u"
to = "plant.u"
link = "commands"
[links.commands]
kind = "packet"
sample_time = 0.2
delay = 0.3
loss = { p_enter = 0.02, p_exit = 0.05 }
WATCHDOG
[design]
file = "gain.json"
"""


def fill(folder: Path) -> None:
    """Make a design, a plant and a controller, once per session."""
    found = hinf.synthesis.with_outages(hinf.design(SYSTEM, gain=K, order=0), alpha=0.05)
    data = DESIGN_FILE.stamped(found.to_json())
    (folder / "gain.json").write_text(json.dumps(data), "utf-8")
    (folder / "axis.toml").write_text(TOML, "utf-8")
    for words in (
        ("build", "axis.toml", "--initial", "2,0", "-o", "axis.fmu"),
        ("controller", "gain.json", "--sample-time", "0.05", "-o", "gain.fmu"),
    ):
        done = cosim("fmu", *words, cwd=folder)
        assert done.code == 0, done.out + done.err


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with design, plant and controller."""
    return copied(made_once("outages-of-runs", fill), tmp_path / "own")


def outages(folder: Path, watchdog: str, *more: str) -> dict[str, Any]:
    """The metrics of a run."""
    (folder / "s.toml").write_text(SCENARIO.replace("WATCHDOG", watchdog), "utf-8")
    words = ("run", "s.toml", "--json", "--out", "t.mcap", "--fmus", fmu_store("native"), *more)
    done = cosim(*words, cwd=folder)
    assert done.code == 0, done.out + done.err
    found: dict[str, Any] = json.loads(done.out)["metrics"]
    return found


@pytest.mark.slow
def test_with_a_watchdog_every_interval_is_covered_and_V_stays_below_its_bound(
    folder: Path,
) -> None:
    metrics = outages(folder, "greatest_age = 1.1")
    found = metrics["outages"]
    assert metrics["assumptions"]["message_age_within_design"] is False
    assert metrics["message_age_s"] <= 1.25
    assert found["uncovered_at_s"] is None
    assert 0 < found["out_s"] < 40
    assert 0.5 < found["value_ratio"] < 1.0
    assert found["value_within_bound"]
    assert found["suspensions"] >= 1


def test_a_hold_is_not_covered(folder: Path) -> None:
    metrics = outages(folder, "")
    found = metrics["outages"]
    assert metrics["message_age_s"] > 1.25
    assert found["uncovered_s"] > 1
    assert found["value_within_bound"] is None
    assert found["plain_gain_bound"] is None


def test_a_watchdog_that_comes_too_late_is_not_covered(folder: Path) -> None:
    found = outages(folder, "greatest_age = 1.9")["outages"]
    assert found["uncovered_s"] > 0
    earlier = outages(folder, "greatest_age = 1.1")["outages"]
    assert found["touch_s"] == pytest.approx(earlier["touch_s"], abs=3.0)


def test_another_value_than_zero_is_no_fallback_of_the_proof(folder: Path) -> None:
    found = outages(folder, "greatest_age = 1.1\non_age = 0.01")["outages"]
    assert found["uncovered_s"] > 1


def test_a_hold_on_age_is_refused_with_the_reason(folder: Path) -> None:
    text = SCENARIO.replace("WATCHDOG", 'greatest_age = 1.1\non_age = "hold"')
    (folder / "s.toml").write_text(text, "utf-8")
    done = cosim("scenario", "check", "s.toml", "--fmus", fmu_store("native"), cwd=folder)
    assert done.code == 2
    assert "no proof covers" in done.out
    assert "s.toml:24: links.commands.on_age" in done.out


def test_a_design_without_the_proof_is_refused_where_outages_are_asked_for(folder: Path) -> None:
    data = DESIGN_FILE.stamped(hinf.design(SYSTEM, gain=K, order=0).to_json())
    (folder / "gain.json").write_text(json.dumps(data), "utf-8")
    text = SCENARIO.replace("WATCHDOG", "") + "outages = true\n"
    (folder / "s.toml").write_text(text, "utf-8")
    done = cosim("run", "s.toml", "--fmus", fmu_store("native"), cwd=folder)
    assert done.code == 2
    assert "says nothing of outages" in done.err


def test_the_summary_says_what_was_suspended(folder: Path) -> None:
    (folder / "s.toml").write_text(SCENARIO.replace("WATCHDOG", "greatest_age = 1.1"), "utf-8")
    words = ("run", "s.toml", "--fmus", fmu_store("native"), "--out", "t.mcap")
    text = " ".join(cosim(*words, cwd=folder).out.split())
    assert "link up, needed" in text
    assert "suspended from" in text
    info = " ".join(cosim("trace", "info", "t.mcap", cwd=folder).out.split())
    assert "gamma was suspended" in info
    assert cosim("trace", "report", "t.mcap", cwd=folder).code == 0
    assert "link up, needed" in (folder / "t.html").read_text("utf-8")


@pytest.mark.slow
def test_both_engines_fall_back_at_the_same_points(folder: Path) -> None:
    """And a watchdog that never acts changes nothing: same bits as without one."""
    hashes = []
    for engine in ("python", "kernel"):
        text = SCENARIO.replace("WATCHDOG", "greatest_age = 1.1")
        (folder / "s.toml").write_text(text, "utf-8")
        words = ("run", "s.toml", "--json", "--engine", engine, "--fmus", fmu_store("native"))
        hashes.append(json.loads(cosim(*words, cwd=folder).out)["content_hash"])
    assert hashes[0] == hashes[1]
    finals = [_final(folder, watchdog) for watchdog in ("", "greatest_age = 50")]
    assert finals[0] == finals[1]
    assert finals[0] != _final(folder, "greatest_age = 1.1")


def _final(folder: Path, watchdog: str) -> Any:
    (folder / "s.toml").write_text(SCENARIO.replace("WATCHDOG", watchdog), "utf-8")
    words = ("run", "s.toml", "--json", "--out", "t.mcap", "--fmus", fmu_store("native"))
    return json.loads(cosim(*words, cwd=folder).out)["final"]
