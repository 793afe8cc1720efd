"""The parent's side of one supervised run: it follows the child and delivers to the observers."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, ClassVar, Final, Protocol

import msgspec
import numpy as np

from cosim.core import (
    ComponentError,
    FrameError,
    InputError,
    Output,
    Waiting,
    Worker,
    death_of,
)
from cosim.fmu import own_folder, unpack_fmu
from cosim.master.adjustments import Adjustments
from cosim.master.engine import EngineChoice, EngineName
from cosim.master.observers import Observer, ObserverDispatch
from cosim.master.run import Run, RunStatus
from cosim.master.session import Session
from cosim.master.supervision import messages
from cosim.master.supervision.broken_off import BrokenOffError, CallInProgress, broken_off
from cosim.master.supervision.child import CUT_OFF
from cosim.master.supervision.limits import Limits, Timer
from cosim.master.supervision.messages import (
    Answer,
    Closed,
    Conducted,
    FromChild,
    Job,
    Raised,
    Request,
)
from cosim.master.supervision.taken_rows import TakenRows
from cosim.master.supervision.wired import Wired
from cosim.master.system import System
from cosim.master.table import Move, Set, make_table
from cosim.trace.outcome import Cause, CauseKind

_TICK_S: Final = 0.02
GRACE_S: Final = 1.0
"""Time that the child has to stop between two steps, before it is killed."""
_AT_ONCE: Final = 256
_PATIENT_S: Final = 1.0
"""How long a child that has closed its connection may take to end."""
_SIGNALS: Final[Mapping[int, str]] = MappingProxyType(
    {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}
)
_MUTE: Final = "the process of the components has closed its connection to this program"
_STRANGE: Final = "the process of the components sent what is no message of this program"


class Interruption(Protocol):
    """Tells whether the user wants the run to end: the number of the signal, or 0."""

    @property
    def requested(self) -> int:
        """The number of the signal, or 0."""


class _MessageError(Exception):
    """A message that is none of the child."""


class Conduct(Protocol):
    """Runs a session in the child; picklable.

    Attributes
    ----------
    result : the type of what it returns, which is sent as a message: a dataclass of plain values.
    """

    @property
    def result(self) -> Any:
        """See above."""

    def __call__(self, session: Session) -> Any:
        """Run it."""


class FollowedRun:
    """A run in the child, followed from here; close it to end the slaves.

    Attributes
    ----------
    end_failure : why the slaves could not be ended properly, typed and in words; None if they
        were.
    child_leaves : whether the child cannot execute another run: it is not what it was before.
    """

    _goes_back: ClassVar = False
    """Whether it may go back to rows from before."""

    def __init__(
        self,
        worker: Worker,
        number: int,
        system: System,
        observers: Sequence[Observer],
        limits: Limits,
        interruption: Interruption | None,
        wired: Wired,
        *,
        keep: bool = True,
    ) -> None:
        self._keep = keep
        self._worker, self._number, self._system = worker, number, system
        self._observers, self._limits, self._interruption = observers, limits, interruption
        self._patient = limits
        if limits.call is not None and any(c.isolate for c in system.components.values()):
            # the child itself ends an isolated slave that exceeds the limit
            self._patient = replace(limits, call=limits.call + GRACE_S)
        self._wired = wired
        self._wiring, self._shared = wired.wiring, wired.shared
        self._taken_rows = TakenRows(self._wiring.memory, self._wiring.outputs)
        self._wiring.use_rows(self._taken_rows)
        self._points = self._wiring.comm_points
        self._dispatch = ObserverDispatch(observers)
        self._dispatch.make_whole, self._dispatch.points = self._wiring.make_whole, self._points
        if system.threads > 1:  # lines come with their turns
            self._dispatch.turn = lambda _name: 0
        adjustments = Adjustments(self._wiring.rows.shape[1])
        self._table = make_table(system, self._wiring, adjustments, self._shared.word)
        self._engine = EngineChoice("none", "the run did not begin")
        self._begun = self._over = self._muted = False
        self._stop_since: float | None = None
        self._stop_cause: Cause | None = None
        self._outputs = (
            Output(worker.stdout, "stdout", "info"),
            Output(worker.stderr, "stderr", "warning"),
        )
        self._taken = 0
        self._to_deliver: messages.Deliver | None = None
        self._unfinished: Any = None
        self.end_failure: tuple[Cause, str] | None = None
        self.child_leaves = False

    def begin(
        self,
        conduct: Callable[[Session], Any] | None,
        engine: EngineName,
        make: Callable[..., Session] = Session,
    ) -> None:
        """Give the child the run; what the parameters are says `Job`."""
        for component in self._system.components.values():
            unpack_fmu(component.description)
        there = any(thing is self._wiring for thing in self._worker.known)
        job = Job(
            *(self._number, self._system, conduct, make, self._limits.call, engine),
            *(self._keep, self._wired.size, str(own_folder())),
            (self._wiring, self._shared) if there else None,
        )
        try:
            self._tell(job, () if there else (self._wired.descriptor,))
        finally:
            os.close(self._wired.descriptor)

    def conduct(self, conduct: Conduct, engine: EngineName) -> tuple[Run, Any]:
        """Execute the run; return it and what `conduct` returned, None if it broke off.

        Raises
        ------
        CosimError : what the session raises.
        """
        self.begin(conduct, engine)
        try:
            ended = self._follow(Conducted, Raised)
            if isinstance(ended, Conducted):
                found = self._checked(ended.found, conduct.result)
        except BrokenOffError as broken:
            return self.broken_off(broken), None
        except BaseException as error:
            self._abandon(error)
            raise
        self._end_output()
        if isinstance(ended, Raised):
            raise ended.error.error()
        self._engine = ended.engine
        complete = self._dispatch.delivered
        try:
            self._taken_rows.compare()
        except ComponentError as error:
            cause = Cause.of_error(error, None)
            return self._run_of("failed", error.text(), cause, complete), found
        return self._run_of(ended.status, ended.reason, ended.cause, complete), found

    def close(self) -> None:
        """Terminate and free the slaves, and deliver their last log lines."""
        if self._over:
            return
        self._over = True
        self._stop_since = None  # a new time of grace
        try:
            self._tell(messages.Close(self._number))
            closed: Closed = self._follow(Closed)
            self.end_failure, self.child_leaves = closed.failure, closed.leaves
        except BrokenOffError as broken:
            self.end_failure = broken.cause, broken.words
        self._end_output()
        try:
            self._taken_rows.compare()
        except ComponentError as error:
            self.end_failure = self.end_failure or (Cause.of_error(error, None), error.text())
        if not self._muted:
            self._dispatch.close()

    def _run_of(
        self, status: RunStatus, reason: str | None, cause: Cause | None, complete: int
    ) -> Run:
        if self._stop_cause is not None and status == "stopped":
            at = self._points.points_ns[min(complete, self._points.count - 1)]
            cause = Cause(
                self._stop_cause.kind,
                time_s=self._points.at_s(at),
                detail=self._stop_cause.detail,
            )
            status = "stopped" if cause.kind == "interrupted" else "failed"
            reason = f"{cause.detail} at t = {cause.time_s:g} s"
            self._add("master", "info" if status == "stopped" else "error", reason)
            self._dispatch.deliver(complete)
        found = (self._wiring, complete, status, reason, self._engine, cause)
        return Run.of(*found, kept=self._keep)

    def broken_off(self, broken: BrokenOffError) -> Run:
        """Return the run up to its last complete row, all of which the observers receive."""
        self._over = True
        complete = self._dispatch.delivered
        if broken.cause.kind != "altered":
            complete = self._complete()
            self._make_ready(complete)
        self._end_output()
        try:
            self._deliver(complete)
            self._taken_rows.compare()
        except (BrokenOffError, ComponentError) as error:  # beside what has broken it off
            self._add("master", "error", str(error))
        status: RunStatus = "stopped" if broken.cause.kind == "interrupted" else "failed"
        self._add("master", "error" if status == "failed" else "info", broken.words)
        self._dispatch.close()
        self._stop_cause = None
        return self._run_of(status, broken.words, broken.cause, complete)

    def _abandon(self, error: BaseException) -> None:
        """Leave the run after an exception here: an observer's, or a second Ctrl-C."""
        self._muted = True
        if isinstance(error, Exception):
            self._shared.request_stop()
            try:
                self._follow(Conducted, Answer, Raised)
            except BrokenOffError:
                self._over = True
        else:
            self._worker.kill()
            self._over = True

    def _tell(
        self, content: Job | Request | messages.Close, descriptors: tuple[int, ...] = ()
    ) -> None:
        try:
            command = messages.packed(content, self._worker.known)
            self._worker.frames.send(command, descriptors, wait=False)
        except OSError:  # it is dead: following it says why
            return

    def _follow(self, *last: type[FromChild]) -> Any:
        """Take messages until one of these types; return it.

        Raises
        ------
        BrokenOffError : the child is dead, by itself or because it exceeded a limit.
        """
        timer = Timer(self._patient, closing=last == (Closed,))
        with Waiting([self._worker], self._outputs, self._log_output) as waiting:
            while True:
                waiting.wait(_TICK_S)
                found, alive = self._take_messages(last)
                if found is not None:
                    return found
                if not alive or self._worker.exit_status() is not None:
                    return self._dead(last)
                self._check(timer)

    def _take_messages(self, last: Sequence[type[FromChild]]) -> tuple[Any, bool]:
        """Take what has arrived; return the message that was waited for, and whether more comes.

        Raises
        ------
        BrokenOffError : what has arrived is none of the child.
        """
        frames, self._taken = self._worker.frames, 0
        try:
            frames.flush()
            while self._goes_on and (message := self._unfinished or frames.take()) is not None:
                self._taken, self._unfinished = self._taken + 1, message
                if message.run != self._number:
                    self._unfinished = None
                    continue
                if not isinstance(message, messages.Deliver):  # it is after those rows
                    self._deliver_waiting()  # if an observer raises an error, it is kept
                self._unfinished = None
                if isinstance(message, messages.Deliver):
                    self._to_deliver = message  # one that comes later includes it
                    continue
                if isinstance(message, tuple(last)):
                    return message, True
                if not self._muted:
                    self._take(message)
            self._deliver_waiting()
        except (EOFError, OSError):
            self._deliver_waiting()
            return None, False
        except (FrameError, _MessageError) as error:
            self._worker.kill()
            raise self._broken("refused", _STRANGE) from error
        return None, True

    @property
    def _goes_on(self) -> bool:
        """Whether more messages are taken now: not before a new interruption has its answer."""
        interrupted = self._interruption is not None and self._interruption.requested
        return self._taken < _AT_ONCE and (self._stop_since is not None or not interrupted)

    def _deliver_waiting(self) -> None:
        """Deliver the rows that the latest `Deliver` names."""
        message, self._to_deliver = self._to_deliver, None
        if message is not None and not self._muted:
            self._deliver(message.complete, message.row_sum)

    def _take(self, message: Any) -> None:
        """Do what a message says that nobody waits for."""
        match message:  # observers raise what they like
            case messages.Within():
                self._take_within(message)
            case messages.Begun():
                self._engine = message.engine
                self._begun = True
                for observer in self._observers:
                    observer.begin(self._wiring.instances)
            case _:
                try:
                    self._note(message)
                except (ArithmeticError, LookupError, TypeError, ValueError) as error:
                    raise _MessageError from error

    def _note(self, message: Any) -> None:
        match message:
            case messages.Line():
                self._dispatch.add(message.line)
            case messages.Text():
                if self._wiring.texts.number(message.text) != message.number:
                    raise _MessageError
            case messages.Points():
                self._take_points(message)
            case messages.EventValue():
                value = message.name, message.instant_ns, message.value
                self._points.event_values.set(*value)
            case messages.SlaveStarted():
                self._worker.add_process(message.process, message.memory)

    def _take_points(self, message: messages.Points) -> None:
        """Add the points that the child added."""
        points, first = self._points, message.first
        instants = np.frombuffer(message.instants_ns, np.int64)
        seconds = np.frombuffer(message.seconds, float)
        if not 0 <= first <= points.count or not instants.size == seconds.size > 0:
            raise _MessageError
        before = int(points.points_ns[first - 1]) if first else 0
        if self._dispatch.delivered > first or instants[0] < before:
            raise _MessageError
        points.replace_from(first, instants, seconds)
        self._wiring.fill_routes(first, points.count)

    def _take_within(self, message: messages.Within) -> None:
        instances = self._wiring.by_name
        if message.component not in instances or len(message.times_ns) % 8:
            raise _MessageError
        times = np.frombuffer(message.times_ns, np.int64)
        columns = len(instances[message.component].component.intermediate)
        if len(message.values) != 8 * times.size * columns:
            raise _MessageError
        values = np.frombuffer(message.values).reshape(times.size, columns)
        self._dispatch.within_steps(message.component, times, values)

    def _checked(self, found: Any, result: Any) -> Any:
        """Return what came with a message as its type.

        Raises
        ------
        BrokenOffError : it is none.
        """
        try:
            return None if result is None or found is None else msgspec.convert(found, result)
        except msgspec.ValidationError as error:
            self._worker.kill()
            raise self._broken("refused", _STRANGE) from error

    def _deliver(self, complete: int, row_sum: int | None = None) -> None:
        """Deliver the complete rows to the observers, and give back what nobody reads again.

        row_sum : of all of them, as the child tells it; None: it has died.

        Raises
        ------
        BrokenOffError : rows are not what they were when they were complete.
        """
        complete = min(max(complete, self._dispatch.delivered), self._wiring.rows.shape[0])
        self._make_ready(complete)
        complete = min(complete, self._points.count)
        try:
            self._taken_rows.check(complete, row_sum)
            self._dispatch.deliver(complete)
            if not self._keep:
                self._wiring.give_back(min(complete, self._dispatch.unread))
            elif not self._goes_back:
                self._taken_rows.give_back_shared(self._wiring.first_read(complete))
        except ComponentError as error:
            if error.kind != "altered":
                raise
            self._worker.kill()
            raise self._broken("altered", error.what) from error
        self._shared.delivered = complete

    def _make_ready(self, complete: int) -> None:
        """Take rows, and make points ready as the child did, with the delays that follow."""
        self._taken_rows.take(complete)
        points = self._points
        while (first := points.ready) < complete and not points.has_events:
            if not points.crossing:
                points.extend()
            else:
                try:
                    self._wiring.resolve_delays(self._system, first)
                except InputError:  # the child has ended the run for it
                    return
            if points.ready == first:
                return
            self._wiring.fill_routes(first, points.ready)

    def _dead(self, last: Sequence[type[FromChild]]) -> Any:
        """Take what a dead child has left; return the message waited for, if it is there."""
        status = self._worker.ended_within(_PATIENT_S)
        self._worker.kill()
        self._taken = 1
        while self._taken:
            found, _ = self._take_messages(last)
            if found is not None:
                return found
        if status is None or status == CUT_OFF:
            raise self._broken("refused", _MUTE)
        death = death_of(status)
        raise self._broken(death.kind, f"the process of the components {death.words}")

    def _check(self, timer: Timer) -> None:
        """Check limits and interruption; end the child where it exceeds its time.

        Raises
        ------
        BrokenOffError : it was ended.
        """
        now = time.monotonic()
        over = timer.exceeded(now, self._shared.sign_of_life, begun=self._begun)
        if over == "run" and self._stop_since is None:
            text = f"the run took longer than its limit of {self._limits.run:g} s"
            self._request_stop(now, Cause("timed-out", detail=text))
        elif over is not None and over != "run":
            self._worker.kill()
            limit = getattr(self._limits, over)
            raise self._broken("timed-out", f"no answer within {limit:g} s", f"limits.{over}")
        if self._limits.memory is not None and not self._muted:
            used = self._worker.memory_used()
            if used is not None and used > self._limits.memory:
                self._worker.kill()
                what = f"the components took {used / 1e6:.0f} MB"
                most = f"{self._limits.memory / 1e6:.0f} MB"
                raise self._broken("memory", f"{what}, more than {most}", "limits.memory")
        number = 0 if self._interruption is None else self._interruption.requested
        if number and self._stop_since is None:
            text = f"interrupted by {_SIGNALS.get(number, f'signal {number}')}"
            self._request_stop(now, Cause("interrupted", detail=text))
        if self._stop_since is not None and now > self._stop_since + GRACE_S:
            self._worker.kill()
            cause = self._stop_cause or Cause("interrupted", detail="interrupted")
            limit = "limits.run" if cause.kind == "timed-out" else None
            raise self._broken(cause.kind, cause.detail or "", limit)

    def _request_stop(self, now: float, cause: Cause) -> None:
        self._stop_since, self._stop_cause = now, cause
        self._shared.request_stop()

    def _call_in_progress(self) -> CallInProgress:
        k, time_ns = self._shared.complete, None
        component = call = None
        if self._shared.in_loop:
            k, number = self._table.place()
            if 0 <= k < self._wiring.rows.shape[0]:
                self._make_ready(k)
                if number >= len(self._table.operations):  # several step side by side
                    number = self._table.place_in_team() or number
                component, call = self._table.call(number)
        elif (outside := self._shared.outside_call()) is not None:
            component, call, time_ns = outside
        if time_ns is None:
            if not 0 <= k < self._wiring.rows.shape[0]:  # foreign code has written to the memory
                k = self._dispatch.delivered
            time_ns = int(self._points.points_ns[min(k, self._points.count - 1)])
        seconds = self._points.at_s(time_ns) if self._begun or time_ns else None
        return CallInProgress(component or None, call or None, seconds)

    def _broken(self, kind: CauseKind, what: str, limit: str | None = None) -> BrokenOffError:
        """Say that the child is gone, in which call of which component, and when."""
        printed = [line for output in self._outputs[1:] for line in output.last]
        at = self._call_in_progress()
        return broken_off(self._system, kind, what, at, limit=limit, printed=printed)

    def _complete(self) -> int:
        """Return how many rows a child that is gone has completed.

        Where its memory says what cannot be, foreign code has written to it: those delivered.
        """
        complete = self._shared.complete
        if self._shared.in_loop:
            k, number = self._table.place()
            operations = self._table.operations
            receiving = [
                i for i, o in enumerate(operations) if isinstance(o, Move | Set) and not o.spare
            ]
            complete = max(k + (number > max([self._table.complete, *receiving])), complete)
        delivered = self._dispatch.delivered
        possible = self._begun and delivered <= complete <= self._wiring.rows.shape[0]
        sound = possible and self._taken_rows.agree(complete, self._shared.row_sum)
        return complete if sound else delivered

    def _log_output(self, name: str, level: str, message: str) -> None:
        if self._muted:
            return
        if self._begun and not self._over:
            self._dispatch.log_now(name, level, message)
        else:
            self._dispatch.add((0, 0, 0, level, name, message))

    def _add(self, name: str, level: str, message: str) -> None:
        rows = self._dispatch.delivered
        time_ns = int(self._points.points_ns[max(rows - 1, 0)])
        self._dispatch.add((rows, time_ns, 0, level, name, message))

    def _end_output(self) -> None:
        for output in self._outputs:
            if not output.ended:
                output.read(self._log_output)
            output.end_run(self._log_output)
