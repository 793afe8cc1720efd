"""Flushing by the clock, also while nobody writes: a component may compute for minutes."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable

from cosim.trace.disk import Guard


class Flusher:
    """Sees to it that no row waits in memory for longer than the interval.

    A thread that sleeps while there is nothing to flush. It begins when half the interval is
    over, so that a busy machine still keeps to it.

    Parameters
    ----------
    guard : held while flushing.
    flush : a method; hands everything to the operating system. Kept by a weak reference.
    interval_s : [s].
    """

    def __init__(self, guard: Guard, flush: Callable[[], None], interval_s: float) -> None:
        self.after_s = interval_s / 2
        self._guard = guard
        self._flush = weakref.WeakMethod(flush)
        self._since: float | None = None
        self._waiting = threading.Event()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def due(self) -> bool:
        """Take note of a row just written (under the guard); whether it is time to flush."""
        if self._since is None:
            self._since = time.monotonic()
            self._waiting.set()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="trace", daemon=True)
                self._thread.start()
            return False
        return time.monotonic() - self._since >= self.after_s

    def flushed(self) -> None:
        """Nothing waits any more (under the guard)."""
        self._since = None
        self._waiting.clear()

    def stop(self) -> None:
        """End the thread; the caller need not hold the guard, and may."""
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
            # who stops this thread may hold the guard: look up now and then
            elif self._guard.lock.acquire(timeout=0.05):
                try:
                    if not self._attend():
                        return
                finally:
                    self._guard.lock.release()

    def _attend(self) -> bool:
        """Flush if it is still time to; whether there is anything left to do."""
        flush = self._flush()
        if flush is None or not self._guard.open:
            return False
        if self._since is not None and time.monotonic() - self._since >= self.after_s:
            try:
                flush()
            except OSError as error:
                self._guard.fail(error)
                return False
        return True
