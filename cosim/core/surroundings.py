"""What foreign code finds in a process and may change: put back, so that the next run finds it too.

A run begins in an empty folder of its own. What it changes is put back after it where that is
possible; where it is not, or where what changed it may still rely on it, the process has to be
replaced by a new one. Rounding and tiny numbers are kept at every call (`cosim.fmu.float_mode`).
"""

from __future__ import annotations

import contextlib
import ctypes
import locale
import os
import shutil
import signal
import sys
from collections.abc import Callable, Mapping
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, Final

_SIZE_OF_ACTION: Final = 160
"""At least sizeof(struct sigaction): 152 with glibc and musl, 16 on macOS."""
_ADDRESS: Final = ctypes.sizeof(ctypes.c_void_p)
_STREAMS: Final = (0, 1, 2)
_numbers: Final = count(1)


class Surroundings:
    """What this process is to foreign code, as it is now.

    Environment, locale, umask, timers, signals that are blocked and soft limits are put back.
    What a signal does is not: a runtime that stays in the process may rely on it. Nor are hard
    limits, and standard streams that were closed.
    """

    def __init__(self) -> None:
        self._found = {name: look() for name, (look, _) in _LOOKS.items()}
        self._before = os.open(".", os.O_RDONLY)
        self._folder: Path | None = None
        self._of_folder: tuple[int, int] | None = None

    def enter_folder(self, place: Path) -> None:
        """Make an empty folder below `place` the working directory; an untouched one is kept."""
        if self._folder is not None and self._is_untouched(self._folder):
            return
        self._leave()
        folder = place / f"run-{os.getpid()}-{next(_numbers)}"
        folder.mkdir(parents=True)
        os.chdir(folder)
        self._folder, self._of_folder = folder, _identity(".")

    def _is_untouched(self, folder: Path) -> bool:
        try:
            same = _identity(".") == _identity(folder) == self._of_folder
            return same and not os.listdir(folder)  # noqa: PTH208 - often
        except OSError:
            return False

    def _leave(self) -> None:
        os.fchdir(self._before)
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        self._folder = None

    def put_back(self) -> list[str]:
        """Put back what was changed; return in words what stays changed: replace the process."""
        changed = []
        for name, (look, put_back) in _LOOKS.items():
            found = self._found[name]
            now = look()
            if now == found:
                continue
            with contextlib.suppress(OSError, ValueError):
                put_back(found)
                now = look()
            if now != found:
                changed.append(name)
        return changed

    def close(self) -> None:
        """Return to the working directory from before."""
        self._leave()
        os.close(self._before)


def _identity(path: str | Path) -> tuple[int, int]:
    found = os.stat(path)  # noqa: PTH116 - often
    return found.st_dev, found.st_ino


@cache
def _c() -> Any:
    library = ctypes.CDLL(None)
    library.setlocale.argtypes = [ctypes.c_int, ctypes.c_char_p]
    library.setlocale.restype = ctypes.c_char_p
    return library


@cache
def _look_at_actions() -> tuple[Callable[..., int], Any, list[tuple[int, Any]]]:
    """Return the function, the memory for its results, and signals with the place of each there."""
    never = {getattr(signal, name, None) for name in ("SIGKILL", "SIGSTOP")}
    numbers = [int(number) for number in signal.Signals if number not in never]
    memory = ctypes.create_string_buffer(_SIZE_OF_ACTION * len(numbers))
    begin = ctypes.addressof(memory)
    places = [
        (number, ctypes.c_void_p(begin + turn * _SIZE_OF_ACTION))
        for turn, number in enumerate(numbers)
    ]
    return _c().sigaction, memory, places


def _actions() -> list[bytes]:
    """Return the address of what each signal calls: C sets it without Python's knowledge."""
    look, memory, places = _look_at_actions()
    for number, place in places:
        look(number, None, place)
    content = memory.raw  # the address comes first; behind the mask are bytes that nobody sets
    return [content[at : at + _ADDRESS] for at in range(0, len(content), _SIZE_OF_ACTION)]


def _blocked() -> set[Any]:
    return signal.pthread_sigmask(signal.SIG_BLOCK, ())


def _environment() -> frozenset[bytes]:
    """Return the environment of C, which Python sees as it was at its start."""
    if sys.platform == "darwin":
        function = _c()._NSGetEnviron  # noqa: SLF001 - it is a name of C
        function.restype = ctypes.POINTER(ctypes.POINTER(ctypes.c_char_p))
        entries = function().contents
    else:
        entries = ctypes.POINTER(ctypes.c_char_p).in_dll(_c(), "environ")
    found: list[bytes] = []
    while entries and (entry := entries[len(found)]) is not None:
        found.append(entry)
    return frozenset(found)


def _set_environment(wanted: frozenset[bytes]) -> None:
    present, given = (
        dict(entry.partition(b"=")[::2] for entry in entries)
        for entries in (_environment(), wanted)
    )
    for name in present.keys() - given.keys():
        os.environb.pop(name, None)
        os.unsetenv(name)
    for name, value in given.items():
        if present.get(name) != value:
            os.environb[name] = value


def _umask() -> int:
    found = os.umask(0o077)
    os.umask(found)
    return found


_TIMERS: Final = tuple(
    getattr(signal, name)
    for name in ("ITIMER_REAL", "ITIMER_VIRTUAL", "ITIMER_PROF")
    if hasattr(signal, name)
)


def _timers() -> list[tuple[float, float]]:
    return [(0.0, 0.0) if not any(one) else one for one in map(signal.getitimer, _TIMERS)]


def _set_timers(_wanted: object) -> None:
    for timer in _TIMERS:
        signal.setitimer(timer, 0.0)


@cache
def _limits_known() -> tuple[int, ...]:
    import resource  # noqa: PLC0415 - not on Windows

    names = (name for name in dir(resource) if name.startswith("RLIMIT_"))
    return tuple(sorted({getattr(resource, name) for name in names}))


def _limits() -> list[tuple[int, int]]:
    import resource  # noqa: PLC0415 - not on Windows

    return [resource.getrlimit(number) for number in _limits_known()]


def _set_limits(wanted: list[tuple[int, int]]) -> None:
    import resource  # noqa: PLC0415 - not on Windows

    for number, limit in zip(_limits_known(), wanted, strict=True):
        if resource.getrlimit(number) != limit:
            resource.setrlimit(number, limit)


def _streams() -> list[tuple[int, int] | None]:
    found: list[tuple[int, int] | None] = []
    for descriptor in _STREAMS:
        try:
            of = os.fstat(descriptor)
            found.append((of.st_dev, of.st_ino))
        except OSError:
            found.append(None)
    return found


def _leave_it(_wanted: object) -> None:
    """Change nothing: a runtime that is still there may rely on it, or it cannot be undone."""


_LOOKS: Final[Mapping[str, tuple[Callable[[], Any], Callable[[Any], Any]]]] = {
    "environment": (_environment, _set_environment),
    "locale": (
        lambda: _c().setlocale(locale.LC_ALL, None),
        lambda wanted: _c().setlocale(locale.LC_ALL, wanted),
    ),
    "umask": (_umask, os.umask),
    "timers": (_timers, _set_timers),
    "blocked signals": (
        _blocked,
        lambda wanted: signal.pthread_sigmask(signal.SIG_SETMASK, wanted),
    ),
    "limits of the process": (_limits, _set_limits),
    "what signals do": (_actions, _leave_it),
    "standard streams": (_streams, _leave_it),
}
"""What is looked at: how, and how it is put back."""
