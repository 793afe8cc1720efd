"""Runs and sessions in threads of one process are those that they are alone, bit for bit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from scenario.in_threads import SCENARIO, WAYS
from shared import fmu_store, sampled

from cosim import open_session
from cosim.core import InputError
from cosim.master import Session

IN_PROCESS, SUPERVISED = "False", "True"
CASES = [(way, where) for way in WAYS if way != "alone" for where in (IN_PROCESS, SUPERVISED)]
_SCRIPT = Path(__file__).with_name("in_threads.py")
_PATIENCE_S = 600.0


def made(way: str, folder: Path, fmus: Path | str, runs: int, supervise: str = IN_PROCESS) -> Any:
    """Make the runs in a new process, which has loaded nothing; return what it prints."""
    folder.mkdir(parents=True, exist_ok=True)
    line = [sys.executable, "-X", "faulthandler", _SCRIPT, way, folder, fmus, str(runs), supervise]
    done = subprocess.run(  # noqa: S603 - ourselves
        line,
        capture_output=True,
        text=True,
        timeout=_PATIENCE_S,
        check=False,
        env={**os.environ, "XDG_CACHE_HOME": str(folder / "cache")},
    )
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr[-3000:]}"
    return json.loads(done.stdout)


@cache
def alone(folder: Path) -> Any:
    """What the runs come to one after the other."""
    found = made("alone", folder, fmu_store(), 2)
    assert "error" not in found
    assert [len(digests) for digests in found.values()] == [1] * 8
    return found


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the runs alone are made."""
    return tmp_path_factory.mktemp("alone")


@pytest.mark.parametrize(("way", "supervise"), sampled(CASES, 2))
def test_runs_at_the_same_time_are_those_alone(
    way: str, supervise: str, tmp_path: Path, place: Path
) -> None:
    """Content hashes, rows of sessions, and what all threads share."""
    assert made(way, tmp_path, fmu_store(), 5, supervise) == alone(place)


@pytest.mark.slow
@pytest.mark.parametrize("trial", range(10))
@pytest.mark.parametrize(("way", "supervise"), CASES)
def test_twenty_runs_in_each_of_four_threads(
    way: str, supervise: str, trial: int, tmp_path: Path, place: Path
) -> None:
    """No crash, no hang, every run as it is alone, in each of ten trials."""
    del trial
    assert made(way, tmp_path, fmu_store(), 20, supervise) == alone(place)


@pytest.mark.slow
def test_what_is_missing_is_built_once_for_all_threads(tmp_path: Path, place: Path) -> None:
    """Neither FMUs below a folder, which is relative, nor libraries are there yet."""
    assert made("threads", tmp_path, "fmus", 2) == alone(place)


@pytest.mark.parametrize("supervise", [False, True])
def test_a_session_goes_from_thread_to_thread(supervise: Any, tmp_path: Path) -> None:
    """Each call from another thread, as asyncio.to_thread does: the values are those of one."""
    (tmp_path / "s.toml").write_text(SCENARIO.format(number=1))
    found = []
    for threads in (1, 4):
        with ThreadPoolExecutor(threads) as pool:
            opened = open_session(tmp_path / "s.toml", fmus=fmu_store(), supervise=supervise)
            session = pool.submit(opened.__enter__).result()
            while not session.ended:
                pool.submit(session.step).result()
            run = pool.submit(session.result).result()
            pool.submit(opened.__exit__, None, None, None).result()
        found.append([i.rows[: run.count].tobytes() for i in run.instances])
    assert found[0] == found[1]


def test_two_threads_in_one_session_are_refused_by_name(tmp_path: Path) -> None:
    """The call that comes second; the first goes on, and closing waits for it."""
    (tmp_path / "s.toml").write_text(SCENARIO.format(number=1))
    within, go_on = Event(), Event()

    def wait(_session: Session) -> bool:
        within.set()
        return not go_on.wait(60)

    with ThreadPoolExecutor(1) as pool:
        with open_session(tmp_path / "s.toml", fmus=fmu_store(), supervise=False) as session:
            first = pool.submit(session.run, stop=wait)
            assert within.wait(60)
            for call in (
                session.step,
                session.run,
                session.save,
                session.result,
                lambda: session["plant.eta.x"],
                lambda: session.__setitem__("plant.disturbance.u", 1.0),
                lambda: session.__setitem__("plant.force.x", 1.0),
                lambda: session.reset("plant"),
            ):
                with pytest.raises(InputError, match="another thread is in a call of this session"):
                    call()
            go_on.set()
        assert first.result() is False
    assert session.status == "finished"
