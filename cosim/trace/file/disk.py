"""The file of a trace being written: one writer at a time, `.partial` until it is finished."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import threading
from contextlib import suppress
from itertools import count
from pathlib import Path

from cosim.core import (
    CosimError,
    InputError,
    LossError,
    lock_file,
    output_place,
    say_once,
    written_beside,
)
from cosim.trace.file.stream import McapStream
from cosim.trace.file.walk import Walk


class PartialFile:
    """The file `<path>.partial`, renamed to `path` by `finish`.

    Data go to the operating system at once: nothing written is lost if the process is killed.

    Parameters
    ----------
    path : final path; a symlink stands for what it names.
    fsync : flush to the disk itself, so that data survive a power cut.

    A partial file with rows that a run left which has died is set aside: `<path>.partial.1` and so
    on.

    Raises
    ------
    InputError : it cannot be created, is no regular file, or another process is writing it.
    """

    def __init__(self, path: Path, *, fsync: bool) -> None:
        self._fsync = fsync
        try:
            self.path = output_place(path).path
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.partial_path = self.path.with_name(f"{self.path.name}.partial")
            handle = self._new()
        except OSError as error:
            raise InputError(
                "the trace cannot be created",
                where=str(path),
                expected="a writable folder",
                got=str(error),
            ) from error
        self._raw = os.fdopen(handle, "r+b", buffering=0)

    def _new(self) -> int:
        """Make the partial file, in place of what a dead run left; return its descriptor."""
        for _ in range(_TRIES):
            try:
                handle = os.open(self.partial_path, _NEW | _FLAGS, 0o666)
            except FileExistsError:
                self._make_room()
                continue
            if lock_file(handle):
                return handle
            os.close(handle)  # another run that begins just now was quicker
            break
        raise self._taken()

    def _make_room(self) -> None:
        """Set aside what a run that has died left under the name, or remove it if it has no rows.

        Raises
        ------
        InputError : it is another run's, another user's, or nothing that a run writes.
        """
        what = os.lstat(self.partial_path)
        me = os.geteuid() if hasattr(os, "geteuid") else what.st_uid  # Windows has no users here
        if not stat.S_ISREG(what.st_mode) or what.st_uid != me:
            raise InputError(
                "what stands in the place of the trace was not made by a run of yours",
                where=str(self.partial_path),
                got="a file of another user" if stat.S_ISREG(what.st_mode) else "no regular file",
                hint="another name, or another folder",
            )
        handle = os.open(self.partial_path, os.O_RDWR | _FLAGS)
        try:
            if not lock_file(handle):
                raise self._taken()
            there = os.lstat(self.partial_path)
            if (there.st_dev, there.st_ino) != (what.st_dev, what.st_ino):
                return
            if there.st_size and _has_rows(self.partial_path):
                aside = self._set_aside()
                say_once(
                    f"{aside} has the rows of a run that did not end: cosim trace recover {aside}"
                )
            else:
                self.partial_path.unlink()
        finally:
            os.close(handle)

    def _set_aside(self) -> Path:
        for number in count(1):
            aside = self.partial_path.with_name(f"{self.partial_path.name}.{number}")
            if not os.path.lexists(aside):
                self.partial_path.rename(aside)
                return aside
        raise AssertionError

    def _taken(self) -> InputError:
        return InputError(
            "the trace is being written by another run",
            where=str(self.partial_path),
            hint="give this run another file, or wait until the other one has ended",
        )

    def write(self, data: bytes | memoryview) -> int:
        """Write all the data and return their number of bytes."""
        left = memoryview(data)
        while left:
            left = left[self._raw.write(left) :]
        return len(data)

    def flush(self) -> None:
        """Flush to the disk itself, if `fsync` is set."""
        if self._fsync:
            os.fsync(self._raw.fileno())

    def finish(self) -> None:
        """Close the file and rename it to its final name.

        A file of this name is replaced only once the new one is on the disk itself: a power cut
        leaves one of the two. Where somebody has removed the file meanwhile, or has put another
        one in its place, what is written is copied to the final name.
        """
        safely = self._fsync or self.path.exists()
        if safely:
            os.fsync(self._raw.fileno())
        if not self._is_in_place():
            self._copy(safely=safely)
        else:
            if sys.platform == "win32":  # where no open file has another name
                self._raw.close()
            self.partial_path.replace(self.path)
        if self._fsync and sys.platform != "win32":
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        self._raw.close()

    def _is_in_place(self) -> bool:
        """Whether the open file is the one that has its name."""
        try:
            return os.path.samestat(os.fstat(self._raw.fileno()), os.lstat(self.partial_path))
        except OSError:
            return False

    def _copy(self, *, safely: bool) -> None:
        """Copy the open file, which has no name any more, to the final name."""
        with written_beside(self.path) as beside, beside.open("wb") as copy:
            self._raw.seek(0)
            shutil.copyfileobj(self._raw, copy)
            copy.flush()
            if safely:
                os.fsync(copy.fileno())

    def close(self) -> None:
        """Close under the name `.partial`."""
        self._raw.close()

    def cut(self, size: int) -> None:
        """Close the file, cut to `size`: without the half record left by a disk that failed."""
        if self._raw.closed:
            return
        try:
            with suppress(OSError):  # a file with half a record at its end is readable, too
                if self._raw.seek(0, os.SEEK_END) > size:
                    self._raw.truncate(size)
        finally:
            self._raw.close()


_TRIES = 10
_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL
_FLAGS = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)


def _has_rows(path: Path) -> bool:
    """Whether a file has messages, or may have some in what is damaged or no trace at all."""
    try:
        walk = Walk(path, "skip")
        return any(record.messages for record in walk) or bool(walk.damage)
    except CosimError:
        return True


class Guard:
    """A lock around every use of the file, which refuses uses after its end.

    A failure of the disk is raised as `LossError`; one in the flusher's thread at the next use.
    """

    def __init__(self, file: PartialFile, stream: McapStream) -> None:
        self.lock = threading.RLock()
        self.open = True
        self._file = file
        self._stream = stream
        self._failure: OSError | None = None

    def __enter__(self) -> None:
        self.lock.acquire()
        try:
            self.check()
        except BaseException:
            self.lock.release()
            raise

    def check(self) -> None:
        """Raise `LossError` if the disk has failed, `InputError` if the file is closed."""
        if self.open:
            return
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise self._loss(failure) from failure
        raise InputError(
            "the trace is closed",
            where=str(self._file.path),
            hint="write before finish() or close()",
        )

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        try:
            if isinstance(error, OSError):
                self.fail(error)
                self._failure = None
                raise self._loss(error) from error
        finally:
            self.lock.release()

    def fail(self, error: OSError) -> None:
        """Close the file after a failure of the disk, with its whole records."""
        self.open = False
        self._failure = error
        self._file.cut(self._stream.position)

    def forget(self) -> None:
        """Release the file untouched, in a forked process: it is the parent's."""
        self.lock = threading.RLock()
        self.open = False
        self._file.close()

    def _loss(self, error: OSError) -> LossError:
        left = self._file.partial_path.exists()
        return LossError(
            "the trace could not be written",
            where=str(self._file.partial_path if left else self._file.path),
            got=str(error),
            hint="make room on the disk; what was written before is in the .partial file "
            "(cosim trace recover)"
            if left
            else "the .partial file is gone; cosim trace verify says whether the trace is whole",
        )
