"""The command line as a test calls it, and every built-in scenario flown once per session."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import typer.main
from shared import fmu_store, made_once

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
command_of = cache(typer.main.get_command)
"""The parser of the verbs: the same each time, and as long to build as many a verb takes."""
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


def cosim(*arguments: str | Path, cwd: Path, columns: int = 200) -> Result:
    """Run the command in this process, as a shell does in one of its own, from the folder `cwd`.

    columns : width of its terminal.
    """
    out, err = StringIO(), StringIO()
    code = 0
    line = ["cosim", *map(str, arguments)]
    # this process owns the modules that are expensive to load; the rest is as in a shell
    with (
        chdir(cwd),
        patch.object(sys, "argv", line),
        patch.object(typer.main, "get_command", command_of),
        patch.dict(os.environ, {"COLUMNS": str(columns)}),
        redirect_stdout(out),
        redirect_stderr(err),
        _as_before(),
    ):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return Result(code, out.getvalue(), err.getvalue())


@contextmanager
def _as_before() -> Iterator[None]:
    """Keep what a command leaves to the end of its process, which this one does not share."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with patch("gc.set_threshold"), patch("gc.freeze"):
            yield
    finally:
        for number, handler in handlers.items():
            if signal.getsignal(number) is not handler:
                signal.signal(number, handler)


@cache
def shared_run(name: str) -> Result:
    """`cosim run NAME --json`, once per session; the trace is `trace_of(NAME)`."""
    return Result(**json.loads((_flight(name) / "result.json").read_text("utf-8")))


def trace_of(name: str) -> Path:
    """The trace of the shared flight."""
    assert shared_run(name).code == 0, shared_run(name).err
    return _flight(name) / "traces" / f"{name}.mcap"


def _flight(name: str) -> Path:
    def run_to(folder: Path) -> None:
        result = cosim("run", name, "--json", "--fmus", fmu_store(), cwd=folder)
        (folder / "result.json").write_text(json.dumps(asdict(result)), "utf-8")

    return made_once(f"flights/{name}", run_to)
