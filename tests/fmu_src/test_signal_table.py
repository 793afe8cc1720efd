"""A table of signals is exact at its instants, linear between, held outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raw_fmu import RawFmu

from cosim.fmu import build_fmu
from cosim.fmu.export import component_module

MOST_NUMBERS = component_module("signal_table.variables").MOST_NUMBERS
table_spec = component_module("signal_table.variables").table_spec

INSTANTS = [0, 100_000_000, 130_000_001, 400_000_000]
ROWS = [[1.0, 0.1], [2.0, -0.1], [1 / 3, 1e300], [-4.0, 1e-300]]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = table_spec("Signals", [("a.x", "m"), ("b", None)], INSTANTS, ROWS, 0.05)
    return build_fmu(spec, tmp_path_factory.mktemp("table"), "native")


def test_values_at_the_instants_are_those_of_the_table(table: Path) -> None:
    with RawFmu(table) as raw:
        raw.initialise()
        found = [raw.get("a.x", "b")]
        for before, after in zip(INSTANTS, [*INSTANTS[1:], 10**9], strict=True):
            raw.step(before / 1e9, (after - before) / 1e9)
            found.append(raw.get("a.x", "b"))
    assert found == [*ROWS, ROWS[-1]]


def test_between_two_instants_it_is_linear(table: Path) -> None:
    with RawFmu(table) as raw:
        raw.initialise()
        found = []
        for k in range(50):
            raw.step(k / 100, 1 / 100)
            found.append(raw.get("a.x")[0])
    times = np.arange(1, 51) / 100
    wanted = np.interp(times, np.array(INSTANTS) / 1e9, [row[0] for row in ROWS])
    assert np.allclose(found, wanted, rtol=0, atol=1e-14)


def test_saved_table_goes_on_as_it_would_have(table: Path) -> None:
    with RawFmu(table) as raw:
        raw.initialise()
        raw.step(0.0, 0.11)
        data = raw.saved()
        raw.step(0.11, 0.1)
        once = raw.get("a.x", "b")
        raw.resume(data)
        raw.step(0.11, 0.1)
        assert raw.get("a.x", "b") == once


def test_run_that_starts_later_reads_the_table_at_its_own_time(table: Path) -> None:
    with RawFmu(table) as raw:
        raw.initialise(start=0.1)
        assert raw.get("a.x", "b") == ROWS[1]


def test_table_too_long_for_an_fmu_is_refused() -> None:
    rows = [[0.0]] * (MOST_NUMBERS + 1)
    with pytest.raises(ValueError, match="at most"):
        table_spec("T", [("a", None)], list(range(len(rows))), rows, 0.1)
