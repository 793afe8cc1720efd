"""The sub-commands are loaded when they are used, and what is said of them before is true."""

from __future__ import annotations

import subprocess
import sys

import pytest

from cosim.cli.verbs import VERBS, loaded

LOADED = """
import sys
from cosim.cli import main
sys.argv = ["cosim", "--help"]
try:
    main()
finally:
    print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
"""


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_says_of_itself_what_the_list_says(name: str) -> None:
    """Name, first sentence of its help, and whether it is listed."""
    command, verb = loaded(name), VERBS[name]
    listed = " ".join((command.help or "").partition("\n\n")[0].split())
    assert (command.name, listed, command.hidden) == (name, verb.help, verb.hidden)


def test_the_list_of_verbs_loads_none_of_them() -> None:
    """Neither NumPy nor SciPy nor what reads FMUs: a start takes a tenth of the time."""
    line = [sys.executable, "-c", LOADED]
    done = subprocess.run(line, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert all(f" {name} " in done.stdout for name in VERBS if name != "scenarios")
    assert "typer" in done.stderr.split()
    assert not {"numpy", "scipy", "fmpy", "cvxpy", "mcap"} & set(done.stderr.split())
