"""Child processes that run foreign code: how they begin, what they use, and how they end."""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType, MappingProxyType
from typing import Any, Final, Literal, NamedTuple

_LINE_BUFFERED: Final = 1
DEATH_HINTS: Final = MappingProxyType(
    {
        "crashed": "a fault of the FMU: report it to whoever made it",
        "exited": "an FMU must not end the process: report it to whoever made it",
    }
)
"""What to do about a process that foreign code ended, by the kind of its `Death`."""


class Death(NamedTuple):
    """How a process ended.

    Attributes
    ----------
    kind : crashed: a signal ended it; exited: it left by exit().
    words : to follow the name of the process.
    """

    kind: Literal["crashed", "exited"]
    words: str


def death_of(status: int) -> Death:
    """Return how a process ended, from its exit code, or minus the signal that ended it."""
    if status < 0:
        try:
            name = signal.Signals(-status).name
        except ValueError:
            name = f"signal {-status}"
        return Death("crashed", f"crashed ({name})")
    return Death("exited", f"left with exit code {status}")


_foreign: list[str] = []


def note_foreign_code(what: str) -> None:
    """Note that foreign code is loaded into this process: its library, or module, by a name."""
    _foreign[:] = [what]


def has_foreign_code() -> bool:
    """Whether this process, or one that it was forked from, has loaded foreign code.

    Whatever that left is in every fork: static variables, a Python module of a name.
    """
    return bool(_foreign)


def prepare_for_foreign_code() -> None:
    """Make this child process ready to run foreign code for its parent.

    Ctrl-C is the parent's business, and what foreign code writes to standard output leaves at
    each line. exit(n), called there, ends this process at once and with n: what libraries of the
    parent have registered to be done at exit belongs to the parent; done here, in a fork of it,
    it may crash.
    """
    with contextlib.suppress(ValueError):  # a thread that is not the main one
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    faulthandler.disable()
    gc.freeze()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    name = "__stdoutp" if sys.platform == "darwin" else "stdout"
    with contextlib.suppress(AttributeError, OSError, ValueError):
        c = ctypes.CDLL(None)
        c.setvbuf(ctypes.c_void_p.in_dll(c, name), None, _LINE_BUFFERED, ctypes.c_size_t(0))
    with contextlib.suppress(AttributeError, OSError):  # on_exit is not everywhere
        c = ctypes.CDLL(None)
        end_at_once = c._exit  # noqa: SLF001 - it is a name of C
        c.on_exit(ctypes.cast(end_at_once, ctypes.c_void_p), None)


def flush_output() -> None:
    """Write what standard output and error keep, those of Python and of C."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, OSError, ValueError):
            stream.flush()
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).fflush(None)


def private_memory(process: int) -> int | None:
    """Return the memory that a process shares with no file [bytes]; None if unknown."""
    try:
        with open(f"/proc/{process}/statm", "rb") as file:  # noqa: PTH123 - often
            _, resident, shared, *_ = map(int, file.read().split())
    except (OSError, ValueError):
        return None
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE")


@contextlib.contextmanager
def uninterrupted(*, at_end: bool = False) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait until the end of a block, which must not stop halfway.

    at_end : of Python, which drops the exceptions of what is done there: afterwards Ctrl-C ends the
        process, unless somebody else handles it.
    """
    before: dict[int, Any] = {}
    waiting: list[int] = []

    def wait(number: int, _frame: FrameType | None) -> None:
        waiting.append(number)

    if threading.current_thread() is threading.main_thread():
        for taken in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(taken) not in (signal.SIG_IGN, None):
                before[taken] = signal.signal(taken, wait)
    if at_end and before.get(signal.SIGINT) is signal.default_int_handler:
        before[signal.SIGINT] = signal.SIG_DFL
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in waiting:
            signal.raise_signal(number)
