"""Locks of files, which a process holds while it lives and the file is open."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

_BEYOND = 1 << 40
"""Where the byte that is locked on Windows lies: a lock there keeps others from reading it."""


def lock_file(file: int | Any) -> bool:
    """Take the lock of an open file; return False where another process has it.

    The lock ends with the file, or the process. Where the system has no locks, it is always free.

    file : a descriptor, or a file that has one.
    """
    descriptor = file if isinstance(file, int) else file.fileno()
    try:
        import fcntl  # noqa: PLC0415 - not on Windows
    except ImportError:
        return _lock_byte(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def has_locks() -> bool:
    """Return whether the system has locks of files; where not, `lock_file` finds all free."""
    return any(find_spec(name) is not None for name in ("fcntl", "msvcrt"))


def _lock_byte(descriptor: int) -> bool:
    """Lock one byte beyond the end of the file, and leave its position where it was."""
    try:
        import msvcrt  # noqa: PLC0415 - on Windows only
    except ImportError:
        return True
    windows: Any = msvcrt
    position = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        os.lseek(descriptor, _BEYOND, os.SEEK_SET)
        windows.locking(descriptor, windows.LK_NBLCK, 1)
    except OSError:
        return False
    finally:
        os.lseek(descriptor, position, os.SEEK_SET)
    return True
