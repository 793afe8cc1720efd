"""The sub-commands are loaded when they are used, and what is said of them before is true."""

from __future__ import annotations

import subprocess
import sys

import pytest

from cosim.cli.verbs import TRACE_VERBS, VERBS, loaded

EVERY = VERBS | TRACE_VERBS

LOADED = """
import sys
from cosim.cli import main
sys.argv = ["cosim", *sys.argv[1:]]
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.mark.parametrize("name", EVERY)
def test_a_verb_says_of_itself_what_the_list_says(name: str) -> None:
    """Name, first sentence of its help, and whether it is listed."""
    verb = EVERY[name]
    command = loaded(name, verb)
    listed = " ".join((command.help or "").partition("\n\n")[0].split())
    assert (command.name, listed, command.hidden) == (name, verb.help, verb.hidden)


def modules(*words: str) -> tuple[str, set[str]]:
    """Return what a command prints, and the modules that it loads."""
    line = [sys.executable, "-c", LOADED, *words]
    done = subprocess.run(line, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert "typer" in done.stderr.split()
    return done.stdout, set(done.stderr.split())


def test_the_list_of_verbs_loads_none_of_them() -> None:
    """Neither NumPy nor SciPy nor what reads FMUs: a start takes a tenth of the time."""
    printed, found = modules("--help")
    assert all(f" {name} " in printed for name in VERBS if name != "scenarios")
    assert not {"numpy", "scipy", "fmpy", "cvxpy", "mcap"} & found


def test_reading_a_trace_loads_nothing_that_runs_or_designs() -> None:
    """The reader alone: `info` answers in half a second."""
    printed, found = modules("trace", "info", "traces/reference/paper-example.mcap")
    assert "paper-example" in printed
    assert not {"cosim.scenario", "cosim.hinf", "cosim.fmu", "scipy", "fmpy"} & found
