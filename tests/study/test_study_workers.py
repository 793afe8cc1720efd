"""The same table whoever flies it: one process, several, a cluster, and some of them killed."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
import hostile.studies
import pytest
from shared import slow_share_of
from study.deadly import DEADLY, plan, truth

from cosim.core import ComponentError, InputError
from cosim.study import execute_study, read_table
from cosim.study.folder import RESULTS
from cosim.study.workers import WorkerDied, cluster, local


def test_two_processes_give_the_table_of_one_bit_for_bit(tmp_path: Path) -> None:
    """And the scheduler of the same cluster, asked by its address, as well.

    Where this process keeps its temporary files stays what it was.
    """
    before = os.environ.get("TMPDIR")
    values = [0.1 * i for i in range(24)]
    execute_study(plan(values), tmp_path / "here")
    with local(2) as pool:
        execute_study(plan(values), tmp_path / "local", lambda: contextlib.nullcontext(pool))
        address = pool._client.scheduler.address
        execute_study(plan(values), tmp_path / "cluster", lambda: cluster(address))
        assert os.environ.get("TMPDIR") == before
    tables = [(tmp_path / name / RESULTS).read_bytes() for name in ("here", "local", "cluster")]
    assert tables[0] == tables[1] == tables[2]


def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path) -> None:
    """As what was asked for; what was flown for a start stays."""
    wrong = "no address at all://"
    with pytest.raises(InputError, match="no scheduler answers") as refused:
        execute_study(plan([0.0, 1.0]), tmp_path, lambda: cluster(wrong))
    assert wrong in refused.value.text()
    assert read_table(tmp_path)[0]["run"].to_pylist() == [0]


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_loses_nothing(tmp_path: Path) -> None:
    """Three processes, one ended by -9 after a third of the runs: the undisturbed table."""
    values = [DEADLY + 0.1 * i for i in range(150)]
    execute_study(plan(values, "sleep"), tmp_path / "undisturbed")
    killed: list[int] = []
    with local(3) as pool:
        pids = list(pool._client.run(os.getpid).values())

        def kill(_what: str, share: float) -> None:
            if share > 0.3 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        done = execute_study(
            plan(values, "sleep"),
            tmp_path / "hit",
            lambda: contextlib.nullcontext(pool),
            progress=kill,
        )
    assert len(killed) == 1
    assert (done.runs, done.executed) == (150, 150)
    tables = [(tmp_path / name / RESULTS).read_bytes() for name in ("undisturbed", "hit")]
    assert tables[0] == tables[1]


@pytest.mark.slow
def test_a_run_that_crashes_is_recorded_and_stops_no_other(tmp_path: Path) -> None:
    """Its child process ends, not the worker; all others are the closed form."""
    values = [0.0, 1.0, DEADLY, *(0.1 * i for i in range(12))]

    @contextlib.contextmanager
    def two() -> Iterator[Any]:
        with local(2) as pool:
            yield pool

    done = execute_study(plan(values), tmp_path, two)
    found = read_table(tmp_path)[0].to_pydict()
    assert done.statuses == {"finished": 14, "crashed": 1}
    assert done.retried == 0
    assert found["status"][2] == "crashed"
    assert "component 'tiny'" in found["reason"][2]
    others = [i for i in range(15) if i != 2]
    assert [found["x"][i] for i in others] == pytest.approx([truth(values[i]) for i in others])


def give_up(pool: Any) -> None:
    """The one who would start the only worker again does not, as when a start fails."""
    cluster = pool._client.cluster
    cluster.sync(cluster.workers[0].close)


@pytest.mark.slow
def test_workers_are_replaced_when_they_are_lost_and_not_given_up_before(tmp_path: Path) -> None:
    """Dask looks once, so long after a death, and closes for good what is not there just then.

    Several runs that kill their workers hit that moment sooner or later, and nobody was left.
    """
    with local(1) as pool:
        reported = dask.config.get("distributed.deploy.lost-worker-timeout")
        assert dask.utils.parse_timedelta(reported) > 365 * 24 * 3600
        give_up(pool)
        done = execute_study(plan([0.0, 1.0]), tmp_path, lambda: contextlib.nullcontext(pool))
    assert done.statuses == {"finished": 2}


def test_a_study_that_loses_its_workers_ends_and_can_be_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where none can be started any more, that is reported; what is done is kept."""
    monkeypatch.setattr("cosim.study.workers._replace_lost", lambda *_: None)
    monkeypatch.setattr("cosim.study.workers._LOOK_S", 0.05)
    monkeypatch.setattr("cosim.study.workers._SAY_S", 0.1)
    notices: list[str] = []
    with local(1, wait_s=0.5) as pool:
        give_up(pool)
        with pytest.raises(ComponentError, match="no workers for") as caught:
            execute_study(
                plan([0.0, 1.0]),
                tmp_path,
                lambda: contextlib.nullcontext(pool),
                progress=lambda what, _: notices.append(what),
            )
    assert "the same command continues" in str(caught.value.hint)
    assert any("no workers for" in what for what in notices)
    assert execute_study(plan([0.0, 1.0]), tmp_path).statuses == {"finished": 2}


STUDIES = [(fault, n) for fault in hostile.studies.EXPECTED for n in hostile.studies.WORKERS]


@pytest.mark.parametrize(("fault", "workers"), slow_share_of(STUDIES))
def test_runs_that_misbehave_do_not_stop_a_study(fault: str, workers: int) -> None:
    """Five of forty: each is a row that names the component, all others are the closed form.

    In a process of its own, since a study that stops for ever is what is looked for.
    """
    assert hostile.studies.run_study_with(fault, workers).wrong == []


def test_all_runs_of_a_batch_but_the_one_that_kills_its_worker_are_kept(tmp_path: Path) -> None:
    """Halved down to the one that kills; a crew that dies on it, in this process."""
    executed: list[int] = []

    class Fragile:
        size = 2

        def run_batches(self, function: Any, job: Any, next_batch: Any) -> Iterator[Any]:
            while (runs := next_batch()) is not None:
                if 7 in runs:
                    yield runs, WorkerDied(2)
                else:
                    executed.extend(runs)
                    yield runs, function(job, runs)

    done = execute_study(
        plan([0.1 * i for i in range(100)]), tmp_path, lambda: contextlib.nullcontext(Fragile())
    )
    assert done.statuses == {"finished": 99, "lost": 1}
    assert sorted([0, *executed]) == [i for i in range(100) if i != 7]
    found = read_table(tmp_path)[0].to_pydict()
    assert found["status"][7] == "lost"
