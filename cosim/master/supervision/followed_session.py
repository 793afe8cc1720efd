"""The parent's side of a session in the child: it is asked call by call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import CosimError
from cosim.master.component_instance import ComponentInstance
from cosim.master.engine import EngineChoice
from cosim.master.run import Run, RunStatus
from cosim.master.snapshot import Snapshot, fingerprint
from cosim.master.supervision.broken_off import BrokenOffError
from cosim.master.supervision.follow import FollowedRun
from cosim.master.supervision.messages import Answer, Raised, Request, SessionState
from cosim.network import LinkState
from cosim.trace.outcome import Cause


class AskedError(Exception):
    """What a session was asked for has raised an error.

    Attributes
    ----------
    error, state : the error, and how the session stands; None: it is not open.
    """

    def __init__(self, error: CosimError, state: SessionState | None) -> None:
        super().__init__(error.text())
        self.error, self.state = error, state


class FollowedSession(FollowedRun):
    """A session in the child, followed from here; close it to end the slaves."""

    _goes_back = True

    def ask(
        self, function: Callable[..., Any], *arguments: Any, result: Any = None
    ) -> tuple[Any, SessionState]:
        """Have a function called with the session; return its result, and how the session stands.

        result : the type of what it returns.

        Raises
        ------
        BrokenOffError : the child is gone.
        AskedError : the function has raised an error.
        """
        self._stop_since = self._stop_cause = None
        self._shared.clear_stop()
        self._tell(Request(self._number, function, arguments))
        answer = self.answer()
        if self._stop_cause is not None and self._stop_cause.kind == "timed-out":
            raise self._broken("timed-out", self._stop_cause.detail or "", "limits.run")
        return self._checked(answer.found, result), answer.state

    def answer(self) -> Answer:
        """Wait until the child has done what it was asked for last; raise as `ask`."""
        try:
            found: Answer | Raised = self._follow(Answer, Raised)
        except BrokenOffError:
            raise
        except BaseException as error:
            self._abandon(error)
            raise
        if isinstance(found, Raised):
            raise AskedError(found.error.error(), found.state)
        return found

    @property
    def engine(self) -> EngineChoice:
        """The engine of the run, once it has begun."""
        return self._engine

    @property
    def instances(self) -> Sequence[ComponentInstance]:
        """The component instances, in the order in which they receive."""
        return self._wiring.instances

    @property
    def points_ns(self) -> NDArray[np.int64]:
        """The communication points known so far [ns]."""
        return self._points.points_ns[: self._points.count]

    def link_state(self, link: str, rows: int) -> LinkState:
        """Return the state of a packet link at the last of so many complete rows."""
        return self._points.state(link, rows - 1, rows)

    def run_so_far(
        self, count: int, status: RunStatus, reason: str | None, cause: Cause | None
    ) -> Run:
        """Return the run of which the first `count` rows are known, with rows of its own.

        The last of them may be one that is exchanged again: it is made whole anew then.
        """
        points = self._points
        if count > points.count and not points.crossing and not points.has_events:
            first = points.ready
            points.extend()  # as the child did to exchange values at its present point
            self._wiring.fill_routes(first, points.ready)
        count = min(max(count, 0), points.count)
        self._taken_rows.show(count)
        found = Run.of(self._wiring, count, status, reason, self._engine, cause, kept=True).owned()
        self._wiring.whole_rows = min(self._wiring.whole_rows, self._dispatch.delivered)
        return found

    def check_snapshot(self, snapshot: Snapshot) -> None:
        """Refuse a snapshot of another system."""
        snapshot.check(fingerprint(self._system, self._wiring))

    def snapshot(self, complete: int, *, whole: bool = False) -> Snapshot:
        """Return what is known here of the present state of a session; `whole` : with its rows."""
        wiring, points = self._wiring, self._points
        wiring.make_whole(complete)
        self._taken_rows.show(complete + 1)
        return Snapshot(
            fingerprint(self._system, wiring),
            complete,
            wiring.rows[: complete + 1 if whole else 0].copy(),
            wiring.texts.all(),
            states={},
            adjustments={},
            values={name: tuple(given) for name, given in points.values.items()},
            event_values=points.event_values.all(),
        )

    def rewind(self, complete: int) -> None:
        """Prepare the observers for rows from `complete` on to be computed anew."""
        self._dispatch.rewind(complete)
        self._taken_rows.forget()

    def go_back(self, snapshot: Snapshot) -> None:
        """Follow the child back to a snapshot, to which it has returned."""
        self._wiring.texts.restore(snapshot.texts)
        self._points.go_back(snapshot.values, snapshot.event_values, snapshot.complete)
        self._wiring.fill_routes(0, self._points.ready)
        self._wiring.whole_rows = snapshot.complete
