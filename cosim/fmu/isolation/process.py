"""The process of an isolated slave: forked where that is clean, else a fresh interpreter.

A fork has whatever FMUs have left in this process: their static variables, and the Python modules
of pythonfmu slaves. So it is taken only as long as no FMU has been loaded here.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Iterable
from multiprocessing.connection import Pipe
from typing import Any, Final, Literal

import cosim.fmu.isolation.server as of_server
from cosim.core import ComponentError, death_of, flush_output, private_memory
from cosim.fmu.binary import has_loaded
from cosim.fmu.description import FmuDescription
from cosim.fmu.isolation.channel import (
    DATA,
    FUTEX,
    Channel,
    SharedMemory,
    channel_library,
    make_channel,
    reserve,
)
from cosim.fmu.isolation.messages import READY, unpacked

TICK_S: Final = 0.02
"""Between two looks at whether a process that is waited for still lives."""
_PATIENCE_S: Final = 1.0
_SPAWN: Final = "import sys; from cosim.fmu.isolation.server import main; main(*sys.argv[1:])"


def start_method() -> Literal["fork", "spawn"]:
    """Return how the process of a slave is started here and now."""
    can_fork = sys.platform == "linux" and hasattr(os, "fork")
    return "fork" if can_fork and not has_loaded() else "spawn"


class SlaveProcess:
    """A process for one isolated slave; `close` ends it.

    Parameters
    ----------
    component : its name, in messages.
    description : of its FMU, with the lengths of arrays that it will have.
    call_limit : of one call during the run [s of wall-clock time]; None: no limit.

    Raises
    ------
    InputError : a system on which components cannot be isolated, or no C compiler.

    Attributes
    ----------
    connection : messages (`cosim.fmu.isolation.messages`).
    number : of the process.
    memory_at_start : that it has before it loads anything [bytes]; None if unknown.
    """

    def __init__(
        self, component: str, description: FmuDescription, *, call_limit: float | None = None
    ) -> None:
        self.component, self.call_limit = component, call_limit
        self.memory_at_start: int | None = None
        self._status: int | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._guard = threading.Lock()
        library = channel_library()
        ports = description.ports.values()
        size = DATA + 8 + sum(4 + 8 * port.size for port in ports)
        descriptor = reserve(size)
        self._memory = SharedMemory(descriptor, size)
        self.connection, theirs = Pipe(duplex=True)
        self._bells, bells_there = _bells()
        ends = (theirs.fileno(), descriptor, *bells_there)
        given = (*ends, size, os.getpid(), library._name)  # noqa: SLF001 - where it was loaded from
        if start_method() == "fork":
            self.number = _forked(ends, given)
        else:
            self._process = subprocess.Popen(  # noqa: S603 - ourselves
                [sys.executable, "-c", _SPAWN, *map(str, given)],
                pass_fds=[end for end in ends if end >= 0],
                stdin=subprocess.DEVNULL,
            )
            self.number = self._process.pid
        theirs.close()
        _close(descriptor, *bells_there)

    def wait_until_ready(self) -> None:
        """Wait until it can be asked for something.

        Raises
        ------
        ComponentError : it has ended.
        """
        with contextlib.suppress(EOFError, OSError):
            while not self.connection.poll(TICK_S):
                if self.exit_status() is not None:
                    break
            else:
                if unpacked(self.connection.recv_bytes()) == (READY,):
                    self.memory_at_start = private_memory(self.number)
                    return
        raise ComponentError(
            "the process of an isolated component did not start",
            where=f"component {self.component!r}",
            got=f"it {death_of(self.kill()).words}",
            hint="its standard error may say why; or isolate = false",
        )

    def channel(self, look: int = 0) -> Channel:
        """Make the master's side of its channel; see `make_channel`."""
        return make_channel(self._memory, self._bells, look)

    def exit_status(self) -> int | None:
        """Return None while it lives, then its exit code, or minus the signal that ended it."""
        with self._guard:
            if self._status is None and self._process is not None:
                self._status = self._process.poll()
            elif self._status is None:
                try:
                    number, status = os.waitpid(self.number, os.WNOHANG)
                except ChildProcessError:  # somebody else has waited for it
                    number, status = self.number, 255 << 8
                if number:
                    self._status = os.waitstatus_to_exitcode(status)
            return self._status

    def wait(self, patience_s: float) -> int:
        """Return its exit status as soon as it has ended; end it after `patience_s`."""
        until = time.monotonic() + patience_s
        while (status := self.exit_status()) is None and time.monotonic() < until:
            time.sleep(0.001)
        return self.kill() if status is None else status

    def kill(self) -> int:
        """End it at once, if it still lives; return its exit status."""
        while (status := self.exit_status()) is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.number, signal.SIGKILL)
            time.sleep(0.001)
        return status

    def close(self) -> None:
        """Let it leave, or end it."""
        if self.connection.closed:
            return
        self.connection.close()
        channel = self.channel()
        channel_library().announce_message(ctypes.addressof(channel))
        self.wait(_PATIENCE_S)
        _close(*self._bells)


def _bells() -> tuple[tuple[int, int], tuple[int, int]]:
    """Return own and other bell of the master and of the slave: pipes where there is no futex."""
    if FUTEX:
        return (-1, -1), (-1, -1)
    of_master, of_slave = os.pipe(), os.pipe()
    for end in (*of_master, *of_slave):
        os.set_blocking(end, False)
    return (of_master[0], of_slave[1]), (of_slave[0], of_master[1])


def _forked(ends: Iterable[int], given: tuple[Any, ...]) -> int:
    """Fork the process; return its number."""
    flush_output()  # else both would write what is kept
    with warnings.catch_warnings():
        # other threads do not exist in the child, which uses none of their locks
        warnings.simplefilter("ignore", DeprecationWarning)
        number = os.fork()
    if number:
        return number
    try:
        kept = {0, 1, 2, *ends}
        for name in os.listdir("/dev/fd"):  # noqa: PTH208 - names are numbers
            if int(name) not in kept:
                _close(int(name))
        of_server.main(*given)
    finally:
        os._exit(70)


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        with contextlib.suppress(OSError):
            os.close(descriptor)
