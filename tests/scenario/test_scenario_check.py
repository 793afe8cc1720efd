"""`cosim scenario check` reports every error of a file with its place, and runs nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli.shell import BUILT_IN, SCENARIOS, cosim

VALID = sorted((SCENARIOS / "valid").glob("*.toml"))
INVALID = sorted((SCENARIOS / "invalid").glob("*.toml"))
ONLY_AT_RUN_TIME = {
    # what an FMU itself refuses, or what only a design or a log category shows
    "design-of-another-controller",
    "design-unstabilizing-gain",
    "design-gain-wrong-shape",
    "design-k2-zero",
    "design-k1-too-many",
    "log-category-unknown",
    "parameter-is-an-output",
    "connection-policy-over-packets",
    "connection-midpoint-on-a-wire",
}
CHECKED = [path for path in INVALID if path.stem not in ONLY_AT_RUN_TIME]


@pytest.mark.parametrize("path", CHECKED, ids=lambda path: path.stem)
def test_check_reports_the_message_of_run(path: Path, fmus: Path, tmp_path: Path) -> None:
    """The message with which `run` refuses is among the problems; each has a place."""
    text = path.read_text("utf-8")
    wanted = re.findall(r"^# expect: (.*)$", text, re.MULTILINE)
    result = cosim("scenario", "check", path, "--fmus", fmus.parent, cwd=tmp_path)
    assert result.code == 2
    assert "Traceback" not in result.out + result.err
    for words in wanted:
        assert words in result.out, result.out
    assert f"{path}: " in result.out.splitlines()[0]


@pytest.mark.parametrize("name", BUILT_IN)
def test_builtin_scenarios_pass_the_check(name: str, fmus: Path, tmp_path: Path) -> None:
    """Every built-in scenario is ok."""
    result = cosim("scenario", "check", name, "--fmus", fmus.parent, "--json", cwd=tmp_path)
    assert result.code == 0
    rows = [{"scenario": name, "ok": True, "problems": []}]
    assert result.json == {"answer": f"{name}: ok", "scenarios": rows}


def test_all_good_files_at_once(fmus: Path, tmp_path: Path) -> None:
    """Many files, one verdict each."""
    result = cosim("scenario", "check", *VALID, "--fmus", fmus.parent, "--json", cwd=tmp_path)
    assert result.code == 0, result.out
    assert [row["ok"] for row in result.json["scenarios"]] == [True] * len(VALID)


FAULTS = """\
title = "Seven faults"

[run]
end = 1.0
step = 0.1

[components.plant]
fmu = "AuvPlant"
parameters = { "initial.eta.x" = "5 s", masss = 1.0 }

[components.controller]
fmu = "HinfController"

[[connections]]
from = "plant.etta"
to = "controller.eta"

[[connections]]
from = "plant.eta.x"
to = "controller.nu.u"

[[events]]
at = 2.0
stop = true

[[events]]
when = "plant.eta.q > 1"
override = { "plant.mass" = 1.0 }

[[assertions]]
always = "plant.eta.x < 1 s"
"""


def test_every_fault_is_reported_and_not_only_the_first(fmus: Path, tmp_path: Path) -> None:
    """Faults in different parts of one file, each with its line."""
    (tmp_path / "faults.toml").write_text(FAULTS)
    result = cosim(
        "scenario", "check", "faults.toml", "--fmus", fmus.parent, "--json", cwd=tmp_path
    )
    assert result.code == 2
    found = [(p["where"].split(":")[1], p["what"]) for p in result.json["scenarios"][0]["problems"]]
    lines = [line for line, _ in found]
    message = " | ".join(what for _, what in found)
    assert lines == ["9", "9", "14", "18", "22", "27", "28", "31"]
    for words in ("initial.eta.x is measured in m", "'masss'", "'etta'", "units of the two ends"):
        assert words in message
    for words in ("after the end", "plant.eta.q", "'mass'", "incompatible"):
        assert words in message


def test_broken_schema_reports_every_key(fmus: Path, tmp_path: Path) -> None:
    """Several keys that break the schema are several problems."""
    (tmp_path / "keys.toml").write_text(
        'title = 5\n[run]\nend = "1 m"\nstepp = 1\nstep = 0.1\n[components.a]\nfmu = ""\n'
    )
    result = cosim("scenario", "check", "keys.toml", "--fmus", fmus.parent, cwd=tmp_path)
    assert result.code == 2
    assert result.out.splitlines()[0] == "keys.toml: 4 errors"
    for line in ("keys.toml:1:", "keys.toml:3:", "keys.toml:4:", "keys.toml:7:"):
        assert line in result.out
