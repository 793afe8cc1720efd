"""The sub-commands are loaded when they are used, and what is said of them before is true."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest
from cli.commands import Found, every_command

LOADED = """
import sys
from cosim.cli import main
sys.argv = ["cosim", *sys.argv[1:]]
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.mark.parametrize("found", every_command(), ids=lambda found: found.words)
def test_a_verb_says_of_itself_what_the_list_says(found: Found) -> None:
    """Name, first sentence of its help, and whether it is listed."""
    listed, command = found.listed, found.command
    assert (command.name, command.hidden) == (found.path[-1], listed.hidden)
    assert first_sentence(command) == first_sentence(listed)


def first_sentence(command: Any) -> str:
    """What the list of commands has of its help."""
    return " ".join((command.help or "").partition("\n\n")[0].split())


def modules(*words: str) -> tuple[str, set[str]]:
    """Return what a command prints, and the modules that it loads."""
    line = [sys.executable, "-c", LOADED, *words]
    done = subprocess.run(line, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert "typer" in done.stderr.split()
    return done.stdout, set(done.stderr.split())


def test_the_list_of_verbs_loads_none_of_them() -> None:
    """Neither NumPy nor SciPy nor what reads FMUs: a start takes a tenth of the time."""
    printed, found = modules("--help")
    verbs = [found for found in every_command() if len(found.path) == 1]
    hidden = {found.words for found in verbs if found.listed.hidden}
    assert hidden == {"scenarios"}
    assert all(f" {found.words} " in printed for found in verbs if found.words not in hidden)
    assert not {"numpy", "scipy", "fmpy", "cvxpy", "mcap"} & found


def test_reading_a_trace_loads_nothing_that_runs_or_designs() -> None:
    """The reader alone: `info` answers in half a second."""
    printed, found = modules("trace", "info", "traces/reference/paper-example.mcap")
    assert "paper-example" in printed
    assert not {"cosim.scenario", "cosim.hinf", "cosim.fmu", "scipy", "fmpy"} & found
