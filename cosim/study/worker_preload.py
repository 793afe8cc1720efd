"""Loaded by every local worker process: ignores Ctrl-C.

The terminal sends it to all processes; the one that started the study ends the others.
"""

from __future__ import annotations

import contextlib
import signal


def dask_setup(_worker: object) -> None:
    """Ignore SIGINT; Dask calls this when a worker starts."""
    with contextlib.suppress(ValueError):  # only the main thread can set it
        signal.signal(signal.SIGINT, signal.SIG_IGN)
