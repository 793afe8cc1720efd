"""Handle Ctrl-C and SIGTERM while components compute.

A Python FMU runs in this interpreter: a `KeyboardInterrupt` raised within its step would be
swallowed there and reported as a failed component. During a run the first signal is therefore
only noted, said, and raised between two steps; a second one, for a step that never returns, acts
at once.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import TYPE_CHECKING, Any, Self

from cosim.core import say_at_once

if TYPE_CHECKING:
    from cosim.scenario.outcome import Outcome


class DeferredInterrupt:
    """Note Ctrl-C and SIGTERM during a step; `raise_if_requested()` raises them after it.

    A context manager that can be entered again: it notes what comes from then on.
    """

    def __init__(self) -> None:
        self._requested = 0
        self._before: dict[int, Any] = {}

    @property
    def requested(self) -> int:
        """The number of the signal, or 0."""
        return self._requested

    def raise_if_requested(self) -> None:
        """Raise `KeyboardInterrupt` after Ctrl-C, `SystemExit` (143) after SIGTERM."""
        if self._requested == signal.SIGINT:
            raise KeyboardInterrupt
        if self._requested:
            raise SystemExit(128 + self._requested)

    def __enter__(self) -> Self:
        self._requested, self._before = 0, {}
        # Python allows signal handlers in the main thread only
        if threading.current_thread() is threading.main_thread() and not _ignored():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self._requested = number
        self._restore()
        say_at_once(
            "interrupted: the run ends between two steps, and what it recorded is kept; "
            "a second time ends it at once"
        )

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __exit__(self, *_: object) -> None:
        self._restore()


def _ignored() -> bool:
    """Whether this process ignores Ctrl-C, as a child that is supervised does."""
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


class InterruptedRun(KeyboardInterrupt):
    """Raised after Ctrl-C, when the trace is finished and the components are ended."""

    exit_code = 128 + signal.SIGINT

    def __init__(self, outcome: Outcome) -> None:
        super().__init__()
        self.outcome = outcome


class TerminatedRun(SystemExit):
    """Raised after SIGTERM, when the trace is finished and the components are ended."""

    exit_code = 128 + signal.SIGTERM

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(self.exit_code)
        self.outcome = outcome
