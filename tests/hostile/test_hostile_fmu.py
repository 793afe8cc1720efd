"""The hostile FMU does what its parameters say; what needs no supervision of runs."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest
from hostile.expected import VERSIONS, Row, rows
from hostile.hostile_fmu import CALLS, FAULTS, Counts, counts_in, hostile_fmu, misbehaviour
from hostile.judged import departures
from hostile.runs import STEPS, run_row
from shared import sampled

_SIMULATE = """
import sys
import fmpy
path, names, values = sys.argv[1], sys.argv[2].split(), map(float, sys.argv[3].split())
result = fmpy.simulate_fmu(
    path, stop_time=1.0, step_size=0.125, output_interval=0.125,
    start_values=dict(zip(names, values)), fmi_call_logger=None)
print(result["x"].tolist())
"""


def by_fmpy(fmu: Path, **parameters: float) -> subprocess.CompletedProcess[str]:
    """Eight steps of 1/8 s with u = 1 in another tool, in its own process."""
    given = {"u": 1.0, **parameters}
    words = (" ".join(given), " ".join(map(str, given.values())))
    return subprocess.run(  # noqa: S603 - our own line
        [sys.executable, "-c", _SIMULATE, str(fmu), *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.parametrize("version", VERSIONS)
def test_without_a_fault_it_is_an_integrator(tmp_path: Path, version: str) -> None:
    """In another tool, and what it counts there survives its process."""
    counts = tmp_path / "counts"
    done = by_fmpy(hostile_fmu(tmp_path, version, counts=counts))
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == str([k / 8 for k in range(9)])
    assert counts_in(counts)[:2] == (8, 8)
    assert counts_in(counts).faults == 0


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    ("fault", "code"),
    [
        *(("segfault", -11), ("abort", -6), ("kill", -9), ("exit-0", 0), ("exit-3", 3)),
        *(("stack-overflow", -11), ("double-free", -6)),
    ],
)
def test_process_ends_as_asked_at_the_time_asked(
    tmp_path: Path, fault: str, code: int, version: str
) -> None:
    """In another tool: by this signal or code, in the step from half a second on."""
    counts = tmp_path / "counts"
    fmu = hostile_fmu(tmp_path, version, counts=counts)
    done = by_fmpy(fmu, **misbehaviour(fault, "step", 0.5))
    assert (done.returncode, done.stdout) == (code, "")
    assert counts_in(counts)[:2] == (5, 4)
    assert counts_in(counts).faults == 1


@pytest.mark.parametrize("version", VERSIONS)
def test_fault_begins_at_the_nth_call_and_beyond_an_input(tmp_path: Path, version: str) -> None:
    """And not while |u| is small."""
    counts = tmp_path / "counts"
    fmu = hostile_fmu(tmp_path, version, counts=counts)
    assert by_fmpy(fmu, **misbehaviour("exit-3", nth=3, beyond=0.5)).returncode == 3
    assert counts_in(counts) == Counts(
        begun=3, done=2, got=counts_in(counts).got, set=counts_in(counts).set, faults=1
    )
    assert by_fmpy(fmu, **misbehaviour("exit-3", nth=3, beyond=1.5)).returncode == 0


def test_settings_in_the_fmu_are_in_force_before_any_parameter_is_set(tmp_path: Path) -> None:
    """While the library is loaded, and in the instantiation."""
    for call in ("load", "instantiate"):
        fmu = hostile_fmu(tmp_path, "2.0", f"at_{call}", fault="exit-3", call=call)
        assert by_fmpy(fmu).returncode == 3


@pytest.mark.parametrize("version", VERSIONS)
def test_numbers_are_wrong_as_asked(tmp_path: Path, version: str) -> None:
    """Not a number, infinite, constant, and growing until no number holds it."""
    fmu = hostile_fmu(tmp_path, version)

    def last(fault: str) -> float:
        done = by_fmpy(fmu, **misbehaviour(fault, at=0.5))
        return float(done.stdout.strip("[]\n").split(",")[-1])

    assert math.isnan(last("not-a-number"))
    assert last("infinite") == math.inf
    assert last("huge-constant") == 1.5e6
    assert last("grow") == pytest.approx(0.625e40, rel=0.7)


def test_every_fault_and_call_has_its_rows() -> None:
    """And the names of the model descriptions are those of the C file."""
    assert {row.fault for row in rows()} == set(FAULTS[1:])
    assert {row.call for row in rows()} == set(CALLS)
    assert (FAULTS[:2], CALLS[0], CALLS[-1]) == (("nothing", "segfault"), "load", "state")


@pytest.mark.parametrize("version", VERSIONS)
def test_scenario_of_the_table_runs_where_nothing_happens(tmp_path: Path, version: str) -> None:
    """Every row is that of its equations, bit for bit; nothing is left."""
    found = run_row(Row("nothing", "step", version), tmp_path)
    assert departures(found) == []
    assert (found.rows_kept, found.rows_run) == (STEPS + 1, STEPS + 1)


@pytest.mark.parametrize(
    "row",
    sampled(
        [
            Row("segfault", "reset", "2.0"),
            Row("exit-0", "state", "3.0"),
            Row("hang", "state", "2.0"),
        ],
        1,
    ),
    ids=lambda row: row.name,
)
def test_check_reports_a_fault_in_calls_that_no_run_makes(tmp_path: Path, row: Row) -> None:
    """`cosim fmu check --run`: the call, and how the process ended."""
    assert departures(run_row(row, tmp_path)) == []
