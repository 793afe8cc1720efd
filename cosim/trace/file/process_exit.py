"""Close open traces when the process ends or is terminated, and release them when it forks."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import threading
import weakref
from types import FrameType
from typing import Protocol

from cosim.core import CosimError


class Open(Protocol):
    """A trace being written."""

    def close(self) -> None:
        """Write everything and close the file."""

    def forget(self) -> None:
        """Release the file untouched: this process is a fork of the one that writes."""


_open: weakref.WeakSet[Open] = weakref.WeakSet()
_END_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
)


def register(trace: Open) -> None:
    """Close a trace at the end of the process, unless it is unregistered before.

    While traces are open, SIGTERM and SIGHUP end the process as `sys.exit` does, with 128 plus
    the number, so that traces are closed and temporary folders removed. A signal that has a
    handler keeps it; handlers are set in the main thread only, which alone gets signals.
    """
    _open.add(trace)
    if threading.current_thread() is threading.main_thread():
        for number in _END_SIGNALS:
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _leave)


def unregister(trace: Open) -> None:
    """Forget a trace that is closed, and restore the signals after the last one."""
    _open.discard(trace)
    if not _open and threading.current_thread() is threading.main_thread():
        for number in _END_SIGNALS:
            if signal.getsignal(number) is _leave:
                signal.signal(number, signal.SIG_DFL)


def _leave(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _close_all() -> None:
    for trace in list(_open):
        with contextlib.suppress(CosimError):
            trace.close()


def _forget_all() -> None:
    for trace in list(_open):
        trace.forget()
    _open.clear()


atexit.register(_close_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)
