"""Reports of progress of long tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

Progress = Callable[[str, float], None]
"""Called with the name of the task and the share of it that is done, 0 to 1."""


def silent(_what: str, _share: float) -> None:
    """Report nothing."""


def _nothing() -> None:
    """Do nothing."""


class _Listener(NamedTuple):
    progress: Progress
    goes_on: Callable[[], None]


_NOBODY = _Listener(silent, _nothing)
_listener: ContextVar[_Listener] = ContextVar("progress", default=_NOBODY)


@contextmanager
def reported_to(listener: Progress, goes_on: Callable[[], None] = _nothing) -> Iterator[None]:
    """Send what `report` says inside the block to a listener.

    For tasks deep below a call, such as the searches of a design, which every caller would
    otherwise have to pass the listener to.

    goes_on : called by `still_working`.
    """
    before = _listener.set(_Listener(listener, goes_on))
    try:
        yield
    finally:
        _listener.reset(before)


def report(what: str, share: float) -> None:
    """Report the progress of a task to the listener of `reported_to`, if there is one."""
    _listener.get().progress(what, min(1.0, share))


def still_working() -> None:
    """Say that the task reported last goes on, from a loop that does not know its share."""
    _listener.get().goes_on()
