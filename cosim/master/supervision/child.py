"""What the child process does: it executes the runs that it is given, and tells all of them.

FMUs write to its standard streams, which the parent reads. It ignores Ctrl-C; the parent asks it
to stop between two steps. When the parent is gone it ends itself.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError, flush_output, prepare_for_foreign_code
from cosim.fmu import adopt_folder, watch_calls
from cosim.master.component_instance import ComponentInstance
from cosim.master.observers import Observer, ObserverDispatch
from cosim.master.session import Session
from cosim.master.supervision import messages
from cosim.master.supervision.messages import Job
from cosim.master.supervision.shared import SharedRun
from cosim.master.wire import wire
from cosim.master.wiring import Wiring
from cosim.trace import Cause

_REPORT_S = 0.01
_WAIT_S = 0.0005
_RESULTS_S = 0.02
"""How long the results of calls wait for others to be sent with them."""
_AHEAD_BYTES = 1 << 24
_ORPHAN_S = 5.0
"""How long an orphan may go on: it has been asked to leave, and may be just doing so."""


class StopRequested(BaseException):
    """The parent wants the run to stop here, between two calls."""


def main(
    connection: int | str,
    lifeline: int | str,
    out: int | str,
    err: int | str,
    known: Sequence[Any] = (),
) -> None:
    """Execute runs until the parent closes the connection, then leave; never returns.

    `known` : objects that messages may refer to, in a forked process.
    """
    _own_streams(int(out), int(err))
    prepare_for_foreign_code()
    threading.Thread(target=_end_as_orphan, args=(int(lifeline),), daemon=True).start()
    try:
        _Executor(Connection(int(connection)), known).serve()
    finally:
        flush_output()
        os._exit(0)


def _own_streams(out: int, err: int) -> None:
    """Let both standard streams, of C and of Python, go to the parent line by line."""
    for source, target in ((out, 1), (err, 2)):
        os.dup2(source, target)
        os.close(source)
    sys.stdout, sys.stderr = (
        io.TextIOWrapper(io.FileIO(number, "w", closefd=False), "utf-8", line_buffering=True)
        for number in (1, 2)
    )


def _end_as_orphan(lifeline: int) -> None:
    """Wait until the parent is gone, then end this process, whatever it is doing."""
    with contextlib.suppress(OSError):
        os.read(lifeline, 1)
    time.sleep(_ORPHAN_S)
    os.kill(os.getpid(), signal.SIGKILL)


class _Executor:
    """Executes runs, and closes their sessions when it is told to."""

    def __init__(self, connection: Connection, known: Sequence[Any]) -> None:
        self._connection, self._known = connection, known
        self._guard = threading.Lock()
        self._sessions: dict[int, Session] = {}

    def serve(self) -> None:
        """Do what the parent asks for, until it closes the connection."""
        while True:
            try:
                data = self._connection.recv_bytes()
                kind, number, *rest = messages.unpacked(data, self._known)
                if kind == messages.CLOSE:
                    self._close(number)
                    continue
                if kind == messages.CALL:
                    self._call(number, *rest)
                    continue
                job = rest[0]
                wired = job.wired or self._wired(job)
            except (EOFError, OSError):
                return
            self._run(number, job, *wired)

    def _send(self, number: int, kind: str, *content: Any) -> None:
        data = messages.packed((number, kind, *content))
        with self._guard:  # an FMU may log from a thread of its own
            self._connection.send_bytes(data)

    def _call(
        self,
        number: int,
        folder: str,
        progress: NDArray[np.float64],
        function: Callable[..., Any],
        arguments: Sequence[Any],
        each: Sequence[Any],
    ) -> None:
        """Call a function for each of some things; write to `progress` which it is, since when."""
        adopt_folder(Path(folder))
        results: list[Any] = []
        sent = time.monotonic()
        try:
            for turn, one in enumerate(each):
                progress[:] = turn, (now := time.monotonic())
                if now - sent > _RESULTS_S:
                    self._send(number, messages.CALLED, results)
                    results, sent = [], now
                results.append(function(*arguments, one))
            self._send(number, messages.CALLED, results)
        except Exception as error:  # noqa: BLE001 - raised in the parent
            self._send(number, messages.RAISED, *messages.exception_parts(error))

    def _wired(self, job: Job) -> tuple[Wiring, SharedRun]:
        descriptor = recv_handle(self._connection)
        shared = SharedRun(descriptor, job.size)
        os.close(descriptor)
        return wire(job.system, shared.rows), shared

    def _run(self, number: int, job: Job, wiring: Wiring, shared: SharedRun) -> None:
        adopt_folder(Path(job.folder))
        wiring.gives_back_rows = False  # the parent does, when its observers have them
        found: Any = None
        try:
            ahead = None if job.keep else _AHEAD_BYTES // wiring.all_rows.strides[0]
            report = _Report(self, number, shared, ahead)
            wiring.texts.on_new = report.text
            wiring.comm_points.on_new = report.point
            wiring.comm_points.event_values.on_set = report.event_value
            session = Session(
                job.system,
                [begun := _Begun(self, number)],
                engine=job.engine,
                keep=job.keep,
                wiring=wiring,
                dispatch=report,
                word=shared.word,
                call_limit=job.call_limit,
                process_started=lambda one: self._send(
                    number, messages.PROCESS, one.number, one.memory_at_start
                ),
            )
            begun.session = self._sessions[number] = session
            watch_calls(_Watcher(shared, session, report))
            try:
                with contextlib.ExitStack() as stack:
                    stack.enter_context(session)
                    stack.pop_all()  # it is closed when the parent says so
                    found = job.conduct(session)
                    session.deliver()
            except StopRequested:
                pass
            report.stoppable = False
            self._tell_end(number, session, found)
        except Exception as error:  # noqa: BLE001 - raised in the parent
            report.stoppable = False
            if isinstance(error, ComponentError) and error.kind is not None:
                self._tell_death(number, self._sessions[number], error)
                return
            self._send(number, messages.RAISED, *messages.exception_parts(error))

    def _tell_end(self, number: int, session: Session, found: Any) -> None:
        end: tuple[Any, ...] = ("stopped", "stopped before the first communication point", None, 0)
        if session.opened:
            run = session.run_so_far(complete=True)
            end = (run.status, run.reason, run.cause, run.count)
        self._send(number, messages.CONDUCTED, *end, session.engine, found)

    def _tell_death(self, number: int, session: Session, error: ComponentError) -> None:
        """Tell that the process of an isolated slave ended outside the loop: the run has failed."""
        time_s = session.time_s if session.opened else None
        end = ("failed", error.text(), Cause.of_error(error, time_s), session.rows)
        self._send(number, messages.CONDUCTED, *end, session.engine, None)

    def _close(self, number: int) -> None:
        session, failure = self._sessions.pop(number, None), None
        if session is not None:
            session.close()
            if (error := session.end_failure) is not None:
                failure = Cause.of_error(error, session.time_s), error.text()
        self._send(number, messages.CLOSED, failure)

    def send_of(self, number: int, kind: str, *content: Any) -> None:
        """Tell the parent something about a run."""
        self._send(number, kind, *content)


class _Report(ObserverDispatch):
    """Tells the parent log lines at once, and the rows that are complete.

    Attributes
    ----------
    stoppable : whether a request to stop is obeyed.

    `ahead` : so many rows may be complete that the parent's observers do not have; None: any
    number.
    """

    def __init__(
        self, executor: _Executor, number: int, shared: SharedRun, ahead: int | None
    ) -> None:
        super().__init__(())
        self._executor, self._number, self._shared = executor, number, shared
        self._ahead = ahead
        self.stoppable = True
        self._lines_wait = False
        self._reported_at = 0.0

    def add(self, line: tuple[int, int, int, str, str, str]) -> None:
        """Tell a log line."""
        self._tell(messages.LINE, line)
        self._lines_wait = True

    def deliver(self, complete: int) -> None:
        """Let the parent deliver rows and lines; stop if it asked for that.

        Rows alone are told every few milliseconds, since segments may be of a single point; at the
        end of the run the parent looks for the rest itself.
        """
        self._shared.complete = self.delivered = complete
        now = time.monotonic()
        if self._lines_wait or now - self._reported_at > _REPORT_S:
            self._lines_wait, self._reported_at = False, now
            self._tell(messages.DELIVER, complete)
        self.check_stop()
        if self._ahead is not None and complete - self._shared.delivered > self._ahead:
            self._tell(messages.DELIVER, complete)
            while complete - self._shared.delivered > self._ahead and self.stoppable:
                time.sleep(_WAIT_S)
                self.check_stop()

    def check_stop(self) -> None:
        """Stop if the parent asked for it."""
        if self.stoppable and self._shared.stop_requested:
            self.stoppable = False
            raise StopRequested

    def text(self, number: int, text: str) -> None:
        """Tell a new value of a String."""
        self._tell(messages.TEXT, number, text)

    def within_steps(
        self, component: str, times_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Tell outputs within steps."""
        self._tell(messages.WITHIN, component, times_ns, values)

    def point(self, instant_ns: int, seconds: float) -> None:
        """Tell a point that was added."""
        self._tell(messages.POINT, instant_ns, seconds)

    def event_value(self, name: str, time_ns: int, value: float) -> None:
        """Tell what an event has set."""
        self._tell(messages.SET, name, time_ns, value)

    def close(self) -> None:
        """Do nothing: the parent closes its own."""

    def _tell(self, kind: str, *content: Any) -> None:
        self._executor.send_of(self._number, kind, *content)


class _Begun(Observer):
    """Tells the parent that all slaves are initialised."""

    def __init__(self, executor: _Executor, number: int) -> None:
        self._executor, self._number = executor, number
        self.session: Session

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Tell it."""
        del instances
        self._executor.send_of(self._number, messages.BEGUN, self.session.engine)

    def rows_complete(self, first: int, last: int) -> None:
        """Do nothing."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Do nothing."""


class _Watcher:
    """Notes in the shared memory which FMI call outside the loop is in progress."""

    def __init__(self, shared: SharedRun, session: Session, report: _Report) -> None:
        self._shared, self._session, self._report = shared, session, report

    def begin(self, component: str, call: str) -> None:
        """Note a call, unless the run is to stop."""
        self._report.check_stop()
        self._shared.begin_call(self._session.time_ns, component, call)

    def end(self) -> None:
        """Note that it has returned."""
        self._shared.end_call()
