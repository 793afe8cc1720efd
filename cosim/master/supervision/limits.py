"""Limits of time and memory of a supervised run."""

from __future__ import annotations

import os
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
    call : of one FMI call during the run [s of wall-clock time].
    run : of the whole run, from its start to its last point [s].
    start, end : of instantiation and initialisation, and of terminating and freeing [s].
    memory : of the process of the slaves beyond what it starts with [bytes]; Linux only.
    """

    call: float | None = HOUR_S
    run: float | None = None
    memory: int | None = field(default_factory=most_memory)
    start: float | None = HOUR_S
    end: float | None = HOUR_S / 6
