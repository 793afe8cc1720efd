"""The hostile component isolated: the verdict of the table, and nothing lost or left."""

from __future__ import annotations

import signal
from itertools import product
from pathlib import Path

import pytest
from hostile.expected import RUN_CALLS, Expectation, Row, rows
from hostile.judged import departures
from hostile.runs import Interrupt, run_row
from shared import sampled, share_of

SAMPLE = (
    Row("segfault", "step", "2.0"),
    Row("hang", "step", "3.0"),
    Row("rounding", "step", "3.0"),
)


@pytest.mark.parametrize("row", sampled(SAMPLE, 1), ids=lambda row: row.name)
def test_fault_is_named_and_nothing_is_lost_or_left(tmp_path: Path, row: Row) -> None:
    """A few rows of the table."""
    assert departures(run_row(row, tmp_path, isolate=True)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "row",
    share_of([r for r in rows() if r.call in RUN_CALLS and r.fault != "intrude"][::3]),
    ids=str,
)
def test_every_third_row_of_the_table(tmp_path: Path, row: Row) -> None:
    """As where the component is not isolated."""
    assert departures(run_row(row, tmp_path, isolate=True)) == []


OF_THE_PROGRAM = ("intrude", "truncate", "garbage", "close-all", "daemon", "trace-me")


@pytest.mark.parametrize("fault", sampled(OF_THE_PROGRAM, 2))
@pytest.mark.parametrize("isolate", [True, False])
def test_component_has_no_way_to_the_others(tmp_path: Path, fault: str, *, isolate: bool) -> None:
    """Isolated, it does not have the rows of others, and cannot write to them."""
    row = Row(fault, "step", "2.0")
    found = run_row(row, tmp_path, isolate=isolate)
    harmless = Expectation((0,), ("finished",), whole=True)
    assert departures(found, harmless if isolate and fault == "intrude" else None) == []


@pytest.mark.slow
@pytest.mark.parametrize("call", ["step", pytest.param("instantiate", marks=pytest.mark.slow)])
def test_ctrl_c_ends_a_hang(tmp_path: Path, call: str) -> None:
    """Within the second of grace, with a finished trace."""
    found = run_row(
        Row("hang-deaf", call, "2.0"),
        tmp_path,
        interrupt=Interrupt(signal.SIGINT, group=True),
        limits=False,
        isolate=True,
    )
    assert departures(found, Expectation((130,), (), ("interrupted",))) == []


@pytest.mark.parametrize(
    ("fault", "call"), sampled(product(["segfault", "exit-0", "hang"], ["get", "step"]), 1)
)
def test_run_that_is_not_supervised_survives_too(tmp_path: Path, fault: str, call: str) -> None:
    """The limit of calls holds there as well."""
    row = Row(fault, call, "3.0")
    assert departures(run_row(row, tmp_path, "--no-supervise", isolate=True)) == []


def test_component_that_kills_itself_at_the_start_leaves_a_trace_that_says_so(
    tmp_path: Path,
) -> None:
    """Not supervised, it is an error; the trace is finished and has its cause."""
    row = Row("segfault", "exit", "2.0")
    found = run_row(row, tmp_path, "--no-supervise", isolate=True)
    assert departures(found) == []
