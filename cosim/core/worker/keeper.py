"""The keeper: the process between a worker and the process that wants it.

It loads no foreign code and does nothing but wait. It forks the worker, notices its end, ends what
the worker has started (whatever that did to escape: orphans below a subreaper are its children),
and tells the exit status. When the process that wants the worker is gone, or has closed its end,
the worker has `ORPHAN_S` to leave by itself. When the keeper is killed, the worker dies with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import io
import os
import pickle
import signal
import socket
import struct
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final, NoReturn

from cosim.core.processes import flush_output, prepare_for_foreign_code, private_memory
from cosim.core.worker.frames import ready_to_read

ORPHAN_S: Final = 5.0
"""How long a worker may go on that nobody listens to: it has been asked to leave, and may be doing
so."""
_IDLE_S: Final = 60.0
"""How long a keeper that is no fork of its user waits for another worker to start."""
_SWEEP_S: Final = 2.0
STARTED: Final = struct.Struct("<cqqq")
"""b"s", the numbers of keeper and worker, and the worker's memory [bytes], -1 if unknown."""
ENDED: Final = struct.Struct("<ci")
"""b"e", the exit status: a code, or minus the number of a signal."""
KILL, START = b"k", b"s"
REQUEST: Final = struct.Struct("<I")
"""Length of a `Start`, pickled; it follows `START`, with which the descriptors come."""
_BROKEN: Final = 70
_PACKAGE: Final = f"{__name__.partition('.')[0]}."
_SUBREAPER, _DEATH_SIGNAL, _DETACH = 36, 1, 17
"""PR_SET_CHILD_SUBREAPER, PR_SET_PDEATHSIG, PTRACE_DETACH of Linux."""


@dataclass(frozen=True)
class Start:
    """What a worker is to do.

    Attributes
    ----------
    target : "package.module:function", called as `function(end, descriptors, *arguments)`: the
        socket to the process that wants the worker, and the descriptors that it gave.
    folder, environment : of the process that wants the worker.
    patience_s : how long it may go on when nobody listens any more.
    modules : of this package, which a fresh keeper loads once for all its workers.
    """

    target: str
    arguments: tuple[Any, ...]
    folder: str
    environment: Mapping[str, str]
    patience_s: float
    modules: tuple[str, ...]

    @classmethod
    def here(
        cls, target: str, arguments: Sequence[Any], patience_s: float, *, loaded: bool
    ) -> Start:
        """Return it for a worker of this process; `loaded` : with the modules that are here."""
        there = list(sys.modules) if loaded else []  # other threads may be importing
        try:
            folder = str(Path.cwd())
        except OSError:  # the folder is gone
            folder = "/"
        modules = tuple(name for name in there if name.startswith(_PACKAGE))
        return cls(target, tuple(arguments), folder, dict(os.environ), patience_s, modules)

    def settle(self) -> None:
        """Give this process, which is no fork of that one, its folder and its environment."""
        os.environ.clear()
        os.environ.update(self.environment)
        os.chdir(self.folder)


def enter(
    start: Start,
    end: int,
    streams: tuple[int, int],
    given: Sequence[int],
    known: Sequence[Any] = (),
) -> NoReturn:
    """Be the worker, from here to its end.

    known : objects that a forked worker has as they are here; the target's last argument.
    """
    status = _BROKEN
    try:
        _take_streams(*streams)
        prepare_for_foreign_code()
        module, _, function = start.target.partition(":")
        more = {"known": known} if known else {}
        work = getattr(importlib.import_module(module), function)
        work(socket.socket(fileno=end), list(given), *start.arguments, **more)
        status = 0
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
    except BaseException:  # noqa: BLE001 - this process ends with it
        traceback.print_exc()
    finally:
        flush_output()
        os._exit(status)


def _take_streams(out: int, err: int) -> None:
    """Let both standard streams, of C and of Python, go where they are wanted, line by line."""
    for source, target in ((out, 1), (err, 2)):
        os.dup2(source, target)
    for source in {out, err} - {1, 2}:
        os.close(source)
    sys.stdout, sys.stderr = (
        io.TextIOWrapper(io.FileIO(number, "w", closefd=False), "utf-8", line_buffering=True)
        for number in (1, 2)
    )


def keep_forked(
    control: int,
    start: Start,
    end: int,
    streams: tuple[int, int],
    given: Sequence[int],
    known: Sequence[Any],
) -> NoReturn:
    """Be the keeper of one worker, in a fork of the process that wants it."""
    try:
        os.setsid()
        _silence([control, end, *streams, *given])
        keeper = _Keeper(socket.socket(fileno=control))
        keeper.begin(lambda: enter(start, end, streams, given, known))
        for descriptor in {end, *streams, *given} - {0, 1, 2}:
            os.close(descriptor)
        keeper.wait(start.patience_s)
    finally:
        os._exit(_BROKEN)


def keep_fresh(control: str) -> NoReturn:
    """Be a keeper in a fresh interpreter: start one worker after the other, until nobody asks."""
    if os.fork():  # nobody's child, so that nobody has to wait for it
        os._exit(0)
    try:
        os.setsid()
        connection = socket.socket(fileno=int(control))
        _silence([connection.fileno()])
        keeper = _Keeper(connection)
        while ready_to_read([connection], _IDLE_S):
            command, descriptors, _, _ = socket.recv_fds(connection, 1, 64)
            if command == KILL:  # for a worker that had just ended
                continue
            start, end, out, err, *given = _requested(connection), *descriptors
            for name in [start.target.partition(":")[0], *start.modules]:
                with contextlib.suppress(Exception):  # the worker says why
                    importlib.import_module(name)  # once for all its workers
            keeper.begin(partial(_settle_and_enter, start, end, (out, err), given))
            for descriptor in (end, out, err, *given):
                os.close(descriptor)
            keeper.wait(start.patience_s)
    except (OSError, EOFError):  # nobody is there
        pass
    finally:
        os._exit(0)


