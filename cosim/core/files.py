"""The one writer of files: they are complete or absent, and nothing else is replaced by them."""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

from cosim.core.errors import InputError, did_you_mean, nearest

_MOST_FILES = 10_000


def cache_folder() -> Path:
    """Return the user's folder for what can be made again; it may not exist, or not be writable.

    Without a home it is a path that nobody can make.
    """
    from platformdirs import user_cache_path  # noqa: PLC0415 - most commands need no cache

    folder = user_cache_path("auv-cosim", appauthor=False)
    # where there is no home, the path begins with its sign, and would be made in this folder
    return folder if folder.is_absolute() else Path(os.devnull, "auv-cosim")


def unreadable(
    path: Path, error: OSError | ValueError, *, what: str = "the file cannot be read", **more: str
) -> InputError:
    """Return the error for a file that a user named and that cannot be read.

    more : `expected`, and a `hint` for where no file of a similar name is beside it.
    """
    missing = isinstance(error, FileNotFoundError | NotADirectoryError)
    if missing:
        what, reason = f"{what}: there is no such file", None
    else:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
    hint = (similar_files(path) if missing else None) or more.pop("hint", None)
    more.pop("hint", None)
    return InputError(what, where=str(path), got=reason, hint=hint, **more)


def similar_files(path: Path) -> str | None:
    r"""Return the hint that names files like one that is missing; None if there are none.

    A path that Windows wrote, sub\file, is pointed out where that is not a path.
    """
    if "\\" in str(path) and os.sep != "\\":
        return f"with forward slashes: {str(path).replace(chr(92), '/')}"
    if path.is_dir():
        return "this is a folder; name the file in it"
    beside: list[str] = []
    with suppress(OSError, ValueError):
        names = (entry.name for entry in path.parent.iterdir())
        beside = [n for n, _ in zip(names, range(_MOST_FILES)) if n.endswith(path.suffix)]  # noqa: B905
    found = nearest(path.stem, sorted(name.removesuffix(path.suffix) for name in beside))
    return did_you_mean(f"{stem}{path.suffix}" for stem in found)


class OutputPlace(NamedTuple):
    """Where an output goes.

    Attributes
    ----------
    path : what the given path stands for, symlinks resolved once; a new name, or a regular file.
    stream : descriptor of a device or a pipe in its place, which the caller closes; None: a file.
    """

    path: Path
    stream: int | None


def output_place(path: Path, *, streams: bool = False) -> OutputPlace:
    """Find where an output of this name goes, before any work is done for it.

    streams : devices and pipes are opened, and written straight into; else they are refused.

    Raises
    ------
    InputError : a folder, a socket, a disk; a device or pipe that is not wanted, or that nobody
        reads; a file of somebody else in a folder where only its owner may replace it.
    OSError : the path cannot be followed.
    """
    try:
        found = path.stat()
    except FileNotFoundError:
        return OutputPlace(Path(os.path.realpath(path)), None)
    except ValueError as error:  # a null character
        raise OSError(errno.EINVAL, str(error)) from error
    kind = next((words for test, words in _KINDS if test(found.st_mode)), None)
    own = _own_descriptor(path)
    if kind is None and own is None:
        real = Path(os.path.realpath(path))
        _check_replaceable(real, found)
        return OutputPlace(real, None)
    if not streams or kind in _NEVER:
        raise InputError(
            f"the output is {kind or 'a stream of this process'}",
            where=str(path),
            expected="the name of a file",
        )
    if own is not None:
        return OutputPlace(path, os.dup(own))
    try:
        stream = os.open(path, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        if error.errno != errno.ENXIO:
            raise
        raise InputError(
            "nobody reads the pipe", where=str(path), hint="start its reader first"
        ) from error
    os.set_blocking(stream, True)
    return OutputPlace(path, stream)


_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISBLK, "a disk"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISFIFO, "a pipe"),
)
_NEVER: Final = ("a folder", "a disk", "a socket")
_STREAMS: Final = re.compile(r"/(?:dev|proc/self)/fd/(\d+)")


def _own_descriptor(path: Path) -> int | None:
    """Return the descriptor of this process that a path is, such as /dev/stdout."""
    text = os.path.abspath(path)  # noqa: PTH100 - its links are what is asked for
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        text = f"/dev/fd/{number}" if text == f"/dev/{name}" else text
    found = _STREAMS.fullmatch(text)
    return None if found is None else int(found[1])


def _check_replaceable(path: Path, found: os.stat_result) -> None:
    """Refuse a file of another user in a sticky folder of another user: it cannot be replaced."""
    me = os.geteuid() if hasattr(os, "geteuid") else 0
    folder = path.parent.stat()
    if folder.st_mode & stat.S_ISVTX and me not in (0, folder.st_uid, found.st_uid):
        raise InputError(
            "the output is another user's, in a folder where only its owner may replace it",
            where=str(path),
            hint="another name, or another folder",
        )


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Give a path to write to; what is there replaces `path` when the block ends.

    A failure, or a crash, leaves the old file, or none. The path is in a folder of its own, beside
    what `path` stands for, in which nobody else can put a link; the folders of `path` are made.
    A device or a pipe stays what it is, and receives the content in the end.

    Raises
    ------
    InputError : what `path` stands for cannot be an output (`output_place`).
    OSError : it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    place, stream = output_place(path, streams=True)
    with ExitStack() as stack:
        if stream is not None:
            stack.callback(os.close, stream)
        folder = stack.enter_context(_own_folder(place.parent if stream is None else None))
        partial = folder / place.name
        yield partial
        if stream is None:
            partial.replace(place)
            return
        sys.stdout.flush()
        with partial.open("rb") as content, os.fdopen(os.dup(stream), "wb") as sink:
            shutil.copyfileobj(content, sink)


@contextmanager
def _own_folder(beside: Path | None) -> Iterator[Path]:
    """Make a folder that only this user can write to, in another one (None: that of the system)."""
    if beside is None:
        import tempfile  # noqa: PLC0415 - few outputs are streams

        beside = Path(tempfile.gettempdir())
    beside.mkdir(parents=True, exist_ok=True)  # that of what a link names
    folder = beside / f".{os.urandom(6).hex()}.partial"
    folder.mkdir(0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file at once; see `written_beside`."""
    with written_beside(path) as partial:
        partial.write_bytes(content)


def copy_whole(source: Path, path: Path) -> None:
    """Copy a file at once; see `written_beside`."""
    with written_beside(path) as partial:
        shutil.copyfile(source, partial)
