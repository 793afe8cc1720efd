"""Shell completion: commands, options, choices and names, each as the shell asks for them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

ASKED = {
    "cosim tr": ["trace"],
    "cosim trace in": ["info", "inject"],
    "cosim run auv-acoustic-n": ["auv-acoustic-naive"],
    "cosim study run delay-m": ["delay-margin"],
    "cosim run x --check-o": ["--check-order"],
}


def completed(line: str) -> list[str]:
    """Return what bash is offered at the end of a line."""
    asked = {
        "_COSIM_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(line.split()) - 1),
    }
    done = subprocess.run(
        [sys.executable, "-m", "cosim"],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.parametrize("line", list(ASKED)[1:3])
def test_bash_is_offered_what_fits(line: str) -> None:
    """Those that begin so, and nothing else."""
    assert completed(line) == ASKED[line]


@pytest.mark.slow
@pytest.mark.parametrize("line", ASKED)
def test_every_place_is_completed(line: str) -> None:
    """The first word, a command of a group, built-in names, options."""
    assert completed(line) == ASKED[line]


def test_the_script_for_a_shell_is_printed() -> None:
    """It calls `cosim`, however the command was started."""
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "--show-completion", "bash"],
        env=os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "_COSIM_COMPLETE=complete_bash" in done.stdout
    assert "complete" in done.stdout
    assert "cosim" in done.stdout.splitlines()[-1]
