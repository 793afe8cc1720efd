"""FMUs unpacked once per process, by the hash of their bytes.

Every process has a folder of its own among the temporary files, named by its number and the
time, and locked for as long as it lives. It is removed when the process ends; what a process
that was killed has left is removed by the next one.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import IO

from cosim.core import InputError
from cosim.fmu.description import FmuDescription
from cosim.fmu.inspect.archive import open_archive

PREFIX = "cosim-fmus-"
_LOCK = "in-use"


class _ProcessFolder:
    """The folder of this process."""

    def __init__(self) -> None:
        self.process = os.getpid()
        self.parent = Path(tempfile.gettempdir())
        _remove_stale(self.parent)
        # locked before it bears the name that a sweep looks for
        draft = Path(tempfile.mkdtemp(prefix="cosim-new-", dir=self.parent))
        self._lock = (draft / _LOCK).open("w")
        _locked(self._lock)
        self.folder = self.parent / f"{PREFIX}{self.process}-{time.time_ns()}"
        draft.rename(self.folder)

    @property
    def is_own(self) -> bool:
        """Whether it is still there, and this process not a fork of the one that made it."""
        return (
            self.process == os.getpid()
            and self.parent == Path(tempfile.gettempdir())
            and self.folder.is_dir()
        )

    def remove_unpacked(self) -> None:
        """Remove it; a fork of its process leaves it alone."""
        self._lock.close()
        if self.process == os.getpid():
            shutil.rmtree(self.folder, ignore_errors=True)


_process_folder: _ProcessFolder | None = None
_guard = threading.Lock()


def own_folder() -> Path:
    """The folder of this process, made when it is first asked for."""
    global _process_folder  # noqa: PLW0603 - there is one process
    if _process_folder is None or not _process_folder.is_own:
        if _process_folder is not None:
            _process_folder.remove_unpacked()
        else:
            atexit.register(remove_unpacked)
        _process_folder = _ProcessFolder()
    return _process_folder.folder


def remove_unpacked() -> None:
    """Remove what this process has unpacked; it is unpacked anew if it is needed again."""
    global _process_folder  # noqa: PLW0603 - there is one process
    if _process_folder is not None:
        _process_folder.remove_unpacked()
        _process_folder = None


def unpack_fmu(description: FmuDescription) -> Path:
    """The folder with the files of an FMU, shared by all its instances; read only.

    Raises
    ------
    InputError : the file is not what was described any more, or cannot be unpacked.
    """
    with _guard:
        folder = own_folder() / description.sha256
        if folder.is_dir():
            return folder
        _check_unchanged(description)
        draft = folder.with_suffix(".new")
        try:
            with open_archive(description.path) as archive:
                archive.unpack(draft)
            (draft / "resources").mkdir(exist_ok=True)  # FMUs are told where it is
            draft.rename(folder)
        except OSError as error:
            raise InputError(
                "the FMU cannot be unpacked", where=str(description.path), got=str(error)
            ) from error
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        return folder


def _check_unchanged(description: FmuDescription) -> None:
    try:
        digest = hashlib.sha256(description.path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(
            "the FMU cannot be read any more", where=str(description.path), got=str(error)
        ) from error
    if digest != description.sha256:
        raise InputError(
            "the FMU has changed since it was read",
            where=str(description.path),
            hint="start again",
        )


def _remove_stale(parent: Path) -> None:
    """Remove the folders of processes that are gone."""
    for folder in parent.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):  # somebody else's, or swept by somebody else just now
            with (folder / _LOCK).open("r+") as lock:
                gone = _locked(lock)
            if gone:
                shutil.rmtree(folder, ignore_errors=True)


def _locked(lock: IO[str]) -> bool:
    """Whether the lock could be taken, which its process holds while it lives."""
    try:
        if sys.platform == "win32":
            import msvcrt  # noqa: PLC0415 - there alone

            msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl  # noqa: PLC0415 - not on Windows

            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
