"""A study ends in time, and says what it could not do: limits, full disk, other versions."""

from __future__ import annotations

import contextlib
import os
import resource
from pathlib import Path

import pytest
from study.deadly import DEADLY, RESULTS, RUN_LOG, U, plan, truth
from study.pools import RunByRun
from study.run_logs import write_bare

from cosim.core import InputError, LossError
from cosim.study import Plan, execute_study, read_table, repeat_run
from cosim.trace import Trace


@pytest.mark.slow
def test_a_run_that_hangs_ends_at_its_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its component and call named; the others are the closed form.

    It is waited for once: when it is repeated to name the call, most of its limit is over.
    """
    monkeypatch.setattr("cosim.study.study_runner._NAMED_S", 0.1)
    done = execute_study(plan([0.0, DEADLY, 1.0], "hang"), tmp_path, limits=["run=1.5"])
    found = read_table(tmp_path)[0].to_pydict()
    assert found["status"] == ["finished", "timed_out", "finished"]
    assert "limit of 1.5 s in fmi2DoStep" in found["reason"][1]
    assert done.incomplete[0].seconds < 1.5
    assert found["x"][2] == pytest.approx(truth(1.0))
    assert [(row.run, row.status) for row in done.incomplete] == [(1, "timed_out")]


@pytest.mark.slow
def test_a_first_run_that_hangs_is_left_to_the_limit_of_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its time is no measure; if none of the first runs ends, that is the answer."""
    monkeypatch.setattr("cosim.study.plan.TRIAL_S", 0.5)
    monkeypatch.setattr("cosim.study.execution.RUN_LIMIT_S", 1.0)
    done = execute_study(plan([DEADLY, 0.5, 1.0], "hang"), tmp_path / "one")
    assert done.statuses == {"timed_out": 1, "finished": 2}
    assert done.run_limit_s is not None
    assert done.run_limit_s >= 1.0
    with pytest.raises(Exception, match="the first runs of the study do not end"):
        execute_study(plan([DEADLY, DEADLY + 1], "hang"), tmp_path / "two")


def test_a_study_whose_only_run_hung_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is done says nothing of how long a run takes: the least limit holds."""
    monkeypatch.setattr("cosim.study.execution.RUN_LIMIT_S", 1.0)
    made, soon = plan([DEADLY, 0.5], "hang"), ["run=0.2"]
    with pytest.raises(LossError, match="the time of the study is over"):
        execute_study(made, tmp_path, limits=soon, time_limit_s=0.0)
    write_bare(tmp_path, lambda _: [[0, "timed_out", "no answer", 1.0, None]])
    done = execute_study(plan([DEADLY, 0.5], "hang"), tmp_path)
    assert done.statuses == {"timed_out": 1, "finished": 1}
    assert done.run_limit_s == 1.0


def test_a_study_that_takes_too_long_ends_and_can_be_continued(tmp_path: Path) -> None:
    made = plan([0.0, 1.0, 2.0])
    with pytest.raises(LossError, match="the time of the study is over") as caught:
        execute_study(made, tmp_path, time_limit_s=0.0)
    assert caught.value.got == "1, which are kept"
    assert execute_study(made, tmp_path).executed == 2


def test_a_full_disk_is_named_and_the_study_can_be_continued(tmp_path: Path) -> None:
    """The greatest size of a file stands for the disk; the half line that it leaves is removed."""
    made = plan([0.1 * i for i in range(30)])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(what: str, _share: float) -> None:
        if what.startswith("5 of"):
            size = (tmp_path / RUN_LOG).stat().st_size + 20
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))

    try:
        with pytest.raises(LossError, match="results cannot be written") as caught:
            execute_study(made, tmp_path, RunByRun(), progress=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert RUN_LOG in str(caught.value.where)
    done = execute_study(made, tmp_path)
    assert done.statuses == {"finished": 30}
    assert 24 <= done.executed <= 26


def test_a_folder_that_is_lost_is_named_and_the_study_can_be_continued(tmp_path: Path) -> None:
    """As one of a network whose server is gone: the system refuses every access to it."""

    def lose(what: str, _share: float) -> None:
        if what != "2 of 5 runs":
            return
        nothing = os.open(tmp_path, os.O_PATH)  # nothing can be read from it or written to it
        for link in Path("/proc/self/fd").iterdir():
            with contextlib.suppress(OSError):
                if link.readlink().name == RUN_LOG:
                    os.dup2(nothing, int(link.name))
        os.close(nothing)

    values = [0.1 * i for i in range(5)]
    with pytest.raises(LossError, match="results cannot be written") as refused:
        execute_study(plan(values), tmp_path, RunByRun(), progress=lose)
    assert str(tmp_path) in refused.value.text()
    done = execute_study(plan(values), tmp_path)
    assert (done.runs, done.executed) == (5, 3)


def test_a_run_that_crashes_is_repeated_alone_with_its_trace(tmp_path: Path) -> None:
    """In a child of its own: nothing happens to this process."""
    outcome = repeat_run(plan([0.0, DEADLY]), 1, tmp_path / "run.mcap")
    assert outcome.status == "failed"
    assert outcome.cause is not None
    assert outcome.cause.kind == "crashed"
    trace = Trace(tmp_path / "run.mcap")
    assert trace.outcome is not None
    assert trace.outcome.status == "failed"
    with pytest.raises(InputError, match="no such run"):
        repeat_run(plan([0.0, DEADLY]), 2, tmp_path / "none.mcap")


def test_traces_of_failed_runs_are_kept_of_runs_that_crash(tmp_path: Path) -> None:
    done = execute_study(plan([0.0, DEADLY], traces="failed"), tmp_path)
    assert done.traces == {1: None}
    assert Trace(tmp_path / "traces" / "run-1.mcap").outcome is not None


@pytest.mark.slow
def test_a_study_with_more_samples_keeps_the_runs_that_it_has(tmp_path: Path) -> None:
    """The same table, bit for bit, as if it had had all samples from the start."""

    def of(samples: int, kind: str = "sobol") -> Plan:
        axes = [
            {
                "kind": "grid",
                "name": "x0",
                "path": "components.tiny.parameters.x0",
                "values": [1, 2],
            },
            {"kind": kind, "name": "u", "path": U, "uniform": [0.0, 5.0]},
        ]
        return plan([], vary=axes, samples=samples)

    execute_study(of(4), tmp_path / "grown")
    done = execute_study(of(16), tmp_path / "grown")
    assert (done.runs, done.executed) == (32, 24)
    execute_study(of(16), tmp_path / "whole")
    tables = [(tmp_path / name / RESULTS).read_bytes() for name in ("grown", "whole")]
    assert tables[0] == tables[1]
    assert execute_study(of(16), tmp_path / "grown").executed == 0
    with pytest.raises(InputError, match="results of another study"):
        execute_study(of(4), tmp_path / "grown")
    execute_study(of(4, "latin"), tmp_path / "latin")
    with pytest.raises(InputError, match="results of another study"):
        execute_study(of(16, "latin"), tmp_path / "latin")
