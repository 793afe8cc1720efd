"""The file of a trace being written: one writer at a time, `.partial` until it is finished."""

from __future__ import annotations

import errno
import os
import stat
import sys
import threading
from contextlib import suppress
from pathlib import Path

from cosim.core import InputError, LossError, lock_file
from cosim.trace.file.stream import McapStream


class PartialFile:
    """The file `<path>.partial`, renamed to `path` by `finish`.

    Data go to the operating system at once: nothing written is lost if the process is killed.

    Parameters
    ----------
    path : final path.
    fsync : flush to the disk itself, so that data survive a power cut.
    suffix : of the name until it is finished.

    Raises
    ------
    InputError : it cannot be created, or another process is writing it.
    """

    def __init__(self, path: Path, *, fsync: bool, suffix: str = ".partial") -> None:
        self.path = path
        self.partial_path = path.with_name(path.name + suffix)
        self._fsync = fsync
        if path.is_dir():
            raise InputError("the trace's path is a directory", where=str(path))
        try:
            # emptied below, once it is locked
            handle = os.open(self.partial_path, os.O_WRONLY | os.O_CREAT | _FLAGS, 0o666)
        except (OSError, ValueError) as error:  # ValueError: a null character in the path
            raise InputError(
                "the trace cannot be created",
                where=str(self.partial_path),
                expected="a writable folder",
                got=str(error),
            ) from error
        self._raw = os.fdopen(handle, "wb", buffering=0)
        try:
            _lock(handle)
        except OSError as error:
            self._raw.close()
            raise InputError(
                "the trace is being written by another run",
                where=str(self.partial_path),
                got=str(error),
                hint="give this run another file, or wait until the other one has ended",
            ) from error
        if stat.S_ISREG(os.fstat(handle).st_mode):
            os.ftruncate(handle, 0)

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
        leaves one of the two.
        """
        if self._fsync or self.path.exists():
            os.fsync(self._raw.fileno())
        self._raw.close()
        self.partial_path.replace(self.path)
        if self._fsync and sys.platform != "win32":
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def close(self) -> None:
        """Close under the name `.partial`."""
        self._raw.close()

    def discard(self) -> None:
        """Close and remove the file."""
        self._raw.close()
        self.partial_path.unlink(missing_ok=True)

    def cut(self, size: int) -> None:
        """Close the file, cut to `size`: without the half record left by a disk that failed."""
        try:
            with suppress(OSError):  # a file with half a record at its end is readable, too
                if self._raw.seek(0, os.SEEK_END) > size:
                    self._raw.truncate(size)
        finally:
            self._raw.close()


_FLAGS = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)


def _lock(handle: int) -> None:
    """Lock the file against a second writer until it is closed or the process ends."""
    if not lock_file(handle):
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))


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
        return LossError(
            "the trace could not be written",
            where=str(self._file.partial_path),
            got=str(error),
            hint="make room on the disk; what was written before is in the .partial file "
            "(cosim trace recover)",
        )
