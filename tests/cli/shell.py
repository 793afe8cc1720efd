"""The command line as a test calls it, and every built-in scenario flown once per process."""

from __future__ import annotations

import atexit
import json
import os
import shutil
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from tempfile import mkdtemp
from typing import Any
from unittest.mock import patch

from cosim.cli import main

BUILT_IN = (
    "auv-acoustic",
    "auv-acoustic-naive",
    "auv-direct",
    "auv-worst-case",
    "paper-example",
    "paper-worst-case",
)
COMMAND = Path(sys.executable).with_name("cosim")
SCENARIOS = Path(__file__).parents[1] / "scenario"


@dataclass(frozen=True)
class Result:
    """What a command left: exit code and both streams."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one strict JSON value: neither NaN nor Infinity."""

        def refuse(constant: str) -> None:
            raise AssertionError(f"{constant} in JSON")

        return json.loads(self.out, parse_constant=refuse)

    @property
    def error(self) -> dict[str, Any]:
        """The error object of a command that failed in --json mode; nothing else is printed."""
        assert self.code != 0
        assert "Traceback" not in self.out + self.err
        assert list(self.json) == ["error"]
        error: dict[str, Any] = self.json["error"]
        assert set(error) == {"what", "where", "expected", "got", "hint", "exit_code"}
        assert error["exit_code"] == self.code
        assert error["what"] in self.err
        return error


def cosim(*arguments: str | Path, cwd: Path) -> Result:
    """Run the command in this process, as its entry point does, from the folder `cwd`."""
    out, err = StringIO(), StringIO()
    code = 0
    line = ["cosim", *map(str, arguments)]
    # this process owns the modules that are expensive to load; the rest is as in a shell
    with (
        chdir(cwd),
        patch.object(sys, "argv", line),
        patch.dict(os.environ, {"COLUMNS": "200"}),
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return Result(code, out.getvalue(), err.getvalue())


@cache
def home() -> Path:
    """The folder of the shared flights, removed when the process ends."""
    folder = Path(mkdtemp(prefix="cosim-flights-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@cache
def flight(name: str) -> Result:
    """`cosim run NAME --json` in `home()`, once per process; the trace is `trace_of(NAME)`."""
    return cosim("run", name, "--json", cwd=home())


def trace_of(name: str) -> Path:
    """The trace of the shared flight."""
    assert flight(name).code == 0, flight(name).err
    return home() / "traces" / f"{name}.mcap"
