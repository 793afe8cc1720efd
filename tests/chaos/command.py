"""Starts a command in a session of its own, troubles it, and looks at what it leaves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import psutil

import cosim

PATIENCE_S = 60.0
"""After that a command that has not ended hangs."""
_GRACE_S = 12.0
"""How long what it has started may live on: an orphan ends itself after some seconds."""
ENVIRONMENT = {
    "PYTHONPATH": str(Path(cosim.__file__).parents[1]),
    "COLUMNS": "200",
    "MPLBACKEND": "Agg",
    "PYTHONUNBUFFERED": "1",
}
"""Of every command: this project's, and what is printed is printed at once."""


class Ended(NamedTuple):
    """What became of a command.

    Attributes
    ----------
    code : exit code, negative for a signal, the greater of two commands; None: it hung, and was
        ended.
    seconds : from the last trouble, or the start, to its end.
    printed : both streams.
    processes_left, files_left : command lines; names in its temporary folder.
    """

    code: int | None
    seconds: float
    printed: str
    processes_left: tuple[str, ...]
    files_left: tuple[str, ...]


class Command:
    """A command that has begun.

    Attributes
    ----------
    was_over : whether it had printed its result when the first signal was sent.

    Parameters
    ----------
    line : of the command.
    folder : in which it works.
    scratch : its temporary folder, outside of that; by it its processes are known.
    before : called in the process before the command is.
    more : of `Popen`.
    """

    def __init__(
        self,
        line: Sequence[str],
        folder: Path,
        scratch: Path,
        before: Callable[[], None] | None = None,
        **more: Any,
    ) -> None:
        scratch.mkdir(exist_ok=True)
        self.folder, self.scratch = folder, scratch
        self.waits_for: list[subprocess.Popen[bytes]] = []
        self._line, self._before = line, before
        self._printed = scratch.with_suffix(".printed")
        self._since = time.monotonic()
        self.was_over: bool | None = None
        self.process = self._start(self._printed, more)

    def _start(self, printed: Path, more: Mapping[str, Any]) -> subprocess.Popen[bytes]:
        with printed.open("wb") as stream:
            usual: dict[str, Any] = {
                "env": {**os.environ, **ENVIRONMENT, "TMPDIR": str(self.scratch)},
                "stdin": subprocess.DEVNULL,
                "stdout": stream,
                "stderr": stream,
            }
            return subprocess.Popen(  # noqa: S603 - ourselves
                self._line,
                cwd=self.folder,
                start_new_session=True,
                preexec_fn=self._before,  # noqa: PLW1509 - it calls the system, no more
                **usual | more,
            )

    def start_again(self) -> None:
        """Start the same once more, beside the one that runs; what it prints counts as well."""
        self.waits_for.append(self._start(self._printed.with_suffix(".again"), {}))

    @property
    def lives(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def send(self, number: signal.Signals, *, group: bool) -> None:
        """Send a signal to its process or to its group, as a terminal does."""
        self._since = time.monotonic()
        if self.was_over is None:
            self.was_over = self._printed.stat().st_size > 0
        with suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(self.process.pid, number)

    def children(self) -> list[psutil.Process]:
        """The processes that it has started, and that live."""
        with suppress(psutil.Error):
            return psutil.Process(self.process.pid).children(recursive=True)
        return []

    def ended(self) -> Ended:
        """Wait until it has ended, and nothing of it is left that ends by itself."""
        try:
            code: int | None = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            code = None
        seconds = time.monotonic() - self._since
        for other in self.waits_for:
            with suppress(subprocess.TimeoutExpired):
                other.wait(PATIENCE_S)
            code = None if other.poll() is None else max(code or 0, other.returncode)
        end = time.monotonic() + _GRACE_S
        while code is not None and time.monotonic() < end and any(self._left()):
            time.sleep(0.1)
        left = tuple(self._ended_by_force())
        for each in (self.process, *self.waits_for):
            each.wait()
        found = [self._printed, self._printed.with_suffix(".again")]
        printed = "".join(x.read_text("utf-8", "replace") for x in found if x.exists())
        files = tuple(sorted(path.name for path in self.scratch.iterdir()))
        return Ended(code, seconds, printed, left, files)

    def _left(self) -> Iterator[psutil.Process]:
        mark = str(self.scratch)
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                ours = process.environ().get("TMPDIR") == mark
                if ours and process.status() != psutil.STATUS_ZOMBIE:
                    yield process

    def _ended_by_force(self) -> Iterator[str]:
        for process in self._left():
            with suppress(psutil.Error):
                line = " ".join(process.cmdline())
                process.kill()
                if process.pid != self.process.pid:
                    yield line


def cosim_line(*arguments: str | Path) -> list[str]:
    """The line of a command of this project."""
    return [sys.executable, "-m", "cosim", *map(str, arguments)]


def run_quietly(*arguments: str | Path, folder: Path, more: Mapping[str, str] = {}) -> None:
    """Run a command that has to go well."""
    subprocess.run(  # noqa: S603 - ourselves
        cosim_line(*arguments),
        cwd=folder,
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, **ENVIRONMENT, **more},
    )
