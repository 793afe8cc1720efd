"""Flush a trace by the clock, also during a step that takes minutes."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable

from cosim.trace.file.disk import Guard


class Flusher:
    """A thread that flushes, so that no row waits in memory for longer than the interval.

    It flushes after half the interval, so that the interval is kept on a busy machine too.

    Parameters
    ----------
    guard : held while flushing.
    flush : a method that hands everything to the operating system; kept by a weak reference.
    interval_s : longest time that a row waits [s].
    """

    def __init__(self, guard: Guard, flush: Callable[[], None], interval_s: float) -> None:
        self.after_s = interval_s / 2
        self._guard = guard
        self._flush = weakref.WeakMethod(flush)
        self._since: float | None = None
        self._waiting = threading.Event()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def asks(self) -> bool:
        """Whether to call `due` for a row just written; for callers without the guard."""
        since = self._since
        return since is None or time.monotonic() - since >= self.after_s

    def due(self) -> bool:
        """Register a row just written, and return whether to flush now (guard held)."""
        if self._since is None:
            self._since = time.monotonic()
            self._waiting.set()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="trace", daemon=True)
                self._thread.start()
            return False
        return self.asks()

    def flushed(self) -> None:
        """Register that nothing waits any more (guard held)."""
        self._since = None
        self._waiting.clear()

    def stop(self) -> None:
        """End the thread; the caller may hold the guard."""
        self._stop.set()
        self._waiting.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(1.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            self._waiting.wait()
            since = self._since
            left = self.after_s if since is None else since + self.after_s - time.monotonic()
            if left > 0:
                self._stop.wait(left)
            # the thread that stops this one may hold the guard: wait for it in short turns
            elif self._guard.lock.acquire(timeout=0.05):
                try:
                    if not self._attend():
                        return
                finally:
                    self._guard.lock.release()

    def _attend(self) -> bool:
        """Flush if still due; return False when the trace is closed or gone."""
        flush = self._flush()
        if flush is None or not self._guard.open:
            return False
        if self._since is not None and self.asks():
            try:
                flush()
            except OSError as error:
                self._guard.fail(error)
                return False
        return True
