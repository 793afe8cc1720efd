"""Observers: receive complete rows and log lines in order during a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import ComponentInstance


class Observer(Protocol):
    """Receives complete rows and log lines in order while a run goes.

    Attributes
    ----------
    reads_inputs : whether it reads inputs in the rows; else they need not be copied there.
    """

    reads_inputs: bool = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Called before the first point, when all slaves are initialised."""

    def rows_complete(self, first: int, last: int) -> None:
        """Rows first to last - 1 of every instance are complete; called in order, no gaps."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """A component, or the loop, has logged a message.

        Lines come in order: none is before the last complete row, or the line before it, or after
        the row that is next.
        """

    def within_steps(
        self, component: str, times_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """A component's `intermediate` outputs within steps, (m, outputs); before the next rows."""
        del component, times_ns, values

    def rewind(self, complete: int) -> None:
        """Rows from `complete` on will be computed anew; an `InputError` if that is impossible."""
        del complete
        raise InputError(
            "recorded rows cannot be taken back",
            where=type(self).__name__,
            hint="go back in a session without it, or start a new session from the snapshot",
        )


class ObserverDispatch:
    """Collects the log lines of a segment and delivers them to observers between its rows.

    It has the clock of all log lines. Their instants come from loops, FMUs' threads and pipes,
    which are not of one mind; each line gets an instant that keeps its place among the rows.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        self.turn: Callable[[str], int] | None = None
        """Returns the place of a component while several step side by side, else 0."""
        self.points: CommunicationPoints | None = None
        """The points of the rows; None as long as there are none."""
        self.begin(observers)

    def begin(self, observers: Sequence[Observer]) -> None:
        """Begin a run with these observers: the first one, or another one."""
        self._observers = observers
        self._lines: list[tuple[int, int, int, str, str, str]] = []
        self._now_ns = 0
        self.delivered = 0
        """Number of rows that the observers have."""
        self.where: Callable[[], tuple[int, int]] = lambda: (0, 0)
        """Returns the number of complete rows, and the time [ns], at any moment."""
        self.make_whole: Callable[[int], None] = _nothing
        """Makes the first so many rows whole."""

    def note(self, name: str, level: str, message: str) -> None:
        """Log a message of a component, or of the loop, now."""
        rows, time_ns = self.where()
        turn = 0 if self.turn is None else self.turn(name)
        self.add((rows, time_ns, turn, level, name, message))

    def add(self, line: tuple[int, int, int, str, str, str]) -> None:
        """Add a log line: complete rows, time [ns], turn, level, name, message."""
        self._lines.append(line)

    def within_steps(
        self, component: str, times_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Give the observers what a component's outputs were within its steps."""
        for observer in self._observers:
            take = getattr(observer, "within_steps", None)
            if take is not None:
                take(component, times_ns, values)

    def log_now(self, name: str, level: str, message: str) -> None:
        """Log a message after the rows that the observers have, before all lines not delivered."""
        self._log(self._now_ns, level, name, message)

    def check_stop(self) -> None:
        """Raise an exception if the run is to end between two steps."""

    def deliver(self, complete: int) -> None:
        """Deliver the rows before `complete`, and the log lines before, between and after them."""
        lines, self._lines = self._lines, []
        if self.turn is not None:  # threads log in any order
            lines.sort(key=lambda line: line[:3])
        for rows, time_ns, _turn, level, name, message in lines:
            self._span(min(rows, complete))  # the row that a call breaks off is not complete
            self._log(time_ns, level, name, message)
        self._span(complete)

    def rewind(self, complete: int) -> None:
        """Prepare the observers for rows from `complete` on to be computed anew.

        What was logged until now has been: they receive it first.
        """
        self.deliver(self.delivered)
        if self.delivered > complete:
            for observer in self._observers:
                observer.rewind(complete)
        self._lines = []
        self.delivered, self._now_ns = complete, 0

    @property
    def unread(self) -> int:
        """The first row that an observer has not read yet: it may read rows late."""
        return min(
            (getattr(one, "unread", self.delivered) for one in self._observers),
            default=self.delivered,
        )

    def close(self) -> None:
        """Deliver the last log lines and release the observers."""
        self.deliver(self.delivered)
        # slaves refer to the dispatch, and a trace to the slaves: a cycle would keep all rows
        self._observers = ()
        self.make_whole = _nothing

    def _log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Log a line at its instant [ns], or as near to it as its place among the rows allows."""
        time_ns = max(time_ns, self._now_ns)
        if self.points is None:
            time_ns = 0
        elif self.delivered < self.points.count:
            time_ns = min(time_ns, int(self.points.points_ns[self.delivered]))
        self._now_ns = time_ns
        for observer in self._observers:
            observer.log(time_ns, level, name, message)

    def _span(self, until: int) -> None:
        if until > self.delivered:
            if any(getattr(each, "reads_inputs", True) for each in self._observers):
                self.make_whole(until)
            for observer in self._observers:
                observer.rows_complete(self.delivered, until)
            self.delivered = until
            if self.points is not None:
                self._now_ns = max(self._now_ns, int(self.points.points_ns[until - 1]))


def _nothing(_count: int) -> None:
    """Do nothing: there are no rows."""
