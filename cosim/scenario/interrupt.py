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


class DeferredInterrupt:
    """Note Ctrl-C and SIGTERM during a step; `raise_if_requested()` raises them after it."""

    def __init__(self) -> None:
        self._requested = 0
        self._before: dict[int, Any] = {}

    def raise_if_requested(self) -> None:
        """Leave if that was asked for since the beginning.

        `KeyboardInterrupt` after Ctrl-C, `SystemExit` (143) after SIGTERM.
        """
        if self._requested == signal.SIGINT:
            raise KeyboardInterrupt
        if self._requested:
            raise SystemExit(128 + self._requested)

    def __enter__(self) -> Self:
        # elsewhere than in the main thread nobody gets signals, and nobody may ask for them
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self._requested = number
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __exit__(self, *_: object) -> None:
        self._restore()
