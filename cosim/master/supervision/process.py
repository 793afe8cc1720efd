"""The child process: started by fork where that exists, else as a fresh interpreter."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any, Final, Literal
from weakref import WeakSet

import cosim.master.supervision.child as of_child
from cosim.core import InputError, private_memory

Method = Literal["fork", "spawn"]
_SPAWN: Final = "import sys; from cosim.master.supervision.child import main; main(*sys.argv[1:])"
_open: WeakSet[Worker] = WeakSet()


def default_method() -> Method | None:
    """Return how children are started here; None where runs cannot be supervised (Windows)."""
    if sys.platform == "win32" or not hasattr(os, "killpg"):
        return None
    return "fork" if sys.platform == "linux" and hasattr(os, "fork") else "spawn"


class Worker:
    """A child process that executes runs, and the pipes to it.

    It is in a session of its own, so that Ctrl-C in the terminal reaches this process alone, and
    all processes that its FMUs start can be ended with it.

    Attributes
    ----------
    connection : messages (`cosim.master.supervision.messages`).
    stdout, stderr : file descriptors from which its standard streams are read.
    known : objects that a forked child has, too.
    """

    def __init__(self, method: Method, known: Sequence[Any] = ()) -> None:
        if sys.platform == "win32":
            raise InputError(
                "runs cannot be supervised on Windows", where="supervise", hint="supervise = false"
            )
        from multiprocessing import Pipe  # noqa: PLC0415 - not loaded for runs in this process

        ours, theirs = Pipe(duplex=True)
        lifeline, self._lifeline = os.pipe()
        self.stdout, out = os.pipe()
        self.stderr, err = os.pipe()
        self.connection: Connection = ours
        for descriptor in (self.stdout, self.stderr):
            os.set_blocking(descriptor, False)
        self.known = tuple(known) if method == "fork" else ()
        self._status: int | None = None
        self._process: subprocess.Popen[bytes] | None = None
        child_ends = (theirs.fileno(), lifeline, out, err)
        if method == "fork":
            self._pid = self._fork(child_ends)
        else:
            self._process = subprocess.Popen(  # noqa: S603 - ourselves
                [sys.executable, "-c", _SPAWN, *map(str, child_ends)],
                pass_fds=child_ends,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
            self._pid = self._process.pid
        theirs.close()
        for descriptor in (lifeline, out, err):
            os.close(descriptor)
        _open.add(self)
        self._memory_at_start = private_memory(self._pid)
        self._of_slaves: dict[int, int] = {}

    def _fork(self, child_ends: tuple[int, int, int, int]) -> int:
        with warnings.catch_warnings():
            # other threads do not exist in the child, which uses none of their locks
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
        if pid:
            return pid
        try:
            os.setsid()
            for worker in {*_open, self}:
                worker._close_descriptors()  # noqa: SLF001 - of the parent
            of_child.main(*child_ends, known=self.known)
        finally:
            os._exit(70)

    def exit_status(self) -> int | None:
        """Return None while it lives, then its exit code, or minus the signal that ended it."""
        if self._status is None:
            if self._process is not None:
                self._status = self._process.poll()
            else:
                try:
                    pid, status = os.waitpid(self._pid, os.WNOHANG)
                except ChildProcessError:  # somebody else has waited for it
                    pid, status = self._pid, 255 << 8
                if pid:
                    self._status = os.waitstatus_to_exitcode(status)
        return self._status

    def kill(self) -> int:
        """End it, and what its FMUs have started, at once; return its exit status."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._pid, signal.SIGKILL)
        while (status := self.exit_status()) is None:
            time.sleep(0.001)
        return status

    def let_go(self) -> None:
        """Let it leave by itself, once it has nothing to do."""
        if not self.connection.closed:
            self.connection.close()

    def close(self, patience_s: float) -> None:
        """End it: it leaves by itself, or is killed after `patience_s`."""
        self.let_go()
        until = time.monotonic() + patience_s
        while self.exit_status() is None and time.monotonic() < until:
            time.sleep(0.001)
        self.kill()
        self._close_descriptors()
        _open.discard(self)

    def _close_descriptors(self) -> None:
        if not self.connection.closed:
            self.connection.close()
        for descriptor in (self._lifeline, self.stdout, self.stderr):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def memory_used(self) -> int | None:
        """Return the memory that it has beyond what it started with [bytes]; None if unknown.

        That of the processes of its isolated slaves is included.
        """
        now = private_memory(self._pid)
        if now is None or self._memory_at_start is None:
            return None
        used = now - self._memory_at_start
        for process, at_start in self._of_slaves.items():
            used += (private_memory(process) or at_start) - at_start
        return used

    def add_process(self, process: int, at_start: int | None) -> None:
        """Count the memory of a slave's own process, beyond what that has at its start [bytes]."""
        if at_start is not None:
            self._of_slaves[process] = at_start