def _settle_and_enter(
    start: Start, end: int, streams: tuple[int, int], given: Sequence[int]
) -> NoReturn:
    start.settle()
    enter(start, end, streams, given)


def _requested(connection: socket.socket) -> Start:
    (size,) = REQUEST.unpack(receive_exactly(connection, REQUEST.size))
    data = receive_exactly(connection, size)
    start: Start = pickle.loads(data)  # noqa: S301 - from who wants the worker
    return start


def receive_exactly(connection: socket.socket, size: int) -> bytes:
    """Wait for so many bytes, as long as the connection waits for some; return them.

    Raises
    ------
    EOFError : the other end has closed it.
    OSError : the connection has failed, or has waited for too long.
    """
    data = bytearray()
    while len(data) < size:
        more = connection.recv(size - len(data))
        if not more:
            raise EOFError
        data += more
    return bytes(data)


class _Keeper:
    """Keeps a worker; `connection` is to the process that wants it."""

    def __init__(self, connection: socket.socket) -> None:
        gc.disable()  # what is garbage here belongs to another process
        self._connection = connection
        connection.settimeout(None)
        self._woken, self._wake = os.pipe()
        for descriptor in (self._woken, self._wake):
            os.set_blocking(descriptor, False)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._wake, warn_on_full_buffer=False)
        _process_control(_SUBREAPER, 1)
        self._worker = 0

    def begin(self, work: Callable[[], None]) -> None:
        """Fork the worker, and tell its number."""
        me = os.getpid()
        self._worker = os.fork()
        if not self._worker:
            try:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                os.setpgid(0, 0)
                for descriptor in (self._connection.fileno(), self._woken, self._wake):
                    _replace(descriptor)
                _process_control(_DEATH_SIGNAL, signal.SIGKILL)
                if os.getppid() == me:
                    gc.enable()
                    work()
            finally:
                os._exit(_BROKEN)
        memory = private_memory(self._worker)
        started = STARTED.pack(START, me, self._worker, -1 if memory is None else memory)
        with contextlib.suppress(OSError):
            self._connection.sendall(started)

    def wait(self, patience_s: float) -> None:
        """Wait for the end of the worker, end what it has started, and tell its exit status."""
        patience: float | None = None
        while (status := self._ended()) is None:
            rest = None if patience is None else patience - time.monotonic()
            sources = [self._woken] if patience is not None else [self._woken, self._connection]
            ready = ready_to_read(sources, rest)
            if self._woken in ready:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._woken, 4096)
            if self._connection in ready:
                command = self._command()
                if command == KILL:
                    os.kill(self._worker, signal.SIGKILL)  # it has not been waited for: it is there
                elif not command:
                    patience = time.monotonic() + patience_s
            if patience is not None and time.monotonic() >= patience:
                os.kill(self._worker, signal.SIGKILL)
                patience = time.monotonic() + ORPHAN_S
        _end_children()
        self._connection.sendall(ENDED.pack(b"e", status))

    def _command(self) -> bytes:
        try:
            return self._connection.recv(1)
        except OSError:
            return b""

    def _ended(self) -> int | None:
        """Wait for the children that have ended; return the status of the worker if it has."""
        found = None
        while True:
            try:
                number, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return found
            if not number:
                return found
            if os.WIFSTOPPED(status):
                # it has asked to be traced; let go, it gets the signal that it was stopped for
                _let_go(number, os.WSTOPSIG(status))
            elif number == self._worker:
                found = os.waitstatus_to_exitcode(status)


def _end_children() -> None:
    """End what the worker has started and left."""
    until = time.monotonic() + _SWEEP_S
    while time.monotonic() < until:
        try:
            number, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if number:
            continue
        for child in _children():
            with contextlib.suppress(OSError):
                os.kill(child, signal.SIGKILL)
        time.sleep(0.001)


def _children() -> Iterable[int]:
    me = os.getpid()
    with contextlib.suppress(OSError):
        text = Path(f"/proc/{me}/task/{me}/children").read_text("ascii")
        return [int(number) for number in text.split()]
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            # the name, in parentheses, may contain anything
            after = (entry / "stat").read_text("utf-8", errors="replace").rpartition(")")[2]
            if int(after.split()[1]) == me:
                found.append(int(entry.name))
    return found


def _silence(kept: Sequence[int]) -> None:
    """Make every descriptor but these the null device.

    None is closed: whatever object of the forked process still has its number must not close, when
    it is forgotten, what has got the number since.
    """
    nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    stay = {nothing, *kept}
    for name in os.listdir("/dev/fd"):  # noqa: PTH208 - names are numbers
        if int(name) not in stay:
            with contextlib.suppress(OSError):
                os.dup2(nothing, int(name), inheritable=int(name) <= 2)
    for number in (0, 1, 2):
        if number not in stay:
            with contextlib.suppress(OSError):
                os.dup2(nothing, number)


def _replace(descriptor: int) -> None:
    nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    os.dup2(nothing, descriptor, inheritable=False)
    os.close(nothing)


@cache
def _c() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _process_control(option: int, value: int) -> None:
    if sys.platform == "linux":
        _c().prctl(option, ctypes.c_ulong(value), 0, 0, 0)


def _let_go(number: int, by: int) -> None:
    if sys.platform == "linux":
        given = 0 if by == signal.SIGTRAP else by
        _c().ptrace(ctypes.c_long(_DETACH), number, None, ctypes.c_void_p(given))
