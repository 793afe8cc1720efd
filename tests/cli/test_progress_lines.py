"""Long work says how far it is where standard error is a pipe or a file, as in CI."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cli.shell import cosim

LINE = re.compile(r"cosim: (?P<what>.+?)(, (?P<share>\d+) %)?, after (?P<seconds>\d+) s")
OFTEN = """
from cosim.cli import progress_lines
progress_lines.EACH_S = 0.02
from cosim.cli.entry import main
main()
"""
MINUTE = """
from cosim.cli import progress_lines
from cosim.cli.common import progress
from cosim.core import still_working
now = 0.0
progress_lines.time.monotonic = lambda: now
with progress() as report_progress:
    for tick in range(1, 451):
        now = tick / 10
        if tick < 250:
            report_progress(f"{tick} of 900 runs", tick / 900)
        else:
            still_working()
"""
STUDY = """\
title = "Ends"
scenario = "paper-example"

[[vary]]
name = "end"
kind = "grid"
path = "run.end"
linspace = [0.5, 1.0, 40]

[metrics]
error = { signal = "plant.x[1]", reduce = "max_abs" }
"""


def piped(*arguments: str | Path, folder: Path, shell: str = "") -> tuple[str, list[str]]:
    """Standard output, and the lines of standard error, of a process whose both are pipes."""
    command = [sys.executable, "-c", OFTEN, *map(str, arguments)]
    if shell:
        command = ["sh", "-c", f'exec "$@" {shell}', "sh", *command]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr.splitlines()


def test_a_study_in_a_pipe_counts_its_runs(fmus: Path, tmp_path: Path) -> None:
    """Lines on standard error count the runs that are done; standard output is JSON alone."""
    (tmp_path / "ends.toml").write_text(STUDY, "utf-8")
    options = ("--fmus", fmus.parent, "--json")
    out, lines = piped("study", "run", "ends.toml", *options, folder=tmp_path)
    assert json.loads(out)["runs"] == 40
    found = [LINE.fullmatch(line) for line in lines]
    assert found, lines
    counted = [int(m["what"].split()[0]) for m in found if m and " of 40 runs" in m["what"]]
    assert len(counted) > 3, lines
    assert counted == sorted(counted)
    assert all(found), lines


def test_a_search_in_a_pipe_says_what_it_searches(tmp_path: Path) -> None:
    """What a design reports from deep below reaches standard error."""
    out, lines = piped("design", "paper", "--search", "--json", folder=tmp_path)
    assert json.loads(out)["certified"]
    assert {m["what"] for m in map(LINE.fullmatch, lines) if m} >= {"searching k1, k2"}, lines


@pytest.mark.parametrize("closed", ["2>&-", "2>/dev/full"])
def test_standard_error_that_takes_nothing_ends_no_command(
    closed: str, fmus: Path, tmp_path: Path
) -> None:
    """Where it is closed, or has no room, the work is done and standard output is as ever."""
    line = ("run", "paper-example", "--fmus", fmus.parent, "--json")
    out, lines = piped(*line, folder=tmp_path, shell=closed)
    assert json.loads(out)["status"] == "finished"
    assert not lines


def test_short_work_says_nothing(tmp_path: Path) -> None:
    """A command that is over before a line is due leaves standard error empty."""
    done = cosim("design", "paper", cwd=tmp_path)
    assert (done.code, done.err) == (0, "")


def test_lines_are_ten_seconds_apart() -> None:
    """However often there is news; where there is none, a loop that goes on repeats the last."""
    command = [sys.executable, "-c", MINUTE]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        "cosim: 100 of 900 runs, 11 %, after 10 s",
        "cosim: 200 of 900 runs, 22 %, after 20 s",
        "cosim: 249 of 900 runs, 28 %, after 30 s",
        "cosim: 249 of 900 runs, 28 %, after 40 s",
    ]
