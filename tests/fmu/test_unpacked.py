"""FMUs unpacked once per process, and gone with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from foreign.c_fmu import c_fmu, talker
from packed import files_of, pack

from cosim.core import InputError
from cosim.fmu import FmuDescription, FmuSlave, describe_fmu, own_folder, unpack_fmu
from cosim.fmu.inspect import CheckedArchive


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """An FMU."""
    return describe_fmu(c_fmu("talker_fmi2.c", talker(), tmp_path_factory.mktemp("talker")))


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place of its own for what processes unpack."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def removed_from(scratch: Path) -> bool:
    """Whether nothing is left of what this process has unpacked, when its place is another one."""
    other = scratch.with_name("other")
    other.mkdir(exist_ok=True)
    tempfile.tempdir = str(other)
    own_folder()
    tempfile.tempdir = str(scratch)
    return list(scratch.iterdir()) == []


def process_of(room: Path) -> int:
    """The process that a folder of unpacked FMUs is of."""
    return int(room.name.split("-")[2])


def silent(_level: str, _message: str, _category: str) -> None:
    """Ignore messages."""


def test_instances_share_unpacked_files(described: FmuDescription, scratch: Path) -> None:
    """One folder per FMU while the process lives; unpacked again if it is removed."""
    with FmuSlave(described, "one", silent), FmuSlave(described, "two", silent):
        (room,) = scratch.iterdir()
        assert room == own_folder()
        assert process_of(room) == os.getpid()
        assert [p.name for p in room.iterdir() if p.is_dir()] == [described.sha256]
    folder = unpack_fmu(described)
    assert (folder / "resources").is_dir()
    assert removed_from(scratch)
    assert unpack_fmu(described).parent != folder.parent
    assert (folder.parent / described.sha256).is_dir() is False
    assert removed_from(scratch)


def test_what_is_unpacked_is_what_was_checked(
    described: FmuDescription, scratch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is exchanged between the check and the unpacking is not read again."""
    files, path = files_of(described.path), tmp_path / "x.fmu"
    sound = describe_fmu(pack({**files, "resources/one": b"1"}, path))
    check = CheckedArchive.require_sound

    def exchange(archive: CheckedArchive) -> None:
        check(archive)
        pack({**files, "resources/two": b"2"}, path)

    monkeypatch.setattr(CheckedArchive, "require_sound", exchange)
    resources = unpack_fmu(sound) / "resources"
    assert [p.name for p in resources.iterdir()] == ["one"]
    assert removed_from(scratch)
    with pytest.raises(InputError, match="the FMU has changed since it was read"):
        unpack_fmu(sound)


_CODE = """
import signal, sys, time
from pathlib import Path
from cosim.fmu import FmuSlave, describe_fmu
def stop(number, frame):
    raise SystemExit(1)
signal.signal(signal.SIGTERM, stop)
slave = FmuSlave(describe_fmu(Path(sys.argv[1])), "it", lambda *line: None)
slave.initialise({}, 0.0, 1.0)
print("ready", flush=True)
sys.stdin.read() if sys.argv[2] == "ends" else time.sleep(600)
"""


