"""What may stand where an output is to go, and what must have become of it."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

ANOTHER, THIRD = 12345, 12346
"""Users that nobody is."""
OLD = b"old"
NOTHING = "the pipe received nothing"
Becomes = Literal["written", "written into", "refused", "refused late"]
"""Of the output; written into: a device or a pipe, which a trace cannot be; refused late: by the
system, in the end."""


class NotHereError(Exception):
    """A place that this system does not have."""


@dataclass
class Place:
    """Where one output is to go.

    Attributes
    ----------
    path : as it is given to the command.
    becomes : what must become of the output.
    after : what is wrong afterwards, in words; empty: all is as it must be.
    user : who calls the command; None: the one who does all this.
    """

    path: Path
    becomes: Becomes
    after: Callable[[], str] = lambda: ""
    user: int | None = None


def new(home: Path, name: str) -> Iterator[Place]:
    """Nothing, in a folder that is not there either."""
    path = home / "made" / name
    yield Place(path, "written", lambda: _lacks(path))


def a_file(home: Path, name: str) -> Iterator[Place]:
    """An old file."""
    path = _old(home / name)
    yield Place(path, "written", lambda: _lacks(path))


def a_link(home: Path, name: str) -> Iterator[Place]:
    """A symlink to an old file, in another folder."""
    aim, link = _old(_folder(home / "elsewhere") / name), home / name
    link.symlink_to(aim)
    yield Place(link, "written", lambda: _lacks(aim) or _no_link(link))


def a_dangling_link(home: Path, name: str) -> Iterator[Place]:
    """A symlink to what is not there, in a folder that is not either."""
    aim, link = home / "elsewhere" / name, home / name
    link.symlink_to(aim)
    yield Place(link, "written", lambda: _lacks(aim) or _no_link(link))


def a_circle(home: Path, name: str) -> Iterator[Place]:
    """A symlink to itself."""
    link = home / name
    link.symlink_to(link)
    yield Place(link, "refused", lambda: _no_link(link))


def a_folder(home: Path, name: str) -> Iterator[Place]:
    """A folder."""
    path = _folder(home / name)
    yield Place(
        path, "refused", lambda: "" if path.is_dir() and not any(path.iterdir()) else "filled"
    )


def null(home: Path, name: str) -> Iterator[Place]:
    """A device that takes all."""
    path = _device(home / name, 3)
    yield Place(path, "written into", lambda: _no_device(path))


def a_link_to_a_device(home: Path, name: str) -> Iterator[Place]:
    """A symlink to a device."""
    device, link = _device(home / "device", 3), home / name
    link.symlink_to(device)
    yield Place(link, "written into", lambda: _no_device(device) or _no_link(link))


def full(home: Path, name: str) -> Iterator[Place]:
    """A device that has no room."""
    path = _device(home / name, 7)
    yield Place(path, "refused late", lambda: _no_device(path))


def a_pipe(home: Path, name: str) -> Iterator[Place]:
    """A pipe with a reader."""
    path = home / name
    os.mkfifo(path)
    received: list[bytes] = []
    waiting = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    keeper = os.open(path, os.O_WRONLY)  # the reader goes on reading until the command is over
    os.set_blocking(waiting, True)
    reader = threading.Thread(target=_read_all, args=(waiting, received))
    reader.start()

    def after() -> str:
        os.close(keeper)
        reader.join()
        if not stat.S_ISFIFO(path.lstat().st_mode):
            return "the pipe is gone"
        return "" if b"".join(received) else NOTHING

    yield Place(path, "written into", after)
    with suppress(OSError):
        os.close(keeper)


def a_pipe_alone(home: Path, name: str) -> Iterator[Place]:
    """A pipe that nobody reads."""
    path = home / name
    os.mkfifo(path)
    yield Place(
        path, "refused", lambda: "" if stat.S_ISFIFO(path.lstat().st_mode) else "the pipe is gone"
    )


def a_planted_link(home: Path, name: str) -> Iterator[Place]:
    """A link under the name that a trace has while it grows, to somebody's file."""
    victim, path = _old(home / "victim"), home / name
    (home / f"{name}.partial").symlink_to(victim)
    yield Place(path, "written", lambda: "" if victim.read_bytes() == OLD else "overwritten")


