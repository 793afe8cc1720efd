"""The parent's side of one supervised run: it follows the child and delivers to the observers."""

from __future__ import annotations

import os
import selectors
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from multiprocessing.reduction import send_handle
from types import MappingProxyType
from typing import Any, Final, Protocol

from cosim.core import InputError, death_of
from cosim.fmu import own_folder, unpack_fmu
from cosim.master.adjustments import Adjustments
from cosim.master.engine import EngineChoice, EngineName
from cosim.master.observers import Observer, ObserverDispatch
from cosim.master.run import Run, RunStatus
from cosim.master.session import Session
from cosim.master.supervision import messages
from cosim.master.supervision.broken_off import BrokenOffError, CallInProgress, broken_off
from cosim.master.supervision.limits import Limits, Timer
from cosim.master.supervision.messages import Job
from cosim.master.supervision.output import Output
from cosim.master.supervision.process import Worker
from cosim.master.supervision.wired import Wired
from cosim.master.system import System
from cosim.master.table import Move, Set, make_table
from cosim.trace import Cause, CauseKind

_TICK_S: Final = 0.02
GRACE_S: Final = 1.0
"""Time that the child has to stop between two steps, before it is killed."""
_AT_ONCE: Final = 256
_SIGNALS: Final[Mapping[int, str]] = MappingProxyType(
    {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}
)


class Interruption(Protocol):
    """Tells whether the user wants the run to end: the number of the signal, or 0."""

    @property
    def requested(self) -> int:
        """The number of the signal, or 0."""


