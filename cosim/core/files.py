"""The one writer of files: they are complete or absent, and nothing else is replaced by them."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import Final

from cosim.core.errors import CosimError, InputError, did_you_mean, nearest
from cosim.core.locks import locked_folder, remove_left
from cosim.core.output_places import output_place

_MOST_FILES = 10_000


AnyPath = str | PathLike[str]
"""A path: a text, or a path object."""


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
    usual = more.pop("hint", None) or _what_to_do(error)
    hint = (similar_files(path) if missing else None) or usual
    return InputError(what, where=str(path), got=reason, hint=hint, **more)


def _what_to_do(error: OSError | ValueError) -> str:
    """Return what to do about a file that cannot be read, by the reason alone."""
    match error:
        case IsADirectoryError():
            return "this is a folder: name the file in it"
        case PermissionError():
            return "allow reading it: chmod u+r FILE"
        case UnicodeError():
            return "save it as UTF-8 text"
        case OSError():
            return "look at its path: it starts from the folder in which the command runs"
    return "another file"


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
    """Make a folder that only this user can write to, in another one (None: that of the system).

    Those that a process has left which was killed are removed: nobody holds their lock any more.
    """
    if beside is None:
        import tempfile  # noqa: PLC0415 - few outputs are streams

        beside = Path(tempfile.gettempdir())
    beside.mkdir(parents=True, exist_ok=True)  # that of what a link names
    remove_left(beside, _LEFT)
    folder = beside / f".{os.urandom(6).hex()}.partial"
    with ExitStack() as stack:
        lock = locked_folder(folder)
        if lock is not None:
            stack.callback(os.close, lock)
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        yield folder


_LEFT: Final = re.compile(r"\.[0-9a-f]{12}\.partial")


@contextmanager
def not_written(
    what: str,
    path: Path,
    error: type[CosimError] = InputError,
    *,
    faults: tuple[type[Exception], ...] = (OSError,),
    **more: str,
) -> Iterator[None]:
    """Say which output cannot be written, where the block raises a fault.

    Parameters
    ----------
    what : it cannot be written, "the report".
    error : what is raised.
    more : its `expected` and `hint`.
    """
    try:
        yield
    except faults as cause:
        if isinstance(cause, CosimError):  # an InputError is a ValueError, and says more
            raise
        got = str(cause)[:300]
        raise error(f"{what} cannot be written", where=str(path), got=got, **more) from cause


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file at once; see `written_beside`."""
    with written_beside(path) as partial:
        partial.write_bytes(content)


def copy_whole(source: Path, path: Path) -> None:
    """Copy a file at once; see `written_beside`."""
    with written_beside(path) as partial:
        shutil.copyfile(source, partial)
