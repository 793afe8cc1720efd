"""Studies on clusters whose workers share no folder, join late, and come and go."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import dask
import distributed
import pytest
from hostile.hostile_fmu import hostile_fmu
from study.deadly import DEADLY, RESULTS, base, plan, study

from cosim.core import ComponentError, InputError
from cosim.study import Plan, execute_study, plan_of, pool_for, read_table, shipping

BLIND = """
import os, sys
def dask_setup(worker):
    def refuse(event, arguments):
        if event in ("open", "os.listdir", "os.scandir", "shutil.copyfile"):
            if str(arguments[0]).startswith(os.environ["HIDDEN"]):
                raise PermissionError(f"{arguments[0]} is not on this machine")
    sys.addaudithook(refuse)
"""
"""Preloaded by workers: what lies in a folder cannot be opened, as if on another machine."""


@contextlib.contextmanager
def separate(tmp_path: Path, hidden: Path, workers: int = 2, **more: Any) -> Iterator[Any]:
    """A cluster whose workers have folders of their own, and do not see `hidden`."""
    (tmp_path / "blind.py").write_text(BLIND)
    environ = {"HIDDEN": str(hidden), "XDG_CACHE_HOME": str(tmp_path / "theirs")}
    options = {"processes": True, "threads_per_worker": 1, "dashboard_address": ":0"} | more
    with (
        distributed.LocalCluster(
            n_workers=workers,
            host="127.0.0.1",
            silence_logs=logging.CRITICAL,
            local_directory=str(tmp_path / "scratch"),
            env=environ,
            preload=[str(tmp_path / "blind.py")],
            **options,
        ) as made,
    ):
        yield made


@pytest.mark.slow
def test_workers_that_share_no_folder_give_the_same_table_and_traces(tmp_path: Path) -> None:
    """FMU and scenario go there by content, once; the traces of two runs come back.

    The FMU lies in a cache on their side, under its hash.
    """
    home = tmp_path / "home"
    home.mkdir()
    hostile_fmu(home, "2.0", "tiny")
    asked = study([0.1 * i for i in range(8)], traces="worst:2 by x")

    def made() -> Plan:
        return plan_of(asked, replace(base(), folder=home), fmus=home / "fmus", flavour="native")

    execute_study(made(), home / "alone")
    with separate(tmp_path, home) as workers:
        address = workers.scheduler_address
        done = execute_study(made(), home / "far", pool_for(1, address))
        offers = workers.scheduler.extensions["auv_cosim_content"]
    assert offers == {}
    assert done.traces == {6: None, 7: None}
    names = ["run-6.mcap", "run-7.mcap"]
    assert sorted(path.name for path in (home / "far" / "traces").iterdir()) == names
    assert (home / "far" / RESULTS).read_bytes() == (home / "alone" / RESULTS).read_bytes()
    kept = [path.name for path in (tmp_path / "theirs" / "auv-cosim" / "shipped").iterdir()]
    assert kept == [f"{made().job.hashes['tiny.fmu']}.fmu"]


@pytest.mark.slow
def test_a_cluster_that_begins_without_workers_grows_and_gives_the_same_table(
    tmp_path: Path,
) -> None:
    """`adapt` starts workers when there is work, more than one, and they join a study that runs."""
    values = [DEADLY + 0.1 * i for i in range(120)]
    execute_study(plan(values, "sleep"), tmp_path / "here")
    most: list[int] = []
    with (
        dask.config.set({"distributed.adaptive.target-duration": "500ms"}),
        separate(tmp_path, tmp_path / "nowhere", workers=0) as workers,
    ):
        workers.adapt(minimum=0, maximum=2, interval="100ms", wait_count=1000)

        def look(_what: str, _share: float) -> None:
            most.append(len(workers.scheduler.workers))

        done = execute_study(
            plan(values, "sleep"),
            tmp_path / "adapted",
            pool_for(1, workers.scheduler_address),
            progress=look,
        )
    assert done.statuses == {"finished": 120}
    assert (min(most), max(most)) == (0, 2)
    tables = [(tmp_path / name / RESULTS).read_bytes() for name in ("here", "adapted")]
    assert tables[0] == tables[1]


@pytest.mark.slow
def test_a_scheduler_that_is_killed_ends_the_study_and_another_goes_on(tmp_path: Path) -> None:
    """Within seconds; what is done is kept, and the table is that of one process."""
    values = [DEADLY + 0.1 * i for i in range(60)]
    execute_study(plan(values, "sleep"), tmp_path / "here")
    line = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    scheduler = subprocess.Popen(  # noqa: S603 - Dask's own
        [*line, "--host=127.0.0.1", "--port=0", f"--scheduler-file={tmp_path / 'scheduler.json'}"],
        stderr=subprocess.DEVNULL,
    )
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-dashboard", "--no-nanny"]
    worker += [f"--scheduler-file={tmp_path / 'scheduler.json'}", "--death-timeout=5"]
    working = subprocess.Popen([*worker, "--nthreads=1"], stderr=subprocess.DEVNULL)  # noqa: S603
    try:
        address = _address_in(tmp_path / "scheduler.json")

        def kill(_what: str, share: float) -> None:
            if 0.2 < share < 1.0:
                scheduler.kill()

        began = time.monotonic()
        with pytest.raises(ComponentError, match="scheduler does not answer"):
            execute_study(
                plan(values, "sleep"), tmp_path / "hit", pool_for(1, address), progress=kill
            )
        assert time.monotonic() - began < 60.0
    finally:
        for process in (scheduler, working):
            process.kill()
            process.wait()
    assert 1 < read_table(tmp_path / "hit")[0].num_rows < 60
    execute_study(plan(values, "sleep"), tmp_path / "hit", pool_for(2))
    tables = [(tmp_path / name / RESULTS).read_bytes() for name in ("here", "hit")]
    assert tables[0] == tables[1]


def _address_in(file: Path) -> str:
    """The address that a scheduler writes to a file."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        with contextlib.suppress(OSError, ValueError):
            return str(json.loads(file.read_text())["address"])
        time.sleep(0.1)
    raise TimeoutError


