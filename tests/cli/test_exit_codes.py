"""Every error leaves with the code that the README gives it, and with its message."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from cli.shell import cosim
from shared import sampled

from cosim.core import (
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

    monkeypatch.setattr("cosim.scenario.load", fails)
    monkeypatch.delenv("COSIM_DEBUG", raising=False)
    result = cosim("run", "paper-example", "--json", cwd=tmp_path)
    assert result.code == code
    assert result.error["exit_code"] == code
    wanted = "interrupted" if kind is KeyboardInterrupt else "this went wrong"
    assert wanted in result.error["what"]


WHILE_LOADING = """
import signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "cosim.cli.application":
            signal.raise_signal(signal.SIGINT)

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


FEW = """
title = "one FMU"
run = { end = 0.1, step = 0.05 }
components.plant.fmu = "DelayedPlant"
"""
VARIED = """
title = "two runs"
scenario = "few.toml"
vary = [{ kind = "grid", name = "until", path = "run.end", values = [0.05, 0.1] }]
metrics = { end = "status" }
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="limits are those of POSIX")
@pytest.mark.parametrize(
    "line", sampled(["study run varied.toml", "run few.toml", "fmu check it.fmu --run"], 1)
)
def test_too_few_descriptors_are_named(line: str, tmp_path: Path) -> None:
    """Whatever the limit: done, or refused with what to do; never "unexpected"."""
    (tmp_path / "few.toml").write_text(FEW)
    (tmp_path / "varied.toml").write_text(VARIED)
    assert cosim("fmu", "build", "paper", "-o", "it.fmu", cwd=tmp_path).code == 0
    assert cosim("run", "few.toml", cwd=tmp_path).code == 0  # its FMU is built
    named = 0
    for most in (6, 9, 12, 15):
        code = f"import resource; resource.setrlimit(resource.RLIMIT_NOFILE, ({most}, {most}))"
        start = f"{code}; from cosim.cli import main; main()"
        words = [sys.executable, "-c", start, *line.split()]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603 - ours
        assert "unexpected" not in done.stderr
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode in (0, 2, 4), done.stderr
        named += "ulimit -n" in done.stderr
    assert named, done.stderr
