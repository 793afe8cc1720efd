"""Limits of time and memory of a supervised run."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from typing import Final

HOUR_S: Final = 3600.0
_SHARE: Final = 0.9


def most_memory() -> int | None:
    """Return the default limit of memory: nine tenths of the machine's; None if unknown."""
    try:
        return int(_SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):  # not on this system
        return None


@dataclass(frozen=True)
class Limits:
    """What a run may use; None: no limit.

    The defaults are far beyond what a slow FMU needs: they end runs that nobody waits for.

    Attributes
    ----------
    call : of one FMI call during the run, and of what is done between two [s of wall-clock time].
    run : of the whole run, from its start to its last point [s].
    start, end : of instantiation and initialisation, and of terminating and freeing [s].
    memory : of the process of the slaves beyond what it starts with [bytes]; Linux only.
    waited : how much of `run` is over when the run starts [s], since it is repeated.
    """

    call: float | None = HOUR_S
    run: float | None = None
    memory: int | None = field(default_factory=most_memory)
    start: float | None = HOUR_S
    end: float | None = HOUR_S / 6
    waited: float = 0.0


class Timer:
    """Knows how long start, run and end have taken, and how long the child has not gone on."""

    def __init__(self, limits: Limits, *, closing: bool) -> None:
        self._limits, self._closing = limits, closing
        self._since = self._seen_at = time.monotonic()
        self._seen: tuple[int, ...] = ()

    def exceeded(self, now: float, sign_of_life: tuple[int, ...], *, begun: bool) -> str | None:
        """Return the name of a limit that is exceeded.

        That of a call counts between two calls, too: nothing that the child does by itself takes
        as long as a call may.
        """
        if sign_of_life != self._seen:
            self._seen, self._seen_at = sign_of_life, now
        if self._closing:
            return "end" if _more(now - self._since, self._limits.end) else None
        if _more(self._limits.waited + now - self._since, self._limits.run):
            return "run"
        if not begun:
            return "start" if _more(now - self._since, self._limits.start) else None
        return "call" if _more(now - self._seen_at, self._limits.call) else None


def _more(seconds: float, limit: float | None) -> bool:
    return limit is not None and seconds > limit
