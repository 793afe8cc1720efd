"""Every error leaves with the code that the README gives it, and with its message."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from cli.shell import cosim

from cosim.core.errors import (
    CheckFailedError,
    ComponentError,
    CosimError,
    InputError,
    LossError,
    NotAchievableError,
    StoppedError,
)

CODES = {
    CheckFailedError: 1,
    InputError: 2,
    CosimError: 2,
    LossError: 3,
    ComponentError: 4,
    RuntimeError: 4,  # nothing that we raise: a fault of ours
    MemoryError: 4,
    NotAchievableError: 5,
    StoppedError: 130,
    KeyboardInterrupt: 130,
}


@pytest.mark.parametrize(("kind", "code"), CODES.items(), ids=lambda x: getattr(x, "__name__", ""))
def test_error_leaves_with_its_code(
    kind: type[BaseException], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process's code and the one in the JSON are the same; no traceback."""

    def fails(*_: object) -> None:
        raise kind("this went wrong")

    monkeypatch.setattr("cosim.cli.scenario.answer", fails)
    monkeypatch.delenv("COSIM_DEBUG", raising=False)
    result = cosim("scenarios", "--json", cwd=tmp_path)
    assert result.code == code
    assert result.error["exit_code"] == code
    wanted = "interrupted" if kind is KeyboardInterrupt else "this went wrong"
    assert wanted in result.error["what"]


WHILE_LOADING = """
import sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "cosim.cli.application":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Finder())
from cosim.cli.entry import main
main()
"""


def test_interruption_while_loading_exits_with_130() -> None:
    """Ctrl-C before anything runs: exit code 130 and a message."""
    line = [sys.executable, "-c", WHILE_LOADING]
    done = subprocess.run(line, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    assert done.returncode == 130
    assert done.stderr == "interrupted while loading, before any work began\n"
