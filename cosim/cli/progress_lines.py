"""Progress where standard error is no terminal: a plain line now and then."""

from __future__ import annotations

import time

from cosim.core import say_at_once

EACH_S = 10.0
"""Seconds before the first line, so that short commands print none, and between two."""


class ProgressLines:
    """Writes to standard error what a long task does, how much is done, and since when it works.

    A line is `cosim: 40 of 200 runs, 20 %, after 12 s`. One that cannot be written is left out: the
    task matters, not what is said of it.
    """

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._due_s = EACH_S
        self._doing, self._share = "working", 0.0

    def __call__(self, what: str, share: float) -> None:
        """Note what is done now; write a line if one is due."""
        self._doing, self._share = what, share
        self.go_on()

    def go_on(self) -> None:
        """Write a line about what was noted last if one is due."""
        seconds = time.monotonic() - self._began
        if seconds < self._due_s:
            return
        self._due_s = seconds + EACH_S
        share = f", {100.0 * self._share:.0f} %" if self._share > 0.0 else ""
        say_at_once(f"{self._doing}{share}, after {seconds:.0f} s")