@pytest.mark.slow
def test_a_worker_that_joins_late_with_other_versions_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that is there from the start; what was done before is kept."""
    values = [0.1 * i for i in range(6)]
    monkeypatch.setattr("cosim.study.execution.MAX_AT_ONCE", 1)
    found: list[Any] = []
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0"
        ) as workers,
        distributed.Client(workers) as client,
    ):

        def late(_what: str, share: float) -> None:
            if share > 0.3 and not found:
                found.append(share)
                client.run(_pretend_other_versions)

        with pytest.raises(InputError, match="a worker has other versions") as refused:
            execute_study(
                plan(values),
                tmp_path,
                pool_for(1, workers.scheduler_address),
                progress=late,
            )
    assert "numpy 0.1" in refused.value.text()
    assert 1 < read_table(tmp_path)[0].num_rows < 6


OTHER = """
import importlib.metadata
def version(name):
    return "0.1" if name == "numpy" else importlib.metadata.Distribution.from_name(name).version
importlib.metadata.version = version
"""
"""Preloaded by a worker: what is a process of another installation."""


def test_a_worker_with_other_versions_is_refused(tmp_path: Path) -> None:
    """Before it executes a run; the message says which versions were meant, and which are there."""
    (tmp_path / "other.py").write_text(OTHER)
    with (
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=":0",
            preload=[str(tmp_path / "other.py")],
        ) as workers,
        pytest.raises(InputError, match="a worker has other versions") as refused,
    ):
        execute_study(plan([0.0, 1.0]), tmp_path / "x", pool_for(1, workers.scheduler_address))
    assert refused.value.got == "numpy 0.1"
    assert refused.value.expected == f"numpy {version('numpy')}"
    assert read_table(tmp_path / "x")[0].num_rows == 1


def _pretend_other_versions() -> None:
    """In a worker: what is a new process of another installation."""
    from cosim.study import batch  # noqa: PLC0415

    before = batch.software
    batch.software = lambda: before() | {"numpy": "0.1"}
    shipping._jobs.clear()


def test_files_are_laid_out_as_the_scenario_names_them(tmp_path: Path) -> None:
    """Also beside its folder; what has an absolute path must be there, the same, or is named."""
    contents = {hashlib.sha256(text).hexdigest(): text for text in (b"a", b"b", b"wrong")}
    a, b, wrong = contents
    shipment = shipping.Shipment(files={"../../k.json": a, "s.toml": b})
    where = plan([0.0]).job.base
    there = shipping.received(shipment, where, tmp_path / "here", contents.__getitem__)
    assert (there.folder / "../../k.json").read_bytes() == b"a"
    assert (there.folder / "s.toml").read_bytes() == b"b"
    lost = shipping.Shipment(files={"s.toml": wrong})
    with pytest.raises(InputError, match="not what was sent"):
        shipping.received(lost, where, tmp_path / "lost", lambda _: b"other")
    (tmp_path / "gains.json").write_bytes(b"b")
    for path in ("gains.json", "missing.json"):
        outside = shipping.Shipment(outside={str(tmp_path / path): a})
        with pytest.raises(InputError, match="not shipped, since its path is absolute"):
            shipping.received(outside, where, tmp_path / path, contents.__getitem__)
