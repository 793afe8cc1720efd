"""Unpack each FMU once per process, into a folder named by the hash of its bytes.

Every process has its own temporary folder, named by process number and time and locked as long as
the process lives. It is removed at exit; the folder of a killed process is removed by the next one.
Where the system has no locks, or renames no folder in which a file is open (Windows), nobody can
tell who lives: no folder is removed but one's own.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import re
import shutil
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.core import FOLDERS_HAVE_LOCKS, InputError, locked_folder, remove_left, uninterrupted
from cosim.fmu.inspect.archive import open_archive

if TYPE_CHECKING:
    from cosim.fmu.description import FmuDescription

PREFIX = "cosim-unpacked-" if FOLDERS_HAVE_LOCKS else "cosim-kept-"
_OF_PROCESS = re.compile(f"{PREFIX}[0-9]+-[0-9]+")


class _ProcessFolder:
    """The temporary folder of one process."""

    def __init__(self) -> None:
        self.process = os.getpid()
        self.parent = Path(tempfile.gettempdir())
        remove_left(self.parent, _OF_PROCESS)
        self.folder = self.parent / f"{PREFIX}{self.process}-{time.time_ns()}"
        self._lock = locked_folder(self.folder)

    @property
    def is_own(self) -> bool:
        """Whether it still exists and this process made it, not the one that it was forked from."""
        return (
            self.process == os.getpid()
            and self.parent == Path(tempfile.gettempdir())
            and self.folder.is_dir()
        )

    def remove_unpacked(self) -> None:
        """Remove it, unless this process is a fork of the one that made it."""
        if self._lock is not None:
            with contextlib.suppress(OSError):  # foreign code may close any descriptor
                os.close(self._lock)
        if self.process == os.getpid():
            shutil.rmtree(self.folder, ignore_errors=True)
            _remove_one_by_one(self.folder)


def _remove_one_by_one(folder: Path) -> None:
    """Remove what is left: `rmtree` holds a descriptor for each level, and there may be too few."""
    for place, _, files in os.walk(folder, topdown=False):
        with contextlib.suppress(OSError):
            for name in files:
                Path(place, name).unlink()
            Path(place).rmdir()


class _AdoptedFolder:
    """The folder of another process, which removes it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.is_own = True

    def remove_unpacked(self) -> None:
        """Leave it to its owner."""


_process_folder: _ProcessFolder | _AdoptedFolder | None = None
_guard = threading.RLock()


def own_folder() -> Path:
    """Return the folder of this process; the first call makes it."""
    global _process_folder  # noqa: PLW0603 - there is one process
    with _guard:
        if _process_folder is None or not _process_folder.is_own:
            with uninterrupted():
                if _process_folder is not None:
                    _process_folder.remove_unpacked()
                else:
                    atexit.register(_remove_at_exit)
                _process_folder = _ProcessFolder()
        return _process_folder.folder


def adopt_folder(folder: Path) -> None:
    """Use the folder of another process, which outlives this one and removes the folder."""
    global _process_folder  # noqa: PLW0603 - there is one process
    with _guard:
        remove_unpacked()  # in a fork that is the other process's: its file is closed
        _process_folder = _AdoptedFolder(folder)


def remove_unpacked() -> None:
    """Remove what this process has unpacked; it is unpacked again when needed."""
    global _process_folder  # noqa: PLW0603 - there is one process
    with _guard:
        if _process_folder is not None:
            _process_folder.remove_unpacked()
            _process_folder = None


def _remove_at_exit() -> None:
    with uninterrupted(at_end=True):
        remove_unpacked()


def unpack_fmu(description: FmuDescription) -> Path:
    """Unpack an FMU and return its folder, which all its instances share; read only.

    Raises
    ------
    InputError : the file has changed since it was described, or cannot be unpacked.
    """
    with _guard:
        folder = own_folder() / description.sha256
        if folder.is_dir():
            return folder
        archive = open_archive(description.path, description.sha256)
        draft = folder.with_suffix(".new")
        try:
            draft.mkdir()  # not the folder of a process that is gone, which nobody would remove
            archive.unpack(draft)
            (draft / "resources").mkdir(exist_ok=True)  # FMUs get its path
            draft.rename(folder)
        except OSError as error:
            raise InputError(
                "the FMU cannot be unpacked", where=str(description.path), got=str(error)
            ) from error
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        return folder
