"""Isolated slaves for tests: forked, since a fresh interpreter takes a third of a second."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psutil

from cosim.fmu import FmuDescription, FmuSlave, SlaveProcess


@contextmanager
def isolated_slave(
    described: FmuDescription, log: Any = lambda *_: None, **more: Any
) -> Iterator[FmuSlave]:
    """A slave in a process of its own, not initialised."""
    process = SlaveProcess("it", described, **more)
    try:
        process.wait_until_ready()
        with FmuSlave(described, "it", log, process=process) as slave:
            yield slave
    finally:
        process.close()


def children() -> set[int]:
    """The processes that this one has started, and that have not been waited for."""
    gc.collect()
    return {one.pid for one in psutil.Process().children(recursive=True)}
