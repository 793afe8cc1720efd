"""Faults of event mode, of Clocks and of C++ in the command line, and of numbers in a session."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hostile.eventful import (
    AT_S,
    AT_START,
    CALLS,
    END_S,
    FAULTS,
    JUMP,
    STEP_S,
    Row,
    departures,
    eventful_fmu,
    expectation,
    number_rows,
    parameters,
    rows,
    run_row,
)
from shared import sampled, share_of

from cosim.core import ComponentError
from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, Endpoint, Observer, Session, System, make_schedule

_TESTS = Path(__file__).parents[1]
SAMPLE = (
    Row("hang", "step"),
    Row("past", "step"),
    Row("throw", "step", "3.0 C++"),
    Row("exit-0", "update"),
    Row("tiny", "update"),
    Row("long", "log"),
    Row("after-the-end", "free"),
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


@pytest.mark.parametrize(
    "row", sampled([Row("long", "text"), Row("hang", "jump")], 1), ids=lambda row: row.name
)
def test_isolated_component_is_judged_in_its_process(tmp_path: Path, row: Row) -> None:
    """What it returned is named as that of any other component is."""
    assert departures(run_row(row, tmp_path, isolate=True)) == []


@pytest.mark.slow
@pytest.mark.parametrize("row", share_of([*rows()][::4]), ids=lambda row: row.name)
def test_every_fourth_row_isolated(tmp_path: Path, row: Row) -> None:
    """As where the component is not isolated."""
    assert departures(run_row(row, tmp_path, isolate=True)) == []


def session_of(
    row: Row, folder: Path, *flags: str, event_mode: bool = True, observers: Sequence[Observer] = ()
) -> Session:
    """The two components of the table in a session, without a trace and unsupervised."""
    fmu = describe_fmu(eventful_fmu(folder, *flags))
    components = {
        "h": Component(fmu, parameters(row), event_mode=event_mode, intermediate=["y"]),
        "s": Component(fmu, event_mode=event_mode),
    }
    ends = Endpoint("h", "y"), Endpoint("s", "u"), Endpoint("s", "y"), Endpoint("h", "u")
    wires = [Connection(*ends[:2]), Connection(*ends[2:])]
    schedule = make_schedule({}, round(STEP_S * 1e9), round(END_S * 1e9), "align")
    return Session(System(components, wires, {}, {}, schedule), observers)


@pytest.mark.parametrize("row", [*number_rows()], ids=lambda row: row.name)
def test_number_is_judged_before_it_is_used(tmp_path: Path, row: Row) -> None:
    """A false one is an error that names component, call and number; each row has its own time."""
    expected = expectation(row)
    if row.call in AT_START and not expected.whole:
        with pytest.raises(ComponentError) as caught, session_of(row, tmp_path):
            pass
        assert all(re.search(word, caught.value.text()) for word in expected.words)
        return
    with session_of(row, tmp_path) as session:
        session.go_on()
        run = session.result(complete=True)
    assert (run.status,) == expected.statuses
    assert all(re.search(word, run.reason or "") for word in expected.words)
    assert np.abs(run.signal("h", "y") - run.points_ns / 1e9).max() < 1e-8
    if run.status == "failed" and "end" not in (run.reason or ""):
        assert run.cause is not None
        assert (run.cause.kind, run.cause.component) == ("refused", "h")
        assert run.cause.call is not None


@pytest.mark.parametrize(
    "row", [Row("large", "binary"), Row("long", "text")], ids=lambda row: row.name
)
def test_sizes_are_judged_without_event_mode_too(tmp_path: Path, row: Row) -> None:
    """The rows before it are kept."""
    with session_of(row, tmp_path, event_mode=False) as session:
        session.go_on()
        run = session.result(complete=True)
    assert run.status == "failed"
    assert all(re.search(word, run.reason or "") for word in expectation(row).words)
    assert run.count == round(AT_S / STEP_S)


def test_every_fault_and_call_has_its_rows() -> None:
    """And a number that is wrong is one that is judged."""
    assert {row.fault for row in rows()} == {*FAULTS[1:], "throw"}
    assert {row.call for row in rows() if row.fault != "throw"} == {*CALLS, JUMP}


_TWO_SESSIONS = """
import gc, os, sys
from pathlib import Path
from hostile.eventful import Row
from hostile.test_hostile_events import Lines, session_of
for fault in ("after-the-end", "nothing"):
    lines = Lines()
    row = Row(fault, "free")
    with session_of(row, Path(sys.argv[1]), "-Wl,-z,nodelete", observers=[lines]) as session:
        session.go_on()
        assert session.status == "finished", session.status
    del session
    gc.collect()
print(lines.found, flush=True)
os._exit(0)  # the library speaks once more when the process ends
"""


class Lines(Observer):
    """Keeps what FMUs say."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Keep it, but for the master's."""
        del time_ns, level
        self.found += [message] * (name != "master")


@pytest.mark.skipif(sys.platform != "linux", reason="a library that stays is made for ELF")
def test_callbacks_of_a_freed_instance_may_be_called_by_a_later_one(tmp_path: Path) -> None:
    """The library is not unloaded, as many in C++ are not, and keeps them in a static variable.

    Nobody hears what it says by them.
    """
    done = subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-c", _TWO_SESSIONS, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(_TESTS), str(_TESTS.parent)])},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr
