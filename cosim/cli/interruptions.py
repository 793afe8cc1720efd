"""Ctrl-C and SIGTERM of a command: from its first line to its last none is swallowed.

While modules are loading there is nothing to put away: the process leaves at once. While a command
works, a signal raises an exception there, and does so again until something handles it: Python and
extension modules drop exceptions in destructors, in callbacks and while they import. When the
command is over its end stands, printed and with its exit code; a second signal cuts it off.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Literal

_AGAIN_S = 0.2
_LOADING = b"interrupted while loading, before any work began\n"


class Ended(SystemExit):
    """Raised on SIGTERM, so that traces are closed and temporary folders removed."""


class Interruptions:
    """The signals of this process.

    Attributes
    ----------
    number : of the first one that came while the command worked; 0: none did.
    """

    def __init__(self) -> None:
        self.number = 0
        self._stage: Literal["loading", "working", "over"] = "loading"
        self._process = os.getpid()
        self._before: dict[int, Any] = {}

    def take(self) -> None:
        """Take the signals; those that this process ignores, or another handler has, stay so."""
        if threading.current_thread() is not threading.main_thread():
            return
        usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
        for number, handler in usual.items():
            if signal.getsignal(number) is handler:
                self._before[number] = signal.signal(number, self._note)

    def give_back(self) -> None:
        """Give back the signals as they were."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    @contextmanager
    def raised(self) -> Iterator[None]:
        """Raise `KeyboardInterrupt` and `Ended` in a block; afterwards the command is over."""
        taken_here = not self._before
        if taken_here:
            self.take()
        hook, sys.unraisablehook = sys.unraisablehook, self._unraisable
        alarm = signal.signal(signal.SIGALRM, self._again) if _can_repeat(self._before) else None
        self.number, self._stage = 0, "working"
        try:
            yield
        finally:
            self._stage = "over"
            if alarm is not None:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                signal.signal(signal.SIGALRM, alarm)
            sys.unraisablehook = hook
            if taken_here:
                self.give_back()

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if os.getpid() != self._process:  # a fork that has not its own handlers yet
            os._exit(128 + number)
        if self._stage == "loading":
            os.write(2, _LOADING)
            os._exit(128 + number)
        if self._stage == "over":
            signal.signal(number, signal.SIG_DFL)
            return
        self.number = self.number or number
        if _can_repeat(self._before):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        raise Ended(128 + number) if number == signal.SIGTERM else KeyboardInterrupt

    def _again(self, _number: int, _frame: FrameType | None) -> None:
        """Deliver the signal again unless it is being handled, to whoever has it now."""
        if self._stage != "working":
            return
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        if not _is_handled(sys.exc_info()[1]):
            if signal.getsignal(self.number) != self._note:  # a run has begun, and will end for it
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.raise_signal(self.number)

    def _unraisable(self, dropped: Any) -> None:
        """Leave out the traceback of a signal's exception that Python drops: it comes again."""
        if not issubclass(dropped.exc_type, (KeyboardInterrupt, Ended)):
            sys.__unraisablehook__(dropped)


def _can_repeat(taken: dict[int, Any]) -> bool:
    return bool(taken) and hasattr(signal, "setitimer")


def _is_handled(error: BaseException | None) -> bool:
    """Whether what is being handled is an interruption, or comes of one."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        if isinstance(error, (KeyboardInterrupt, Ended)):
            return True
        seen.add(id(error))
        error = error.__context__
    return False


interruptions = Interruptions()
"""Those of the command, which is one per process."""
