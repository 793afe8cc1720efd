"""The same table whoever flies it: one process, several, a cluster, and some of them killed."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path
from typing import Any

import distributed
import hostile.studies
import pytest
from shared import slow_share_of
from study.deadly import DEADLY, RESULTS, plan, truth

from cosim.core import ComponentError, InputError
from cosim.study import execute_study, pool_for, read_table


def dask_cluster(workers: int) -> Any:
    """Workers of a Dask scheduler on this machine."""
    return distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0"
    )


def processes(pool: Any) -> list[int]:
    """Numbers of the worker processes of a local pool that there are now."""
    return [worker.number for worker in pool.workers]


def test_two_processes_give_the_table_of_one_bit_for_bit(tmp_path: Path) -> None:
    """And the workers of a Dask scheduler, asked by its address, as well.

    Where this process keeps its temporary files stays what it was.
    """
    before = os.environ.get("TMPDIR")
    values = [0.1 * i for i in range(24)]
    execute_study(plan(values), tmp_path / "here")
    execute_study(plan(values), tmp_path / "local", pool_for(2))
    with dask_cluster(2) as workers:
        address = workers.scheduler_address
        execute_study(plan(values), tmp_path / "cluster", pool_for(1, address))
    assert os.environ.get("TMPDIR") == before
    tables = [(tmp_path / name / RESULTS).read_bytes() for name in ("here", "local", "cluster")]
    assert tables[0] == tables[1] == tables[2]


def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path) -> None:
    """As what was asked for; what was flown for a start stays."""
    wrong = "no address at all://"
    with pytest.raises(InputError, match="no scheduler answers") as refused:
        execute_study(plan([0.0, 1.0]), tmp_path, pool_for(1, wrong))
    assert wrong in refused.value.text()
    assert read_table(tmp_path)[0]["run"].to_pylist() == [0]


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_loses_nothing(tmp_path: Path) -> None:
    """Three processes, one ended by -9 after a third of the runs: the undisturbed table."""
    values = [DEADLY + 0.1 * i for i in range(150)]
    execute_study(plan(values, "sleep"), tmp_path / "undisturbed")
    killed: list[int] = []
    with pool_for(3)() as pool:

        def kill(_what: str, share: float) -> None:
            if share > 0.3 and not killed:
                killed.append(processes(pool)[0])
                os.kill(killed[0], signal.SIGKILL)

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
    done = execute_study(plan(values), tmp_path, pool_for(2))
    found = read_table(tmp_path)[0].to_pydict()
    assert done.statuses == {"finished": 14, "crashed": 1}
    assert done.retried == 0
    assert found["status"][2] == "crashed"
    assert "component 'tiny'" in found["reason"][2]
    others = [i for i in range(15) if i != 2]
    assert [found["x"][i] for i in others] == pytest.approx([truth(values[i]) for i in others])


@pytest.mark.slow
def test_workers_that_die_are_replaced(tmp_path: Path) -> None:
    """Each time that they do: all there are of two are ended whenever a run is done."""
    killed: list[int] = []
    values = [DEADLY + 0.1 * i for i in range(12)]
    with pool_for(2)() as pool:

        def kill(_what: str, _share: float) -> None:
            alive = [number for number in processes(pool) if number not in killed]
            if len(killed) < 4 and alive:
                for number in alive:
                    os.kill(number, signal.SIGKILL)
                killed.extend(alive)

        done = execute_study(
            plan(values, "sleep"), tmp_path, lambda: contextlib.nullcontext(pool), progress=kill
        )
    assert len(killed) >= 4
    assert done.statuses == {"finished": 12}


def test_a_study_that_loses_its_workers_ends_and_can_be_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a scheduler has none any more, that is reported; what is done is kept."""
    monkeypatch.setattr("cosim.study.workers._LOOK_S", 0.05)
    monkeypatch.setattr("cosim.study.workers._SAY_S", 0.1)
    notices: list[str] = []
    with dask_cluster(0) as nobody:
        address = nobody.scheduler_address
        with pytest.raises(ComponentError, match="no workers for") as caught:
            execute_study(
                plan([0.0, 1.0]),
                tmp_path,
                pool_for(1, address, 0.5),
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


def test_all_runs_of_a_batch_but_the_one_that_kills_its_worker_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Divided down to the one that kills, which is tried alone before it is given up."""
    monkeypatch.setenv("SPARED", str(os.getpid()))
    values = [0.1 * i if i != 7 else DEADLY for i in range(100)]
    done = execute_study(plan(values, "kill-worker"), tmp_path, pool_for(2))
    assert done.statuses == {"finished": 99, "lost": 1}
    assert (done.runs, done.executed) == (100, 100)
    assert done.retried > 0
    found = read_table(tmp_path)[0].to_pydict()
    assert found["status"][7] == "lost"
    assert "died at each of 4 attempts" in found["reason"][7]
