"""Reports of progress of long tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str, float], None]
"""Called with the name of the task and the share of it that is done, 0 to 1."""


def silent(_what: str, _share: float) -> None:
    """Report nothing."""


_listener: ContextVar[Progress] = ContextVar("progress", default=silent)


@contextmanager
def reported_to(listener: Progress) -> Iterator[None]:
    """Send what `report` says inside the block to a listener.

    For tasks deep below a call, such as the searches of a design, which every caller would
    otherwise have to pass the listener to.
    """
    before = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(before)


def report(what: str, share: float) -> None:
    """Report the progress of a task to the listener of `reported_to`, if there is one."""
    _listener.get()(what, min(1.0, share))
