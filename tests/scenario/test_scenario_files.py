"""Scenarios as data: every file in `valid` runs, every file in `invalid` is refused as it says.

An invalid case begins with comments: `# exit: CODE`, and one `# expect: TEXT` per text that
must stand in the message, most with the line of the fault.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli.shell import SCENARIOS, cosim

VALID = sorted((SCENARIOS / "valid").glob("*.toml"))
INVALID = sorted((SCENARIOS / "invalid").glob("*.toml"))


@pytest.mark.parametrize("path", INVALID, ids=lambda path: path.stem)
def test_bad_scenario_is_refused_in_words(path: Path, fmus: Path, tmp_path: Path) -> None:
    """What is wrong, where, and what was expected stand in the message; nothing is left over."""
    text = path.read_text("utf-8")
    wanted = re.findall(r"^# expect: (.*)$", text, re.MULTILINE)
    code = int(re.findall(r"^# exit: (\d)$", text, re.MULTILINE)[0])
    assert wanted
    result = cosim("run", path, "--json", "--fmus", fmus.parent, "--out", "t.mcap", cwd=tmp_path)
    assert result.code == code
    message = result.error
    assert message["where"]
    assert message["expected"] or message["got"] or message["hint"] or "missing" in message["what"]
    assert "unexpected" not in message["what"]
    for words in wanted:
        assert words in result.err
    assert not (tmp_path / "t.mcap").exists()


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_good_scenario_runs_to_its_end(path: Path, fmus: Path, tmp_path: Path) -> None:
    """Every way to write a scenario that the schema offers gives a run of one second."""
    result = cosim("run", path, "--json", "--fmus", fmus.parent, "--out", "t.mcap", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["status"] == "finished"
    assert result.json["simulated_s"] == 1.0
    assert (tmp_path / result.json["trace"]).is_file()
    assert result.err == ""


def test_there_are_enough_bad_cases() -> None:
    """The folder of invalid cases has not been emptied by accident."""
    assert len(INVALID) >= 25
