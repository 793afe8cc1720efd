"""Tell a watcher which FMI call this process is in, as long as the call lasts.

A process that runs FMUs for another one (`cosim.master.supervision`) sets the watcher, so that the
other process knows in which call of which component it died or hangs. Without one nothing is told.
Calls of the loop are not told here: the engine stores a word before each of them.
"""

from __future__ import annotations

from typing import Protocol


class CallWatcher(Protocol):
    """Receives the begin and end of each FMI call."""

    def begin(self, component: str, call: str) -> None:
        """A call begins; `call` is the name of the function."""

    def end(self) -> None:
        """The call has returned."""


_watchers: list[CallWatcher] = []


def watch_calls(watcher: CallWatcher | None) -> None:
    """Tell this watcher of all FMI calls from now on; None: nobody."""
    _watchers[:] = [] if watcher is None else [watcher]


class calling:  # noqa: N801 - used like a function
    """Context in which one FMI call of a component is made."""

    __slots__ = ("_call", "_component")

    def __init__(self, component: str, call: str) -> None:
        self._component, self._call = component, call

    def __enter__(self) -> None:
        for watcher in _watchers:
            watcher.begin(self._component, self._call)

    def __exit__(self, *_: object) -> None:
        for watcher in _watchers:
            watcher.end()
