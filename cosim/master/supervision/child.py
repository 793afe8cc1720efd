"""What the child process does: it executes the runs that it is given, and tells all of them.

FMUs write to its standard streams, which the parent reads. It ignores Ctrl-C; the parent asks it
to stop between two steps.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import (
    ComponentError,
    FrameError,
    Frames,
    RaisedError,
    SharedMemory,
    Surroundings,
    flush_output,
)
from cosim.fmu import adopt_folder, own_folder, watch_calls
from cosim.master.component_instance import ComponentInstance
from cosim.master.observers import Observer, ObserverDispatch
from cosim.master.run import RunStatus
from cosim.master.session import Session
from cosim.master.supervision import messages
from cosim.master.supervision.messages import (
    Call,
    Close,
    FromChild,
    Job,
    Request,
    SessionState,
)
from cosim.master.supervision.shared import SharedRun
from cosim.master.wire import wire
from cosim.master.wiring import Wiring
from cosim.trace.outcome import Cause

CUT_OFF = 75
"""The exit code of a child that has lost its connection."""
_REPORT_S = 0.01
_WAIT_S = 0.0005
_RESULTS_S = 0.02
"""How long the results of calls wait for others to be sent with them."""
_AHEAD_BYTES = 1 << 24


class StopRequested(BaseException):
    """The parent wants the run to stop here, between two calls."""


def main(end: socket.socket, descriptors: Sequence[int], *, known: Sequence[Any] = ()) -> None:
    """Execute runs until the parent closes the connection.

    `descriptors` : of the memory in which it is told which of several calls is in progress, if any;
    `known` : objects that messages may refer to, in a forked process.
    """
    for thing in known:
        if isinstance(thing, SharedRun):
            thing.keep_from_forks()  # of isolated slaves
    with contextlib.suppress(EOFError, OSError, FrameError):
        _Executor(Frames(end, messages.Command, takes_descriptors=True), descriptors, known).serve()


class _Executor:
    """Executes runs, and closes their sessions when it is told to."""

    def __init__(self, frames: Frames, descriptors: Sequence[int], known: Sequence[Any]) -> None:
        self._frames, self._known = frames, known
        self._guard = threading.Lock()
        self._sessions: dict[int, tuple[Session, _Report]] = {}
        self._surroundings = Surroundings()  # before an FMU is loaded
        self._leaves = False
        self._progress: Any = None
        for descriptor in descriptors:
            mapped = SharedMemory(descriptor, 0).mapping
            self._progress = np.frombuffer(mapped, np.float64)[:2]

    def serve(self) -> None:
        """Do what the parent asks for, until it closes the connection."""
        while not self._leaves:
            asked = messages.unpacked(self._frames.receive(), self._known)
            match asked:
                case Job():
                    self._run(asked)
                case Request():
                    self._answer(asked)
                case Close():
                    self._close(asked.run)
                case Call():
                    self._call(asked)

    def send(self, message: FromChild) -> None:
        """Tell the parent something about a run; without a connection there is nothing to do."""
        with self._guard:  # an FMU may log from a thread of its own
            try:
                self._frames.send(message)
            except OSError:
                flush_output()
                os._exit(CUT_OFF)

    def _call(self, asked: Call) -> None:
        """Call a function for each of some things; write which one is in progress, since when.

        Each call begins in an empty folder, and in a child as no other has changed it: one that
        cannot be put back ends here, and the call is one that has ended it.
        """
        adopt_folder(Path(asked.folder))
        results: list[Any] = []
        sent = time.monotonic()
        try:
            for turn, one in enumerate(asked.each):
                self._progress[:] = turn, (now := time.monotonic())
                if now - sent > _RESULTS_S:
                    self.send(messages.Called(asked.run, results))
                    results, sent = [], now
                self._surroundings.enter_folder(own_folder())
                results.append(asked.function(*asked.arguments, one))
                if self._surroundings.put_back():
                    os._exit(0)
            self.send(messages.Called(asked.run, results))
        except Exception as error:  # noqa: BLE001 - raised in the parent
            self.send(messages.Raised(asked.run, RaisedError.of(error)))

    def _wired(self, job: Job) -> tuple[Wiring, SharedRun]:
        descriptor = self._frames.descriptors.popleft()
        shared = SharedRun(SharedMemory(descriptor, job.size))
        os.close(descriptor)
        shared.keep_from_forks()  # of isolated slaves
        return wire(job.system, shared.rows), shared

    def _run(self, job: Job) -> None:
        wiring, shared = job.wired or self._wired(job)
        adopt_folder(Path(job.folder))
        self._surroundings.enter_folder(own_folder())
        wiring.gives_back_rows = False  # the parent does, when its observers have them
        found: Any = None
        try:
            ahead = None if job.keep else _AHEAD_BYTES // wiring.all_rows.strides[0]
            report = _Report(self, job.run, shared, ahead)
            wiring.texts.on_new = report.text
            wiring.comm_points.on_new = report.new_points
            wiring.comm_points.event_values.on_set = report.event_value
            session = job.make(
                job.system,
                observers=[begun := _Begun(self, job.run)],
                engine=job.engine,
                keep=job.keep,
                wiring=wiring,
                dispatch=report,
                word=shared.word,
                call_limit=job.call_limit,
                process_started=lambda one: self.send(
                    messages.SlaveStarted(job.run, one.number, one.memory_at_start)
                ),
            )
            begun.session = session
            self._sessions[job.run] = session, report
            watch_calls(_Watcher(shared, session, report))
            try:
                with contextlib.ExitStack() as stack:
                    stack.enter_context(session)
                    stack.pop_all()  # it is closed when the parent says so
                    if job.conduct is None:
                        self.send(messages.Answer(job.run, None, _state_of(session)))
                        return
                    found = job.conduct(session)
                    session.deliver()
            except StopRequested:
                pass
            report.stoppable = False
            report.tell_complete()
            self._tell_end(job.run, session, found)
        except Exception as error:  # noqa: BLE001 - raised in the parent
            if job.run in self._sessions:
                self._sessions[job.run][1].stoppable = False
                self._sessions[job.run][1].tell_complete()
            if isinstance(error, ComponentError) and error.kind is not None and job.conduct:
                self._tell_death(job.run, error)
                return
            self.send(messages.Raised(job.run, RaisedError.of(error)))

    def _answer(self, asked: Request) -> None:
        """Call a function with the session; a request to stop is obeyed between two steps."""
        session, report = self._sessions[asked.run]
        found: Any = None
        try:
            with contextlib.suppress(StopRequested):
                found = asked.function(session, *asked.arguments)
            session.deliver()
            report.tell_complete()
            self.send(messages.Answer(asked.run, found, _state_of(session)))
        except Exception as error:  # noqa: BLE001 - raised in the parent
            session.deliver()
            report.tell_complete()
            self.send(messages.Raised(asked.run, RaisedError.of(error), _state_of(session)))
        report.stoppable = True

    def _tell_end(self, run: int, session: Session, found: Any) -> None:
        status: RunStatus = "stopped"
        reason: str | None = "stopped before the first communication point"
        cause, count = None, 0
        if session.opened:
            so_far = session.run_so_far(complete=True, whole=False)
            status, reason = so_far.status, so_far.reason
            cause, count = so_far.cause, so_far.count
        ended = messages.Conducted(run, status, reason, cause, count, session.engine, found)
        self.send(ended)

    def _tell_death(self, run: int, error: ComponentError) -> None:
        """Tell that the process of an isolated slave ended outside the loop: the run has failed."""
        session, _ = self._sessions[run]
        time_s = session.time_s if session.opened else None
        how = error.text(), Cause.of_error(error, time_s), session.rows
        self.send(messages.Conducted(run, "failed", *how, session.engine, None))

    def _close(self, run: int) -> None:
        session, _ = self._sessions.pop(run, (None, None))
        failure = None
        if session is not None:
            session.close()
            if (error := session.end_failure) is not None:
                failure = Cause.of_error(error, session.time_s), error.text()
        if not self._sessions:
            self._leaves = bool(self._surroundings.put_back())
        self.send(messages.Closed(run, failure, self._leaves))


def _state_of(session: Session) -> SessionState:
    return SessionState(
        session.time_ns,
        session.rows,
        session.status or "running",
        session.reason,
        session.cause,
        session.end_reason,
    )


class _Report(ObserverDispatch):
    """Tells the parent log lines at once, and the rows that are complete.

    Attributes
    ----------
    stoppable : whether a request to stop is obeyed.

    `ahead` : so many rows may be complete that the parent's observers do not have; None: any
    number.
    """

    def __init__(self, executor: _Executor, run: int, shared: SharedRun, ahead: int | None) -> None:
        super().__init__(())
        self._executor, self._run, self._shared = executor, run, shared
        self._ahead = ahead
        self.stoppable = True
        self._lines_wait = False
        self._reported_at = 0.0

    def add(self, line: tuple[int, int, int, str, str, str]) -> None:
        """Tell a log line."""
        self._tell(messages.Line(self._run, line))
        self._lines_wait = True

    def deliver(self, complete: int) -> None:
        """Let the parent deliver rows and lines; stop if it asked for that.

        Rows alone are told every few milliseconds, since segments may be of a single point, and
        at the end.
        """
        self._shared.complete = self.delivered = complete
        now = time.monotonic()
        if self._lines_wait or now - self._reported_at > _REPORT_S:
            self._reported_at = now
            self.tell_complete()
        self.check_stop()
        if self._ahead is not None and complete - self._shared.delivered > self._ahead:
            self.tell_complete()
            while complete - self._shared.delivered > self._ahead and self.stoppable:
                time.sleep(_WAIT_S)
                self.check_stop()

    def tell_complete(self) -> None:
        """Tell the parent which rows are complete."""
        self._lines_wait = False
        self._tell(messages.Deliver(self._run, self.delivered, self._shared.row_sum))

    def check_stop(self) -> None:
        """Stop if the parent asked for it."""
        self._shared.show_life()
        if self.stoppable and self._shared.stop_requested:
            self.stoppable = False
            raise StopRequested

    def text(self, number: int, text: str) -> None:
        """Tell a new value of a String."""
        self._tell(messages.Text(self._run, number, text))

    def within_steps(
        self, component: str, times_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Tell outputs within steps."""
        self._tell(messages.Within(self._run, component, times_ns.tobytes(), values.tobytes()))

    def new_points(self, first: int, instants_ns: Any, seconds: Any) -> None:
        """Tell points that were added, from an index on."""
        self._tell(messages.Points(self._run, first, instants_ns.tobytes(), seconds.tobytes()))

    def event_value(self, name: str, instant_ns: int, value: float) -> None:
        """Tell what an event has set."""
        self._tell(messages.EventValue(self._run, name, int(instant_ns), float(value)))

    def rewind(self, complete: int) -> None:
        """Rows from `complete` on will be computed anew: the parent has rewound its observers."""
        self._shared.complete = self.delivered = complete

    def close(self) -> None:
        """Do nothing: the parent closes its own."""

    def _tell(self, message: FromChild) -> None:
        self._executor.send(message)


class _Begun(Observer):
    """Tells the parent that all slaves are initialised."""

    def __init__(self, executor: _Executor, run: int) -> None:
        self._executor, self._run = executor, run
        self.session: Session

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Tell it."""
        del instances
        self._executor.send(messages.Begun(self._run, self.session.engine))

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
