"""A worker as the process sees it that wants it."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Sequence
from typing import Any, Final, Literal
from weakref import WeakSet

from cosim.core.errors import ComponentError, InputError
from cosim.core.processes import flush_output, has_foreign_code, private_memory
from cosim.core.worker import keeper
from cosim.core.worker.frames import Frames, ready_to_read

Method = Literal["fork", "fresh", "spawn"]
"""fork: of this process; fresh: of an interpreter that was started for it, and may serve again;
spawn: an interpreter of its own, without a keeper, where there is nothing better."""
_FRESH: Final = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from cosim.core.worker.keeper import keep_fresh; keep_fresh(sys.argv[2])"
)
_SPAWN: Final = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from cosim.core.worker.process import enter_spawned; enter_spawned(*sys.argv[2:])"
)
_START_S: Final = 120.0
_KILL_S: Final = 5.0
_NAP_S: Final = 0.001
_DESCRIPTORS: Final = 24
"""Descriptors that are free where a worker starts: it has the limit of this process."""
_MOST_IDLE: Final = 8
_open: WeakSet[Worker] = WeakSet()
_idle: list[socket.socket] = []
_guard = threading.Lock()


def default_method() -> Method | None:
    """Return how a worker is started here and now; None where there are none (Windows)."""
    if sys.platform == "win32" or not hasattr(os, "fork"):
        return None
    if sys.platform != "linux":
        return "spawn"  # where libraries of the system do not survive a fork
    # a fork has the locks that other threads hold, and what foreign code has left
    clean = threading.active_count() == 1 and not has_foreign_code()
    return "fork" if clean else "fresh"


def _fill_streams() -> None:
    """Open what is closed of standard input and output: a worker has others of these numbers."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free


def _find_room() -> None:
    """Raise `OSError` here rather than in a worker, where an FMU would be blamed for it."""
    with contextlib.ExitStack() as opened:
        for _ in range(_DESCRIPTORS):
            opened.callback(os.close, os.open(os.devnull, os.O_RDONLY))


