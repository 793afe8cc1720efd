"""Loaded by every worker process of this machine: Ctrl-C is the starter's affair.

The terminal sends it to all processes; the one that started the study ends the others.
"""

from __future__ import annotations

import contextlib
import signal


def dask_setup(_worker: object) -> None:
    """Called by Dask when a worker starts."""
    with contextlib.suppress(ValueError):  # elsewhere than in the main thread nobody gets signals
        signal.signal(signal.SIGINT, signal.SIG_IGN)
