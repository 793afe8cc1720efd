"""Keeps a child process, and executes one run after the other in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from typing import Any, Self, TypeVar

from cosim.core import InputError, Method, Worker, default_method
from cosim.master.engine import EngineName
from cosim.master.observers import Observer
from cosim.master.run import Run
from cosim.master.session import Session
from cosim.master.supervision.follow import Conduct, FollowedRun, Interruption
from cosim.master.supervision.followed_session import FollowedSession
from cosim.master.supervision.limits import Limits, most_memory
from cosim.master.supervision.messages import Message
from cosim.master.supervision.wired import Wired
from cosim.master.system import System
from cosim.trace.outcome import Cause

_PATIENCE_S = 1.0
F = TypeVar("F", bound=FollowedRun)
CHILD = "cosim.master.supervision.child:main"


@dataclass(frozen=True)
class Conducted:
    """A run, and what `conduct` returned; None if the run broke off."""

    run: Run
    found: Any


class Supervisor:
    """Executes runs in a child process, which is replaced after its death; a context manager.

    Parameters
    ----------
    limits : of each run.
    method : how the child is started; None: as is best when it is.
    interruption : asked during a run whether the user wants it to end.
    first : the system of the first run; a forked child then has it without being sent it.
    known : other objects that systems contain and that a forked child has.

    Raises
    ------
    InputError : on a system where runs cannot be supervised.

    Attributes
    ----------
    end_failure : why the slaves of a run could not be ended, typed and in words; None if all
        were.
    """

    def __init__(
        self,
        limits: Limits | None = None,
        *,
        method: Method | None = None,
        interruption: Interruption | None = None,
        first: System | None = None,
        known: Sequence[Any] = (),
    ) -> None:
        self.limits = limits or Limits()
        if default_method() is None:
            raise InputError(
                "runs cannot be supervised on this system",
                where="supervise",
                hint="supervise = false: in this process",
            )
        self.interruption, self._method = interruption, method
        self.end_failure: tuple[Cause, str] | None = None
        self._worker: Worker | None = None
        self._numbers = count(1)
        self._first, self._known = first, known
        self._wired: Wired | None = None

    def run(
        self,
        system: System,
        observers: Sequence[Observer],
        conduct: Conduct,
        *,
        living: ExitStack,
        engine: EngineName = "auto",
        keep: bool = True,
    ) -> Conducted:
        """Execute one run.

        Parameters
        ----------
        observers : receive rows and log lines, in this process.
        conduct : runs the session in the child.
        living : ends the slaves when it is closed.
        keep : whether all rows stay in memory, as in `Session`.

        Raises
        ------
        CosimError : what the session raises. A child that dies is no exception: the run has
            failed, and says why.
        """
        followed = self._followed(FollowedRun, system, observers, keep=keep)
        living.callback(self._close, followed)
        return Conducted(*followed.conduct(conduct, engine))

    def open(
        self,
        system: System,
        observers: Sequence[Observer],
        make: Callable[..., Session],
        *,
        engine: EngineName = "auto",
    ) -> FollowedSession:
        """Have a session made in the child, to be asked; close it to end the slaves."""
        followed = self._followed(FollowedSession, system, observers, keep=True)
        followed.begin(None, engine, make)
        return followed

    def _followed(
        self, kind: type[F], system: System, observers: Sequence[Observer], *, keep: bool
    ) -> F:
        worker = self._alive()
        wired, self._wired = self._wired if system is self._first else None, None
        return kind(
            worker,
            next(self._numbers),
            system,
            observers,
            self.limits,
            self.interruption,
            wired or Wired.of(system),
            keep=keep,
        )

    @property
    def _started_by(self) -> Method | None:
        return self._method or default_method()

    @property
    def method(self) -> Method | None:
        """How its child was started, or is going to be."""
        return self._started_by if self._worker is None else self._worker.method

    def begin(self, limits: Limits, known: Iterable[Any] = ()) -> None:
        """Set the limits of the runs to come; a new child has the objects in `known`."""
        self.limits, self._known = limits, list(known)
        self.end_failure = None

    def let_go(self) -> None:
        """Let the child leave, while there is something else to do; no run follows."""
        if self._worker is not None:
            self._worker.let_go()

    def close(self) -> None:
        """End the child."""
        if self._worker is not None:
            self._worker.close(_PATIENCE_S)
            self._worker = None

    def __enter__(self) -> Self:
        if self._first is not None:
            if self._started_by == "fork":
                self._wired = Wired.of(self._first)
            self._alive()  # before there are more threads and files here
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _close(self, followed: FollowedRun) -> None:
        followed.close()
        if followed.child_leaves:
            self.close()
        self.end_failure = self.end_failure or followed.end_failure

    def _alive(self) -> Worker:
        if self._worker is not None and self._worker.exit_status() is not None:
            self.close()
        if self._worker is None:
            wired = () if self._wired is None else (self._wired.wiring, self._wired.shared)
            first = () if self._first is None else (self._first,)
            self._worker = Worker(
                CHILD,
                received=Message,
                known=[*first, *self._known, *wired],
                method=self._started_by,
                loaded=True,
            )
            if self._wired is not None:
                self._wired.shared.keep_from_forks()  # of other children
            unknown = self._worker.memory_used() is None
            if unknown and self.limits.memory not in (None, most_memory()):
                raise InputError(
                    "the memory of a run cannot be limited on this system",
                    where="limits.memory",
                    expected="Linux",
                    hint="memory = 'none'",
                )
        return self._worker