class Worker:
    """A child process; `close` ends it.

    Parameters
    ----------
    target, arguments : what it does, see `keeper.Start`.
    received : the type of its messages, as for `Frames`.
    descriptors : what it gets of the descriptors of this process; it has no others.
    captured : whether its standard streams are read here; else they are those of this process.
    known : objects that it has as they are here, if it is forked from this process.
    patience_s : how long it may go on when this process is gone: it may be just leaving.
    method : see `Method`; None: the best one here and now.
    loaded : whether a fresh one has the modules of this package that are here from its start: for
        workers that need them all, one after the other.

    Raises
    ------
    InputError : no process can be started here, or no more of them.
    ComponentError : it has ended before it began.

    Attributes
    ----------
    frames : messages to it and from it.
    stdout, stderr : descriptors from which its standard streams are read; -1 if not captured.
    number : of the process.
    memory_at_start : that it had before it did anything [bytes]; None if unknown.
    known : objects that it has; empty if it is no fork of this process.
    """

    def __init__(
        self,
        target: str,
        arguments: Sequence[Any] = (),
        *,
        received: Any,
        descriptors: Sequence[int] = (),
        captured: bool = True,
        known: Sequence[Any] = (),
        patience_s: float = keeper.ORPHAN_S,
        method: Method | None = None,
        loaded: bool = False,
    ) -> None:
        found = method or default_method()
        if found is None:
            raise InputError(
                "there are no child processes for components on this system",
                where="supervise",
                expected="Linux or macOS",
                hint="supervise = false, isolate = false; cosim fmu check without --run",
            )
        self.method: Method = found
        self.known = tuple(known) if found == "fork" else ()
        self.memory_at_start: int | None = None
        self._status: int | None = None
        self._guard = threading.Lock()
        self._end_heard = b""
        self._of_slaves: dict[int, int] = {}
        self._opened = contextlib.ExitStack()  # what stays open as long as the worker is known
        only_fresh = loaded and found == "fresh"  # a fork has them
        start = keeper.Start.here(target, arguments, patience_s, loaded=only_fresh)
        try:
            _fill_streams()
            _find_room()
            with contextlib.ExitStack() as theirs:
                ours, end = socket.socketpair()
                theirs.callback(end.close)
                self._opened.callback(ours.close)
                self.stdout, out = self._stream(theirs, 1, captured=captured)
                self.stderr, err = self._stream(theirs, 2, captured=captured)
                ends = end.fileno(), (out, err), tuple(descriptors)
                self._begin(start, *ends)
        except OSError as error:
            self._opened.close()
            raise InputError(
                "no child process can be started for the components",
                where="supervise",
                got=error.strerror or str(error),
                hint="greater limits of processes and open files (ulimit -u, ulimit -n)",
            ) from error
        except BaseException:
            self._opened.close()
            raise
        self.frames = Frames(ours, received)
        _open.add(self)

    def _stream(
        self, theirs: contextlib.ExitStack, number: int, *, captured: bool
    ) -> tuple[int, int]:
        """Return the two ends of a standard stream: to read here, and to write there."""
        if captured:
            read, write = os.pipe()
            os.set_blocking(read, False)
            self._opened.callback(_close, read)
        else:
            read = -1
            try:
                write = os.dup(number)
            except OSError:  # it is closed
                write = os.open(os.devnull, os.O_WRONLY)
        theirs.callback(_close, write)
        return read, write

    def _begin(
        self, start: keeper.Start, end: int, streams: tuple[int, int], given: tuple[int, ...]
    ) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None
        self._keeper = 0
        if self.method == "spawn":
            self._spawn(start, end, streams, given)
        elif self.method == "fork":
            self._fork(start, end, streams, given)
        else:
            self._ask(start, end, streams, given)

    def _fork(
        self, start: keeper.Start, end: int, streams: tuple[int, int], given: tuple[int, ...]
    ) -> None:
        self._control, theirs = socket.socketpair()
        self._opened.callback(self._wait_for_keeper)  # which ends when the next is closed
        self._opened.callback(self._control.close)
        flush_output()  # else both would write what is kept
        with theirs, warnings.catch_warnings():
            # of threads: who asks for a fork knows that the worker uses none of their locks
            warnings.simplefilter("ignore", DeprecationWarning)
            number = os.fork()
            if not number:
                keeper.keep_forked(theirs.fileno(), start, end, streams, given, self.known)
        self._keeper = number
        self._hear_start()

    def _wait_for_keeper(self) -> None:
        """Wait for the keeper that is a child of this process; it ends with its worker."""
        if self._keeper:
            with contextlib.suppress(ChildProcessError):  # somebody else has waited for it
                os.waitpid(self._keeper, 0)

    def _ask(
        self, start: keeper.Start, end: int, streams: tuple[int, int], given: tuple[int, ...]
    ) -> None:
        """Have a keeper start the worker that is no fork of this process."""
        content = pickle.dumps(start)
        for _ in range(_MOST_IDLE + 1):
            with _guard:
                control, is_new = (_idle.pop(), False) if _idle else (_fresh_keeper(), True)
            try:
                control.settimeout(_START_S)
                head = keeper.START + keeper.REQUEST.pack(len(content))
                with contextlib.suppress(ConnectionError):  # that nothing is heard says so
                    socket.send_fds(control, [head], [end, *streams, *given])
                    control.sendall(content)
                self._control = control
                self._hear_start()
            except (OSError, ComponentError):
                self._control = None
                control.close()
                if is_new:
                    raise
                continue  # it has been idle for too long
            return
        raise AssertionError

    def _hear_start(self) -> None:
        control = self._control
        assert control is not None  # noqa: S101 - both callers have set it
        control.settimeout(_START_S)
        try:
            data = keeper.receive_exactly(control, keeper.STARTED.size)
        except (EOFError, ConnectionError) as error:
            raise ComponentError(
                "the process for the components did not start",
                where="supervise",
                hint="its standard error may say why",
            ) from error
        _, self._keeper, self.number, memory = keeper.STARTED.unpack(data)
        self.memory_at_start = None if memory < 0 else memory
        control.settimeout(0.0)

    def _spawn(
        self, start: keeper.Start, end: int, streams: tuple[int, int], given: tuple[int, ...]
    ) -> None:
        """Start an interpreter that is the worker itself."""
        numbers = [end, *streams, *given]
        lifeline, ours = os.pipe()
        self._opened.callback(_close, ours)
        words = [json.dumps(sys.path), str(lifeline), *map(str, numbers)]
        try:
            self._process = subprocess.Popen(  # noqa: S603 - ourselves
                [sys.executable, "-c", _SPAWN, *words],
                pass_fds=[lifeline, *numbers],
                stdin=subprocess.PIPE,
                start_new_session=True,
            )
        finally:
            os.close(lifeline)
        assert self._process.stdin is not None  # noqa: S101 - it is a pipe
        with contextlib.suppress(BrokenPipeError), self._process.stdin as pipe:
            pipe.write(pickle.dumps(start))
        self.number = self._process.pid
        self.memory_at_start = private_memory(self.number)

    def exit_status(self) -> int | None:
        """Return None while it lives, then its exit code, or minus the signal that ended it."""
        with self._guard:
            if self._status is None and self._process is not None:
                self._status = self._process.poll()
            elif self._status is None and self._control is not None:
                self._status = self._heard_end(self._control)
            return self._status

    def _heard_end(self, control: socket.socket) -> int | None:
        try:
            while len(self._end_heard) < keeper.ENDED.size:
                more = control.recv(keeper.ENDED.size - len(self._end_heard))
                if not more:  # the keeper was ended, and the worker with it
                    return -signal.SIGKILL
                self._end_heard += more
        except BlockingIOError:
            return None
        except OSError:
            return -signal.SIGKILL
        status: int = keeper.ENDED.unpack(self._end_heard)[1]
        return status

    def watched(self) -> list[Any]:
        """Return what to wait for: the frames, and the end of the worker."""
        return [self.frames, *([] if self._control is None else [self._control])]

    def kill(self) -> int:
        """End it, and what it has started, at once; return its exit status."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.number, signal.SIGKILL)
        elif self._control is not None and self.exit_status() is None:
            with contextlib.suppress(OSError):
                self._control.send(keeper.KILL)
        until = time.monotonic() + _KILL_S
        while (status := self.exit_status()) is None:
            if self._control is not None and time.monotonic() < until:
                ready_to_read([self._control], _NAP_S)
            else:
                time.sleep(_NAP_S)
            if time.monotonic() > until and self._keeper:
                with contextlib.suppress(OSError):  # it does not answer: the worker dies with it
                    os.kill(self._keeper, signal.SIGKILL)
        return status

    def ended_within(self, seconds: float) -> int | None:
        """Return its exit status as soon as it has ended; None if it lives after so long."""
        until = time.monotonic() + seconds
        while self.exit_status() is None and (rest := until - time.monotonic()) > 0.0:
            if self._control is None:
                time.sleep(_NAP_S)
            else:
                ready_to_read([self._control], rest)
        return self.exit_status()

    def wait(self, patience_s: float) -> int:
        """Return its exit status as soon as it has ended; end it after `patience_s`."""
        self.ended_within(patience_s)
        return self.kill()

    def let_go(self) -> None:
        """Let it leave by itself, once it has nothing to do."""
        self.frames.close()

    def close(self, patience_s: float) -> None:
        """End it: it leaves by itself, or is killed after `patience_s`."""
        if self not in _open:
            return
        _open.discard(self)
        self.let_go()
        self.wait(patience_s)
        control = self._control
        if (
            self.method == "fresh"
            and control is not None
            and len(self._end_heard) == keeper.ENDED.size
        ):
            with _guard:
                if len(_idle) < _MOST_IDLE:
                    _idle.append(control)
                    self._control = control = None
        if control is not None:
            control.close()
        self._opened.close()

    def abandon(self) -> None:
        """Close its descriptors, in a fork: it is the worker of the other process."""
        self.frames.close()
        if self._control is not None:
            self._control.close()

    def memory_used(self) -> int | None:
        """Return the memory that it has beyond what it started with [bytes]; None if unknown.

        That of the processes of its isolated slaves is included.
        """
        now = private_memory(self.number)
        if now is None or self.memory_at_start is None:
            return None
        used = now - self.memory_at_start
        for process, at_start in self._of_slaves.items():
            used += (private_memory(process) or at_start) - at_start
        return used

    def add_process(self, process: int, at_start: int | None) -> None:
        """Count another process with it, beyond the memory it has at its start [bytes]."""
        if at_start is not None:
            self._of_slaves[process] = at_start


def enter_spawned(lifeline: str, end: str, out: str, err: str, *given: str) -> None:
    """Be a worker that has no keeper."""
    start = pickle.load(sys.stdin.buffer)  # noqa: S301 - from who wants the worker
    waits = int(lifeline), start.patience_s
    threading.Thread(target=_end_as_orphan, args=waits, daemon=True).start()
    start.settle()
    keeper.enter(start, int(end), (int(out), int(err)), [int(number) for number in given])


def _end_as_orphan(lifeline: int, patience_s: float) -> None:
    """Wait until the parent is gone, then end this process, whatever it is doing."""
    with contextlib.suppress(OSError):
        os.read(lifeline, 1)
    time.sleep(patience_s)
    os.kill(os.getpid(), signal.SIGKILL)


def _fresh_keeper() -> socket.socket:
    """Start a keeper in an interpreter of its own; return the connection to it."""
    ours, theirs = socket.socketpair()
    words = [json.dumps(sys.path), str(theirs.fileno())]
    with theirs:
        command = [sys.executable, "-c", _FRESH, *words]
        subprocess.run(  # noqa: S603 - ourselves
            command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, check=False
        )
    return ours


def _forget() -> None:
    """Leave all workers, and all idle keepers, to the process that this one was forked from."""
    global _guard  # noqa: PLW0603 - another thread of the other process may hold it
    _guard = threading.Lock()
    for worker in list(_open):
        worker.abandon()
    _open.clear()
    _let_idle_go()


def _let_idle_go() -> None:
    """Ask idle keepers for nothing more: they end."""
    while _idle:
        _idle.pop().close()


atexit.register(_let_idle_go)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _close(descriptor: int) -> None:
    with contextlib.suppress(OSError):
        os.close(descriptor)
