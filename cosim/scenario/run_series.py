"""What runs that are made one after the other share, so that it is made once."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.master import EngineName, Observer, Session, System
from cosim.scenario.assembly import Assembled

_MOST_POINTS = 1 << 20
"""Runs of more points are not kept: their rows take too much memory."""


class RunSeries:
    """Runs that are made one after the other, in this process; `close` ends their slaves.

    Attributes
    ----------
    assembled : the last system by purpose, parts of which the next one may have as well.
    """

    def __init__(self) -> None:
        self.assembled: dict[str, Assembled] = {}
        self._sessions: dict[str, Session] = {}

    def takes(self, system: System) -> bool:
        """Whether a run is to be one of the series."""
        return system.comm_schedule.most <= _MOST_POINTS

    def open(
        self, purpose: str, system: System, observers: Sequence[Observer], engine: EngineName
    ) -> Session:
        """Return an open session for a run, with all rows kept until the next of this purpose.

        The one before is used again where that changes no bit (`Session.can_begin_again`).

        Raises
        ------
        InputError, ComponentError : as `Session`.
        """
        session = self._sessions.pop(purpose, None)
        if session is not None and session.can_begin_again(system):
            session.begin_again(system, observers)
        else:
            if session is not None:
                session.close()
            session = Session(system, observers, engine=engine).__enter__()
        self._sessions[purpose] = session
        return session

    def close(self) -> None:
        """End all slaves."""
        while self._sessions:
            self._sessions.popitem()[1].close()
