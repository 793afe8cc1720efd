"""Ctrl-C while components compute.

A Python FMU runs in this interpreter: a `KeyboardInterrupt` that is raised within its step is
swallowed there and comes back as a component that failed. While a run goes the first Ctrl-C is
therefore only noted, and acted upon between two steps; a second one, for a component that does
not come back, acts at once.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


class Interruptible:
    """`with Interruptible() as wish:` the steps, each followed by `wish.obey()`."""

    def __init__(self) -> None:
        self._wished = False
        self._before: Any = None

    def obey(self) -> None:
        """Raise `KeyboardInterrupt` if it was asked for since the beginning."""
        if self._wished:
            raise KeyboardInterrupt

    def __enter__(self) -> Self:
        # elsewhere than in the main thread nobody gets signals, and nobody may ask for them
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        self._wished = True
        signal.signal(signal.SIGINT, self._before)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
