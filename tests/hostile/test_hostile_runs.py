"""Runs with a hostile FMU in the command line: the verdict, the rows, and what is left.

Every row of the table needs supervised runs: a named error, every complete row in a finished
trace, nothing left behind, and exit(0) is no success.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest
from hostile.expected import RUN_CALLS, VERSIONS, Expectation, Row, rows
from hostile.hostile_fmu import FAULTS
from hostile.judged import departures
from hostile.runs import STEPS, Interrupt, run_row
from shared import sampled, share_of
from study.deadly import DEADLY, U, folder, truth

from cosim.study import read_table
from cosim.trace import Trace

SAMPLE = (
    *(Row("segfault", "step", v) for v in VERSIONS),
    Row("exit-0", "step", "3.0"),
    Row("abort", "free", "2.0"),
    Row("hang", "step", "2.0"),
    Row("hang-deaf", "terminate", "3.0"),
    Row("leak", "step", "3.0"),
    Row("negative", "step", "2.0"),
)


@pytest.mark.parametrize("row", sampled(SAMPLE, 4), ids=lambda row: row.name)
def test_fault_is_named_and_nothing_is_lost_or_left(tmp_path: Path, row: Row) -> None:
    """A few rows of the table."""
    assert departures(run_row(row, tmp_path)) == []


@pytest.mark.slow
@pytest.mark.parametrize("row", share_of(rows()), ids=lambda row: row.name)
def test_every_row_of_the_table(tmp_path: Path, row: Row) -> None:
    """`python -m tests.hostile.table` prints it."""
    assert departures(run_row(row, tmp_path)) == []


TARGETS = {
    "group": Interrupt(signal.SIGINT, group=True),
    "process": Interrupt(signal.SIGINT, group=False),
    "terminated": Interrupt(signal.SIGTERM, group=False),
}
"""Ctrl-C in a terminal reaches every process of the group, `kill -INT` one."""


def interrupted(folder: Path, row: Row, target: str) -> None:
    """The command ends soon, with every row that was complete, and leaves nothing."""
    found = run_row(row, folder, interrupt=TARGETS[target], limits=False)
    code = 143 if target == "terminated" else 130
    words = ("terminated" if target == "terminated" else "interrupted",)
    whole = row.call in ("terminate", "free")
    assert departures(found, Expectation((code,), (), words, whole=whole)) == []


@pytest.mark.parametrize("target", sampled(TARGETS, 1))
def test_ctrl_c_ends_a_hanging_step(tmp_path: Path, target: str) -> None:
    """Though the FMU ignores every signal."""
    interrupted(tmp_path, Row("hang-deaf", "step", "2.0"), target)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("call", "fault", "target"),
    share_of(product([c for c in RUN_CALLS if c != "setup"], ["hang", "hang-deaf"], TARGETS)),
)
def test_ctrl_c_ends_a_hang_in_every_call(
    tmp_path: Path, call: str, fault: str, target: str
) -> None:
    """From the loading of the library until the instance is freed."""
    interrupted(tmp_path, Row(fault, call, "3.0"), target)


@pytest.mark.parametrize(
    "row",
    sampled([Row("flood-stdout", "step", "3.0"), Row("print", "step", "2.0")], 1),
    ids=lambda row: row.name,
)
def test_what_an_fmu_prints_is_no_part_of_the_json(tmp_path: Path, row: Row) -> None:
    """One JSON value, whatever the FMU writes; what it wrote is in the log of the trace."""
    found = run_row(row, tmp_path, "--json")
    outcome = json.loads(found.printed)
    assert (found.code, outcome["status"]) == (0, "finished")
    assert (found.rows_kept, found.wrong_rows) == (STEPS + 1, ())
    log = Trace(tmp_path / "run" / "t.mcap").read("/log")
    logged = [m for n, m in zip(log["name"], log["message"], strict=True) if n == "stdout"]
    assert any(
        ("a line that the FMU prints" if row.fault == "print" else "~~~") in m for m in logged
    )
    assert (tmp_path / "run" / "t.mcap").stat().st_size < 4 << 20


STUDY = """
title = "x follows u"
scenario = "{scenario}"
[[vary]]
kind = "grid"
name = "u"
path = "{path}"
values = [0.0, 1.0, {deadly}, 2.0]
[metrics]
x = "final.tiny.x"
[set]
"components.tiny.parameters.fault" = {fault}
"limits.call" = "2 s"
"""


@pytest.mark.slow
@pytest.mark.parametrize("fault", sampled(["exit-0", "hang"], 1))
def test_study_in_one_process_goes_on_after_such_a_run(tmp_path: Path, fault: str) -> None:
    """Its row says how it ended and why; all others are the closed form."""
    given = {"scenario": folder() / "tiny.toml", "path": U, "deadly": DEADLY}
    text = STUDY.format(**given, fault=FAULTS.index(fault))
    (tmp_path / "s.toml").write_text(text)
    line = [sys.executable, "-m", "cosim", "study", "run", "s.toml", "--out", "out"]
    done = subprocess.run(  # noqa: S603 - ourselves
        line, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    found = read_table(tmp_path / "out")[0].to_pydict()
    ended = {"exit-0": "crashed", "hang": "timed_out"}[fault]
    assert found["status"] == ["finished", "finished", ended, "finished"]
    assert "'tiny'" in found["reason"][2]
    assert "step" in found["reason"][2].lower()
    values = [value for value, u in zip(found["x"], found["u"], strict=True) if u != DEADLY]
    assert values == pytest.approx([truth(u) for u in (0.0, 1.0, 2.0)])
