"""Where outputs go: what stands there is judged before any work is done for them."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from cosim.core.errors import InputError


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
    if streams and (stream := _opened.pop(_key(path), None)) is not None:
        return OutputPlace(path, stream)
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
            hint=f"a file in it: {path / 'NAME'}" if kind == "a folder" else "another place",
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
    text = _key(path)
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


def check_output(path: Path, *, streams: bool = False) -> None:
    """Check that a file can be written, before anything takes time; creates nothing.

    streams : a device or a pipe will do as well. It is opened now, and kept for `output_place`: a
        pipe's reader would take a second opening for the end.

    Raises
    ------
    InputError : its folder, or the nearest existing one, cannot be written; or what stands there
        cannot be an output (`output_place`).
    """
    with _named("the output cannot be written", path):
        place = output_place(path, streams=streams)
        if place.stream is None:
            _check_folder(place.path.parent, path)
        else:
            _opened[_key(path)] = place.stream


def check_output_folder(path: Path) -> None:
    """Check that files can be written into a folder, there or to be made; as `check_output`.

    Raises
    ------
    InputError : it, or the nearest existing one, cannot be written, or is none.
    """
    with _named("the folder of the output cannot be made", path):
        _check_folder(Path(os.path.realpath(path)), path)


@contextmanager
def _named(what: str, path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        hint = "another place, in a folder that is there and can be written"
        raise InputError(what, where=str(path), got=reason, hint=hint) from error


def _check_folder(folder: Path, path: Path) -> None:
    nearest = next(each for each in (folder, *folder.parents) if os.path.lexists(each))
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            "the folder of the output cannot be written",
            where=str(path),
            expected=f"{nearest} to be a folder that can be written",
            hint="another place",
        )


_opened: dict[str, int] = {}
"""Devices and pipes that are opened and not yet written, by path."""


def _key(path: Path) -> str:
    return os.path.abspath(path)  # noqa: PTH100 - its links are what is asked for
