"""What FMUs write to standard output and standard error, as log lines with a limit."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from typing import Final

MOST_LINES: Final = 1000
"""Lines of one stream that are logged in a run; the rest is counted."""
_LONGEST: Final = 4096
_LAST: Final = 3


class Output:
    """The lines of one stream of the child.

    Attributes
    ----------
    last : its latest lines.
    ended : whether it is closed.
    """

    def __init__(self, descriptor: int, name: str, level: str) -> None:
        self.descriptor, self._name, self._level = descriptor, name, level
        self.last: deque[str] = deque(maxlen=_LAST)
        self.ended = False
        self._rest = b""
        self._count = 0

    def read(self, note: Callable[[str, str, str], None], *, most: int = 1 << 20) -> None:
        """Log what is there now; `note` takes name, level and message."""
        while most > 0:
            try:
                data = os.read(self.descriptor, 1 << 16)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self.ended = True
                return
            most -= len(data)
            *lines, self._rest = (self._rest + data).split(b"\n")
            for line in lines:
                self._log(line, note)
            if len(self._rest) > _LONGEST:
                self._log(self._rest, note)
                self._rest = b""

    def end_run(self, note: Callable[[str, str, str], None]) -> None:
        """Log an unfinished line, and how many were left out."""
        if self._rest:
            self._log(self._rest, note)
        if self._count > MOST_LINES:
            left_out = self._count - MOST_LINES
            note("master", "warning", f"{left_out} lines of {self._name} were left out of the log")
        self._rest, self._count = b"", 0
        self.last.clear()

    def _log(self, raw: bytes, note: Callable[[str, str, str], None]) -> None:
        line = raw[:_LONGEST].decode("utf-8", "replace").rstrip("\r").replace("\0", "")
        self._count += 1
        if line.strip():
            self.last.append(line)
        if self._count <= MOST_LINES:
            note(self._name, self._level, line)
        elif self._count == MOST_LINES + 1:
            what = f"more than {MOST_LINES} lines of {self._name}: the rest is left out"
            note("master", "warning", what)