def other_process(
    described: FmuDescription, scratch: Path, what: str, before: str = ""
) -> subprocess.Popen[bytes]:
    """A process that has instantiated the FMU, and ends or waits."""
    process = subprocess.Popen(  # noqa: S603 - ourselves
        [sys.executable, "-c", before + _CODE, str(described.path), what],
        env={**os.environ, "TMPDIR": str(scratch)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == b"ready"
    return process


def test_unpacked_files_are_removed_with_their_process(
    described: FmuDescription, scratch: Path
) -> None:
    """At its end or a handled signal; after it was killed, at the start of the next process."""
    ended = other_process(described, scratch, "ends")
    handling = other_process(described, scratch, "waits")
    killed = other_process(described, scratch, "waits")
    assert len(list(scratch.iterdir())) == 3
    ended.communicate(b"")
    handling.send_signal(signal.SIGTERM)
    handling.communicate()
    killed.kill()
    killed.communicate()
    (left,) = scratch.iterdir()
    assert process_of(left) == killed.pid
    living = other_process(described, scratch, "ends")
    (room,) = scratch.iterdir()
    assert process_of(room) == living.pid
    unpack_fmu(described)  # sweeps, and leaves alone what is in use
    assert {process_of(p) for p in scratch.iterdir()} == {living.pid, os.getpid()}
    living.communicate(b"")
    assert removed_from(scratch)


_SIGNALLED = """
import os, signal, sys
from pathlib import Path
from cosim.fmu import describe_fmu, unpack_fmu
def stop(number, frame):
    raise SystemExit(1)
signal.signal(signal.SIGTERM, stop)
rename = Path.rename
def renamed(draft, target):  # where the folder has no name of its own yet
    os.kill(os.getpid(), signal.SIGNAL)
    return rename(draft, target)
Path.rename = renamed
unpack_fmu(describe_fmu(Path(sys.argv[1])))
"""


def signalled(code: str, described: FmuDescription, scratch: Path, *more: str) -> tuple[int, str]:
    """Exit code and errors of a process that unpacks an FMU."""
    done = subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-c", code, str(described.path), *more],
        env={**os.environ, "TMPDIR": str(scratch)},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    return done.returncode, done.stderr


def test_a_folder_that_is_being_made_is_left_by_no_signal(
    described: FmuDescription, scratch: Path
) -> None:
    """Nor by the next process where one was killed at this moment."""
    for name in ("SIGTERM", "SIGKILL"):
        code, _ = signalled(_SIGNALLED.replace("SIGNAL)", f"{name})"), described, scratch)
        assert code == (1 if name == "SIGTERM" else -signal.SIGKILL)
        assert len(list(scratch.iterdir())) == (name == "SIGKILL")
    (left,) = scratch.iterdir()
    bare = scratch / left.name.replace(".0.", ".1.")
    bare.mkdir()  # before it got its lock
    unpack_fmu(described)
    assert not left.exists()
    assert not bare.exists()
    assert removed_from(scratch)


def test_a_draft_that_another_process_removes_is_made_again(
    described: FmuDescription, scratch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before it has its lock a draft of a living process looks like one that was left."""
    make, made = Path.mkdir, []

    def removed_at_first(folder: Path, *given: Any, **named: Any) -> None:
        make(folder, *given, **named)
        if folder.parent == scratch:
            made.append(folder)
            if len(made) == 1:
                folder.rmdir()

    monkeypatch.setattr(Path, "mkdir", removed_at_first)
    assert unpack_fmu(described).is_dir()
    assert len(made) == 2
    assert removed_from(scratch)


def test_a_file_system_without_locks_is_none_to_wait_for(
    described: FmuDescription, scratch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder goes without, and is removed as usual."""
    monkeypatch.setattr("cosim.core.locks.lock_file", lambda _file: False)
    assert unpack_fmu(described).is_dir()
    (room,) = scratch.iterdir()
    assert process_of(room) == os.getpid()
    assert removed_from(scratch)


_HALFWAY = """
import signal, sys
from pathlib import Path
from cosim.fmu import describe_fmu, unpack_fmu
import shutil
usual = MODULE.FUNCTION
def interrupted(*given, **named):
    found = usual(*given, **named)
    signal.raise_signal(signal.SIGINT)
    return found
described = describe_fmu(Path(sys.argv[1]))
if "FUNCTION" == "rmtree":
    unpack_fmu(described)
MODULE.FUNCTION = interrupted
unpack_fmu(described)
"""


def test_ctrl_c_stops_no_folder_halfway(described: FmuDescription, scratch: Path) -> None:
    """It waits until the folder is there, or is gone; at the end of Python it is not dropped."""
    made = _HALFWAY.replace("MODULE", "Path").replace("FUNCTION", "mkdir")
    code, errors = signalled(made, described, scratch)
    assert code == -signal.SIGINT
    assert errors.endswith("KeyboardInterrupt\n")
    assert list(scratch.iterdir()) == []
    gone = _HALFWAY.replace("MODULE", "shutil").replace("FUNCTION", "rmtree")
    assert signalled(gone, described, scratch) == (-signal.SIGINT, "")
    assert list(scratch.iterdir()) == []


_ADOPTING = """
import sys
from pathlib import Path
from cosim.core import InputError
from cosim.fmu import adopt_folder, describe_fmu, unpack_fmu
adopt_folder(Path(sys.argv[2]))
try:
    unpack_fmu(describe_fmu(Path(sys.argv[1])))
except InputError as error:
    sys.exit(error.text())
"""


def test_nobody_remakes_the_folder_of_a_process_that_is_gone(
    described: FmuDescription, scratch: Path
) -> None:
    """Nobody would remove it; one that was removed by halves is removed by the next."""
    kind, _, _ = own_folder().name.rsplit("-", 2)
    assert removed_from(scratch)
    half = scratch / f"{kind}-1-1"
    (half / "abc").mkdir(parents=True)
    unpack_fmu(described)
    assert not half.exists()
    code, errors = signalled(_ADOPTING, described, scratch, str(half))
    assert code == 1
    assert "the FMU cannot be unpacked" in errors
    assert not half.exists()
    assert removed_from(scratch)


def test_who_has_no_locks_keeps_his_files(described: FmuDescription, scratch: Path) -> None:
    """Nobody can tell whether such a process lives: the next one leaves its folder alone."""
    living = other_process(described, scratch, "ends", 'import sys; sys.modules["fcntl"] = None\n')
    (folder,) = scratch.iterdir()
    unpack_fmu(described)  # sweeps
    assert (folder / described.sha256 / "modelDescription.xml").is_file()
    living.communicate(b"")
    assert removed_from(scratch)


_FORK = """
import os, sys
from pathlib import Path
from cosim.fmu import describe_fmu, unpack_fmu
described = describe_fmu(Path(sys.argv[1]))
folder = unpack_fmu(described)
note = folder.parent / "note"
child = os.fork()
if child == 0:
    own = unpack_fmu(described)
    note.write_text(str(own))
    sys.exit(0 if own != folder and folder.exists() else 1)  # and removes what is its own
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
sys.exit(code if folder.exists() and not Path(note.read_text()).exists() else 2)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_fork_leaves_the_files_of_its_parent(described: FmuDescription, scratch: Path) -> None:
    """A forked process unpacks for itself and removes only its own folder."""
    line = [sys.executable, "-c", _FORK, str(described.path)]
    environment = {**os.environ, "TMPDIR": str(scratch)}
    done = subprocess.run(line, env=environment, check=False)  # noqa: S603 - ourselves
    assert done.returncode == 0
    assert list(scratch.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_fork_uses_the_folder_of_its_parent_without_a_word() -> None:
    """It closes the file that the parent has locked, which stays locked; nothing is removed."""
    script = """
import gc, os
from cosim.fmu import adopt_folder, own_folder
folder = own_folder()
if os.fork() == 0:
    adopt_folder(folder)
    gc.collect()
    assert own_folder() == folder
    os._exit(0)
assert os.wait()[1] == 0
assert own_folder() == folder and folder.is_dir()
"""
    line = [sys.executable, "-W", "error", "-c", script]
    done = subprocess.run(line, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    assert (done.returncode, done.stderr) == (0, "")
