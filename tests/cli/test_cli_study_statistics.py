"""What a user reads of a study that stops at a width, and of one of a rare event."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim
from study.deadly import folder

from cosim.study import RareEstimate

STUDY = """
title = "x follows u"
scenario = "{scenario}"
samples = 100
{more}
[[vary]]
kind = "random"
name = "u"
path = "components.tiny.parameters.u"
normal = [0.0, 1.0]
[metrics]
x = "final.tiny.x"
"""


def written(path: Path, more: str) -> None:
    """A study file with another line."""
    text = STUDY.format(scenario=folder() / "tiny.toml", more=more)
    (path / "follows.toml").write_text(text)


def test_what_was_reached_is_printed_with_the_number_of_runs(tmp_path: Path) -> None:
    """Before it runs, too: at most so many."""
    written(tmp_path, 'stop = { metric = "x", width = 0.9, first = 20 }')
    assert "at most 100 runs" in cosim("study", "check", "follows.toml", cwd=tmp_path).out
    done = cosim("study", "run", "follows.toml", "--json", cwd=tmp_path).json
    assert done["runs"] < 100
    found = cosim("study", "show", "studies/follows", "--json", cwd=tmp_path).json
    assert found["complete"] is True
    stop = found["stop"]
    assert (stop["reached"], stop["runs"], stop["confidence"]) == (True, done["runs"], 0.95)
    assert stop["high"] - stop["low"] <= 0.9
    seen = cosim("study", "show", "studies/follows", cwd=tmp_path).out
    assert f"stopped after {done['runs']} of at most 100 runs" in seen


@pytest.mark.slow
def test_the_probability_is_printed_with_its_levels(tmp_path: Path) -> None:
    """Interval, coefficient of variation, and the column that tells levels apart."""
    written(tmp_path, 'rare = { metric = "x", above = 2.0 }')
    assert "at least 100 runs" in cosim("study", "check", "follows.toml", cwd=tmp_path).out
    cosim("study", "run", "follows.toml", cwd=tmp_path)
    found = cosim("study", "show", "studies/follows", "--json", cwd=tmp_path).json
    rare = found["rare"]
    assert rare["low"] < rare["probability"] < rare["high"]
    assert found["runs"] == 100 < rare["runs"]
    seen = cosim("study", "show", "studies/follows", cwd=tmp_path).out
    for words in ("P(x > 2) = ", "coefficient of variation", "moves accepted", "first level"):
        assert words in seen
    late = str(rare["runs"] - 1)
    assert cosim("study", "repeat", "follows.toml", late, cwd=tmp_path).code == 0
    refused = cosim("study", "run", "follows.toml", "--runs", "0:9", "--json", cwd=tmp_path)
    assert "follow from the results" in refused.error["what"]


def test_an_estimate_that_does_not_exist_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, 'rare = { metric = "x", above = 0.1 }')
    cosim("study", "run", "follows.toml", cwd=tmp_path)
    none = RareEstimate(None, None, 0.0, 1.0, (), reason="too few")
    monkeypatch.setattr("cosim.study.rare_estimate", lambda *_: none)
    seen = cosim("study", "show", "studies/follows", cwd=tmp_path)
    assert "no estimate; too few" in seen.out
    found = cosim("study", "show", "studies/follows", "--json", cwd=tmp_path).json["rare"]
    assert (found["probability"], found["reason"]) == (None, "too few")
