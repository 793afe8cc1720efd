"""Write files that are complete or absent."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

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


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; it replaces `path` when the block ends.

    A failure, or a crash, leaves the old file, or none.

    Raises
    ------
    OSError : it cannot be written.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file at once; see `written_beside`."""
    with written_beside(path) as partial:
        partial.write_bytes(content)


def copy_whole(source: Path, path: Path) -> None:
    """Copy a file at once; see `written_beside`."""
    with written_beside(path) as partial:
        shutil.copyfile(source, partial)
