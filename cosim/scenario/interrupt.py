"""Ctrl-C, or the order to end (SIGTERM), while components compute.

A Python FMU runs in this interpreter: a `KeyboardInterrupt` that is raised within its step is
swallowed there and comes back as a component that failed. While a run goes the first signal is
therefore only noted, and acted upon between two steps; a second one, for a component that does
not come back, acts at once.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any, Self


class Interruptible:
    """`with Interruptible() as wish:` the steps, each followed by `wish.obey()`."""

    def __init__(self) -> None:
        self._wished = 0
        self._before: dict[int, Any] = {}

    def obey(self) -> None:
        """Leave if that was asked for since the beginning.

        `KeyboardInterrupt` after Ctrl-C, `SystemExit` (143) after SIGTERM.
        """
        if self._wished == signal.SIGINT:
            raise KeyboardInterrupt
        if self._wished:
            raise SystemExit(128 + self._wished)

    def __enter__(self) -> Self:
        # elsewhere than in the main thread nobody gets signals, and nobody may ask for them
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self._wished = number
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __exit__(self, *_: object) -> None:
        self._restore()
