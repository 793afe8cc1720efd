"""What commands load before they work: few modules, and none that another verb needs.

Counts of modules and the absence of heavy ones, which no busy machine changes;
`tests/benchmarks/start.py` measures the seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from shared import fmu_store, home

FORMULAS = ("markdown_it", "latex2mathml", "pythonfmu")
SOLVERS = ("cvxpy", "clarabel", "scipy.linalg", "scipy.optimize")
EXTRAS = ("matplotlib", "pandas", "pyarrow", "plotly", "dask", "elftools", "pefile", "macholib")
NEVER = (*SOLVERS, *FORMULAS, *EXTRAS, "pint", "pycparser", "numpy.ma", "rich.progress", "asyncio")


@cache
def modules_of(*arguments: str) -> frozenset[str]:
    """The modules that a command loads, in a process of its own and without its children's."""
    folder = home() / "start"
    folder.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(  # noqa: S603 - our own command
        [sys.executable, "-X", "importtime", "-m", "cosim", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = (line for line in done.stderr.splitlines() if line.startswith("import time:"))
    return frozenset(line.rpartition("|")[2].strip() for line in lines)


def heavy(found: frozenset[str], names: tuple[str, ...]) -> list[str]:
    return [name for name in names if name in found]


@pytest.mark.parametrize(
    ("arguments", "most"),
    [(("--help",), 230), (("run", "--help"), 420), (("trace", "--help"), 420)],
    ids=["cosim", "cosim run", "cosim trace"],
)
def test_help_loads_neither_arrays_nor_scenarios(arguments: tuple[str, ...], most: int) -> None:
    """A help text needs the command line, and nothing that the command would do."""
    found = modules_of(*arguments)
    unwanted = (*NEVER, "numpy", "fmpy", "flint", "google.protobuf", "mcap", "cosim.master.system")
    assert heavy(found, unwanted) == []
    assert len(found) < most


def test_scenarios_are_listed_without_what_flies_them() -> None:
    """Their files are read; no FMU, no proof, no network of links is made."""
    found = modules_of("scenario", "list")
    unwanted = (*NEVER, "fmpy", "flint", "google.protobuf", "cosim.scenario.assembly")
    assert heavy(found, unwanted) == []
    assert len(found) < 600


def test_a_run_loads_what_flies_and_no_more() -> None:
    """No solver, no page of an FMU, no exporter, no extra, no other verb."""
    run = ("run", "paper-example", "--fmus", fmu_store("native"), "--flavour", "native")
    modules_of(*map(str, run))  # may compute GUIDs, which are kept
    modules_of.cache_clear()
    found = modules_of(*map(str, run))
    own = ("cosim.hinf.synthesis.designs", "cosim.hinf.lmi.problem", "cosim.scenario.demo")
    more = (
        "cosim.fmu.isolation.proxy",
        "cosim.fmu.export.native.native_package",
        "cosim.study.schema",
    )
    assert heavy(found, (*NEVER, *own, *more, "rich.markdown", "scipy")) == []
    assert len(found) < 900
    assert "cosim.master.system" in found  # the count is of the run, not of an early end


def test_reading_a_trace_loads_no_fmu_and_no_scenario() -> None:
    trace = Path(__file__).parents[2] / "traces" / "reference"
    found = modules_of("trace", "info", str(next(iter(sorted(trace.glob("*.mcap"))))))
    assert (
        heavy(found, (*NEVER, "fmpy", "flint", "cosim.scenario.schema", "cosim.fmu.fmu_slave"))
        == []
    )
