"""The one writer of files: what it replaces, what it writes into, and what it refuses."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from cosim.core import InputError, write_whole, written_beside

ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root acts as another user")
ANOTHER, THIRD = 12345, 12346


def names(folder: Path) -> set[str]:
    return {x.name for x in folder.iterdir()}


def as_user(number: int, do: Callable[[], None]) -> str:
    """What an `InputError` says that another user gets; empty: it was done."""
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        code = 1
        with suppress(BaseException):
            os.setuid(number)
            try:
                do()
            except InputError as error:
                os.write(writes, error.text().encode())
            code = 0
        os._exit(code)
    os.close(writes)
    with os.fdopen(reads) as output:
        text = output.read()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    return text


def test_a_file_is_whole_or_the_old_one(tmp_path: Path) -> None:
    """Nothing is left beside it, also after a failure; folders are made."""
    path = tmp_path / "new" / ("n" * 250)
    write_whole(path, b"one")

    def fails_halfway() -> None:
        with written_beside(path) as partial:
            partial.write_bytes(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails_halfway()
    assert path.read_bytes() == b"one"
    assert names(path.parent) == {path.name}
    assert stat.S_IMODE(path.stat().st_mode) & 0o444 == 0o444 & ~current_umask()


def current_umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_a_symlink_stays_and_what_it_names_is_replaced(tmp_path: Path) -> None:
    """Also where that is not there yet, in a folder that is not; a circle is an error."""
    aim, link = tmp_path / "elsewhere" / "aim", tmp_path / "link"
    link.symlink_to(aim)
    for content in (b"one", b"two"):
        write_whole(link, content)
        assert link.is_symlink()
        assert aim.read_bytes() == content
    (tmp_path / "a").symlink_to(tmp_path / "a")
    with pytest.raises(OSError, match="symbolic links"):
        write_whole(tmp_path / "a", b"")
    assert (tmp_path / "a").is_symlink()


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the output is a folder"):
        write_whole(tmp_path, b"")


def test_a_pipe_gets_the_content(tmp_path: Path) -> None:
    """It stays a pipe; one that nobody reads is refused at once, not waited for."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="nobody reads the pipe"):
        write_whole(pipe, b"")
    found: list[bytes] = []
    reader = threading.Thread(target=lambda: found.append(pipe.read_bytes()))
    reader.start()
    content = bytes(range(256)) * 1000
    while True:
        try:
            write_whole(pipe, content)
            break
        except InputError:  # the reader has not come yet
            pass
    reader.join()
    assert found == [content]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert names(tmp_path) == {"pipe"}


@ROOT
def test_a_device_stays_one(tmp_path: Path) -> None:
    null = tmp_path / "null"
    try:
        os.mknod(null, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
        null.write_bytes(b"")
    except OSError:
        pytest.skip("no devices can be made here")
    write_whole(null, b"content")
    assert stat.S_ISCHR(null.stat().st_mode)
    assert names(tmp_path) == {"null"}


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_is_written_into(tmp_path: Path, name: str) -> None:
    """Where the shell sends it: after what was printed before, into a file or a pipe."""
    if not Path(name).exists():
        pytest.skip("not on this system")
    script = (
        "import sys; from pathlib import Path; from cosim.core import write_whole\n"
        "print('before'); write_whole(Path(sys.argv[1]), b'content\\n'); print('after')"
    )
    command = [sys.executable, "-c", script, name]
    with (tmp_path / "out").open("wb") as out:
        subprocess.run(command, check=True, stdout=out)  # noqa: S603 - our own script
    piped = subprocess.run(command, check=True, capture_output=True)  # noqa: S603
    assert (tmp_path / "out").read_bytes() == piped.stdout == b"before\ncontent\nafter\n"


@ROOT
def test_a_file_that_cannot_be_replaced_is_refused_before_the_work(tmp_path: Path) -> None:
    """That of another user, in a sticky folder of another user; one's own there is replaced."""
    folder = tmp_path / "sticky"
    folder.mkdir()
    folder.chmod(0o1777)
    for parent in (tmp_path, *tmp_path.parents[:3]):
        parent.chmod(parent.stat().st_mode | 0o111)
    theirs, own = folder / "theirs", folder / "own"
    for path, owner in ((theirs, THIRD), (own, ANOTHER)):
        path.write_bytes(b"old")
        os.chown(path, owner, owner)
    worked: list[bool] = []

    def work() -> None:
        with written_beside(theirs) as partial:
            worked.append(True)
            partial.write_bytes(b"new")

    assert "another user's" in as_user(ANOTHER, work)
    assert not worked
    assert as_user(ANOTHER, lambda: write_whole(own, b"new")) == ""
    assert (theirs.read_bytes(), own.read_bytes()) == (b"old", b"new")
    assert names(folder) == {"theirs", "own"}


_KILLED = """
import os, signal, sys
from pathlib import Path
from cosim.core import written_beside
with written_beside(Path(sys.argv[1])) as partial:
    partial.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name != "posix", reason="folders have no locks there")
def test_what_a_killed_one_left_is_removed_by_the_next(tmp_path: Path) -> None:
    """And nothing of one that is still writing, nor what only has such a name."""
    path = tmp_path / "out"
    subprocess.run([sys.executable, "-c", _KILLED, str(path)], check=False)  # noqa: S603 - ours
    (left,) = names(tmp_path)
    (tmp_path / ".0123456789ab.partial").write_bytes(b"a file")
    (tmp_path / f"{left}.0.new").mkdir()  # of one that was killed before it had its name
    with written_beside(path) as partial:
        partial.write_bytes(b"one")
        write_whole(tmp_path / "other", b"two")
    assert left not in names(tmp_path)
    assert names(tmp_path) == {"out", "other", ".0123456789ab.partial"}
    assert path.read_bytes() == b"one"