class FollowedRun:
    """A run in the child, followed from here; close it to end the slaves.

    Attributes
    ----------
    end_failure : why the slaves could not be ended properly, typed and in words; None if they
        were.
    """

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
        self._points = self._wiring.comm_points
        self._dispatch = ObserverDispatch(observers)
        self._dispatch.make_whole = self._wiring.make_whole
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
        self.end_failure: tuple[Cause, str] | None = None

    def conduct(self, conduct: Callable[[Session], Any], engine: EngineName) -> tuple[Run, Any]:
        """Execute the run; return it and what `conduct` returned, None if it broke off.

        Raises
        ------
        CosimError : what the session raises.
        """
        for component in self._system.components.values():
            unpack_fmu(component.description)
        there = any(thing is self._wiring for thing in self._worker.known)
        known = (self._wiring, self._shared) if there else None
        folder = str(own_folder())
        self._send(
            messages.RUN,
            Job(
                *(self._system, conduct, self._limits.call, engine),
                *(self._keep, self._wired.size, folder, known),
            ),
        )
        self._send_descriptor(send=not there)
        try:
            kind, *content = self._follow(messages.CONDUCTED, messages.RAISED)
        except BrokenOffError as broken:
            return self._broken_off(broken), None
        except BaseException as error:
            self._abandon(error)
            raise
        self._deliver(self._shared.complete)
        self._end_output()
        if kind == messages.RAISED:
            parts, trace = content
            raised = messages.exception_of(parts)
            raised.add_note(trace)
            raise raised
        status, reason, cause, complete, self._engine, found = content
        return self._run_of(status, reason, cause, complete), found

    def close(self) -> None:
        """Terminate and free the slaves, and deliver their last log lines."""
        if self._over:
            return
        self._over = True
        self._stop_since = None  # a new time of grace
        try:
            self._send(messages.CLOSE)
            _, self.end_failure = self._follow(messages.CLOSED)
        except BrokenOffError as broken:
            self.end_failure = broken.cause, broken.words
        self._end_output()
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

    def _broken_off(self, broken: BrokenOffError) -> Run:
        """Return the run up to its last complete row, all of which the observers receive."""
        self._over = True
        complete = self._complete()
        self._make_ready(complete)
        self._end_output()
        self._deliver(complete)
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
                self._follow(messages.CONDUCTED, messages.RAISED)
            except BrokenOffError:
                self._over = True
        else:
            self._worker.kill()
            self._over = True

    def _send(self, kind: str, *content: Any) -> None:
        try:
            data = messages.packed((kind, self._number, *content), self._worker.known)
            self._worker.connection.send_bytes(data)
        except OSError:  # it is dead: following it says why
            return

    def _send_descriptor(self, *, send: bool) -> None:
        try:
            if send:
                send_handle(self._worker.connection, self._wired.descriptor, None)
        except OSError:
            return
        finally:
            os.close(self._wired.descriptor)

    def _follow(self, *last: str) -> tuple[Any, ...]:
        """Take messages until one of the kinds in `last`; return it.

        Raises
        ------
        BrokenOffError : the child is dead, by itself or because it exceeded a limit.
        """
        timer = Timer(self._patient, closing=last == (messages.CLOSED,))
        with selectors.DefaultSelector() as selector:
            selector.register(self._worker.connection, selectors.EVENT_READ)
            for output in self._outputs:
                if not output.ended:
                    selector.register(output.descriptor, selectors.EVENT_READ)
            while True:
                selector.select(_TICK_S)
                for output in self._outputs:
                    if not output.ended:
                        output.read(self._log_output)
                        if output.ended:
                            selector.unregister(output.descriptor)
                found, alive = self._take_messages(last)
                if found is not None:
                    return found
                if not alive or self._worker.exit_status() is not None:
                    return self._dead(last)
                self._check(timer)

    def _take_messages(self, last: Sequence[str]) -> tuple[tuple[Any, ...] | None, bool]:
        """Take what has arrived; return the message that was waited for, and whether more comes."""
        connection = self._worker.connection
        try:
            for _ in range(_AT_ONCE):
                if not connection.poll():
                    break
                number, kind, *content = messages.unpacked(connection.recv_bytes())
                if number == self._number and kind in last:
                    return (kind, *content), True
                if number == self._number and not self._muted:
                    self._take(kind, content)
        except (EOFError, OSError):
            return None, False
        return None, True

    def _take(self, kind: str, content: Sequence[Any]) -> None:  # noqa: C901 - one per kind
        match kind:
            case messages.LINE:
                self._dispatch.add(content[0])
            case messages.DELIVER:
                self._deliver(content[0])
            case messages.TEXT:
                number, text = content
                if self._wiring.texts.number(text) != number:
                    raise ValueError(f"expected number {number} for {text!r}")
            case messages.POINT:
                self._points.add(*content)
                self._wiring.fill_routes(self._points.ready, self._points.count)
            case messages.SET:
                self._points.event_values.set(*content)
            case messages.WITHIN:
                self._dispatch.within_steps(*content)
            case messages.PROCESS:
                self._worker.add_process(*content)
            case messages.BEGUN:
                self._engine = content[0]
                self._begun = True
                for observer in self._observers:
                    observer.begin(self._wiring.instances)

    def _deliver(self, complete: int) -> None:
        """Deliver the complete rows to the observers, and give back what nobody reads again."""
        self._make_ready(complete)
        self._dispatch.deliver(complete)
        if not self._keep:
            self._wiring.give_back(min(complete, self._dispatch.unread))
        self._shared.delivered = complete

    def _make_ready(self, complete: int) -> None:
        """Make points ready as the child did, with the delays that follow from complete rows."""
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

    def _dead(self, last: Sequence[str]) -> tuple[Any, ...]:
        """Take what a dead child has left; return the message waited for, if it is there."""
        alive = True
        while alive and self._worker.connection.poll():
            found, alive = self._take_messages(last)
            if found is not None:
                return found
        status = self._worker.kill()
        death = death_of(status)
        raise self._broken(death.kind, f"the process of the components {death.words}")

    def _check(self, timer: Timer) -> None:
        """Check limits and interruption; end the child where it exceeds its time.

        Raises
        ------
        BrokenOffError : it was ended.
        """
        now = time.monotonic()
        over = timer.exceeded(now, self._shared.in_call, begun=self._begun)
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
        points = self._points.points_ns
        component = call = None
        if self._shared.in_loop:
            k, number = self._table.place()
            self._make_ready(k)
            if number >= len(self._table.operations):  # several step side by side
                number = self._table.place_in_team() or number
            component, call = self._table.call(number)
            time_ns = int(points[k])
        elif (outside := self._shared.outside_call()) is not None:
            component, call, time_ns = outside
        else:
            time_ns = int(points[min(self._shared.complete, self._points.count - 1)])
        seconds = self._points.at_s(time_ns) if self._begun or time_ns else None
        return CallInProgress(component or None, call or None, seconds)

    def _broken(self, kind: CauseKind, what: str, limit: str | None = None) -> BrokenOffError:
        """Say that the child is gone, in which call of which component, and when."""
        printed = [line for output in self._outputs[1:] for line in output.last]
        at = self._call_in_progress()
        return broken_off(self._system, kind, what, at, limit=limit, printed=printed)

    def _complete(self) -> int:
        """Return how many rows a child that is gone has completed."""
        if not self._shared.in_loop:
            return self._shared.complete
        k, number = self._table.place()
        operations = self._table.operations
        receiving = [
            i for i, o in enumerate(operations) if isinstance(o, Move | Set) and not o.spare
        ]
        return max(k + (number > max([self._table.complete, *receiving])), self._shared.complete)

    def _log_output(self, name: str, level: str, message: str) -> None:
        if self._muted:
            return
        if self._begun and not self._over:
            self._dispatch.log_now(self._points.points_ns, name, level, message)
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
