"""Rows and log lines on their way to whoever looks on, in the order in which they came about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from cosim.core import InputError
from cosim.master.component_instance import ComponentInstance


class Observer(Protocol):
    """Looks on while a run goes."""

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Before the first point, all slaves initialised."""

    def rows_complete(self, first: int, last: int) -> None:
        """Rows first to last - 1 of every station are complete; called in order, no gaps."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """A component, or the loop, has said something."""

    def rewind(self, complete: int) -> None:
        """Rows from `complete` on come about anew; an `InputError` if that cannot be."""
        del complete
        raise InputError(
            "what has been recorded cannot be taken back",
            where=type(self).__name__,
            hint="go back in a session without it, or start a new session from the snapshot",
        )


class ObserverDispatch:
    """What is said during a stretch, handed on at its place between the rows."""

    def __init__(self, observers: Sequence[Observer]) -> None:
        self._observers = observers
        self._lines: list[tuple[int, int, str, str, str]] = []
        self._delivered = 0
        self.where: Callable[[], tuple[int, int]] = lambda: (0, 0)
        """Number of complete rows, and the time [ns], at any moment."""

    def note(self, name: str, level: str, message: str) -> None:
        """A component, or the loop, says something now."""
        rows, time_ns = self.where()
        self._lines.append((rows, time_ns, level, name, message))

    def deliver(self, complete: int, *, include_after_last: bool = True) -> None:
        """Rows up to `complete`, and what was said before them, and after the last one."""
        lines, self._lines = self._lines, []
        for rows, time_ns, level, name, message in lines:
            if rows > complete or (rows == complete and not include_after_last):
                break
            self._span(rows)
            for observer in self._observers:
                observer.log(time_ns, level, name, message)
        self._span(complete)

    def rewind(self, complete: int) -> None:
        """Rows from `complete` on come about anew."""
        if self._delivered > complete:
            for observer in self._observers:
                observer.rewind(complete)
        self._lines = []
        self._delivered = complete

    def close(self) -> None:
        """What was said last, when no more rows are to come; nobody looks on after that."""
        self.deliver(self._delivered)
        # slaves know the journal, and a trace knows the slaves: a ring would keep all the rows
        self._observers = ()

    def _span(self, until: int) -> None:
        if until > self._delivered:
            for observer in self._observers:
                observer.rows_complete(self._delivered, until)
            self._delivered = until
