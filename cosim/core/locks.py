"""Locks of files and folders, which a process holds while it lives and they are open.

A folder that is to be gone with its process is locked before it has its name. So one of that name
that is not locked was left by a process that was killed, and the next process removes it.
"""

from __future__ import annotations

import os
import re
import shutil
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

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


FOLDERS_HAVE_LOCKS: Final = os.name == "posix" and find_spec("fcntl") is not None
"""Windows opens no folder, and renames none in which a file is open."""
_DRAFT: Final = re.compile(r"\.\d\.new\Z")
_DRAFTS: Final = 10


def locked_folder(folder: Path) -> int | None:
    """Make a folder that only this user can read, locked before it has its name.

    Return the descriptor that holds the lock; None where folders have no locks. A draft that is not
    locked yet may be taken for one that was left: it is made again. A file system may have no
    locks: then nobody takes one, and the folder goes without.

    Raises
    ------
    OSError : it cannot be made.
    """
    if not FOLDERS_HAVE_LOCKS:
        folder.mkdir(0o700)
        return None
    for attempt in range(_DRAFTS - 1):
        with suppress(FileNotFoundError):
            lock = _locked(folder, attempt, anyway=False)
            if lock is not None:
                return lock
    return _locked(folder, _DRAFTS - 1, anyway=True)


def _locked(folder: Path, attempt: int, *, anyway: bool) -> int | None:
    """Make a folder as `locked_folder`; None: it had no lock, which does not matter `anyway`."""
    draft = folder.with_name(f"{folder.name}.{attempt}.new")
    draft.mkdir(0o700)
    lock = -1
    try:
        lock = os.open(draft, os.O_RDONLY)
        if lock_file(lock) or anyway:
            draft.rename(folder)
            return lock
    except BaseException:  # a signal, too
        _discard(draft, lock)
        raise
    _discard(draft, lock)
    return None


def _discard(draft: Path, lock: int) -> None:
    with suppress(OSError):
        draft.rmdir()
    if lock >= 0:
        os.close(lock)


def remove_left(parent: Path, name: re.Pattern[str]) -> None:
    """Remove this user's folders of such names in another one, with drafts, that are not locked."""
    if not FOLDERS_HAVE_LOCKS:
        return
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if name.fullmatch(_DRAFT.sub("", entry.name)):
                _remove_if_left(Path(entry.path))


def _remove_if_left(folder: Path) -> None:
    with suppress(OSError):  # another user's, or no folder
        lock = os.open(folder, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
        try:
            if os.fstat(lock).st_uid == os.geteuid() and lock_file(lock):
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)


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