def a_full_disk(home: Path, name: str) -> Iterator[Place]:
    """A disk without room."""
    with _disk(home / "disk") as disk:
        path = _old(disk / name)
        with suppress(OSError), (disk / "all").open("wb", buffering=0) as rest:
            while True:
                rest.write(bytes(4096))
        yield Place(
            path, "refused late", lambda: "" if path.read_bytes() == OLD else "half written"
        )


def a_read_only_folder(home: Path, name: str) -> Iterator[Place]:
    """A folder of one's own that may not be written."""
    folder = _folder(home / "own")
    os.chown(folder, ANOTHER, ANOTHER)
    folder.chmod(0o555)
    yield Place(folder / name, "refused", lambda: _filled(folder), user=ANOTHER)


def anothers_folder(home: Path, name: str) -> Iterator[Place]:
    """A folder of another user."""
    folder = _folder(home / "theirs")
    os.chown(folder, THIRD, THIRD)
    folder.chmod(0o755)
    yield Place(folder / name, "refused", lambda: _filled(folder), user=ANOTHER)


def anothers_file(home: Path, name: str) -> Iterator[Place]:
    """A file of another user in a folder where everybody has files, and keeps them."""
    folder = _folder(home / "sticky")
    path = _old(folder / name)
    path.chmod(0o666)
    os.chown(path, THIRD, THIRD)
    folder.chmod(0o1777)

    def after() -> str:
        return "" if path.read_bytes() == OLD else "another's file was overwritten"

    yield Place(path, "refused", after, user=ANOTHER)


PLACES: Mapping[str, Callable[[Path, str], Iterator[Place]]] = MappingProxyType(
    {
        each.__name__.replace("_", " "): each
        for each in (
            *(new, a_file, a_link, a_dangling_link, a_circle, a_folder, null, a_link_to_a_device),
            *(full, a_pipe, a_pipe_alone, a_planted_link, a_full_disk, a_read_only_folder),
            *(anothers_folder, anothers_file),
        )
    }
)
OF_USERS = ("a read only folder", "anothers folder", "anothers file")
NEED_ROOT = (*OF_USERS, "null", "a link to a device", "full", "a full disk")


@contextmanager
def standing(name: str, home: Path, file: str) -> Iterator[Place]:
    """Make a place in a folder, for an output of this name; undo it in the end.

    Raises
    ------
    NotHereError : this system, or this user, cannot make one.
    """
    if name in NEED_ROOT and os.geteuid():
        raise NotHereError("only root makes devices, disks and files of others")
    yield from _of(PLACES[name](home, file))


def _of(made: Iterator[Place]) -> Iterator[Place]:
    try:
        yield next(made)
    finally:
        for _ in made:
            pass


def _old(path: Path) -> Path:
    path.write_bytes(OLD)
    return path


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


def _device(path: Path, minor: int) -> Path:
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, minor))
        with path.open("rb"):
            return path
    except OSError as error:
        raise NotHereError("no devices can be made here") from error


@contextmanager
def _disk(folder: Path) -> Iterator[Path]:
    folder.mkdir()
    mount = shutil.which("mount") or "mount"
    line = [mount, "-t", "tmpfs", "-o", "size=64k", "none", str(folder)]
    if subprocess.run(line, check=False, capture_output=True).returncode:  # noqa: S603 - ours
        raise NotHereError("no disk can be mounted here")
    try:
        yield folder
    finally:
        line = [shutil.which("umount") or "umount", "-l", str(folder)]
        subprocess.run(line, check=True)  # noqa: S603


def _read_all(descriptor: int, received: list[bytes]) -> None:
    with os.fdopen(descriptor, "rb", buffering=0) as pipe:
        while data := pipe.read(65536):
            received.append(data)


def _lacks(path: Path) -> str:
    whole = path.is_file() and path.read_bytes() not in (b"", OLD)
    return "" if whole else "the output is not there"


def _no_link(path: Path) -> str:
    return "" if path.is_symlink() else "the link is gone"


def _no_device(path: Path) -> str:
    return "" if stat.S_ISCHR(path.lstat().st_mode) else "the device is gone"


def _filled(folder: Path) -> str:
    return f"left: {[each.name for each in folder.iterdir()]}" if any(folder.iterdir()) else ""
