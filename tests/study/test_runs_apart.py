"""Runs of a study leave nothing to each other, in whichever child they are executed."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from study.deadly import DEADLY, plan, truth

from cosim.study import execute_study, pool_for, read_table

VALUES = [0.0, DEADLY, 1.0, DEADLY + 1.0, 2.0]
FAULTS = ("change-folder", "delete-folder", "surroundings", "signals", "close-output")


@pytest.mark.parametrize("fault", FAULTS)
def test_what_a_run_changes_of_its_process_is_not_there_for_the_next(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Folder, environment, umask, limits, timers, signals: an FMU that finds another's fails."""

    def seen_here() -> tuple[object, ...]:
        left = os.getenv("LEFT_BY_A_HOSTILE_FMU")
        return Path.cwd(), signal.getsignal(signal.SIGUSR1), left

    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    before = seen_here()
    execute_study(plan(VALUES, fault), tmp_path / "out")
    found = read_table(tmp_path / "out")[0].to_pydict()
    assert list(zip(found["status"], found["reason"], strict=True)) == [("finished", None)] * 5
    assert found["x"] == pytest.approx([truth(u) for u in VALUES])
    assert seen_here() == before


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_the_table_does_not_depend_on_the_number_of_workers(fault: str, tmp_path: Path) -> None:
    """Whichever worker has the runs that misbehave."""
    tables = []
    for name, workers in (("one", 1), ("two", 2)):
        execute_study(plan(VALUES * 3, fault), tmp_path / name, pool_for(workers))
        found = read_table(tmp_path / name)[0].to_pydict()
        tables.append([found[column] for column in ("run", "status", "reason", "x")])
    assert tables[1] == tables[0]
