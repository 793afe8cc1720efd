"""What tests share is made once, whole before anyone sees it, and whoever writes is found."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import shared

ASKS = """
import os, sys, time
from pathlib import Path
import shared
shared.share_below(Path(sys.argv[1]))
def make(folder):
    (folder / "first").write_text("1")
    with open(sys.argv[2], "a") as log:
        log.write("made\\n")
    while Path(sys.argv[2]).with_name("go").exists() is False:
        time.sleep(0.01)
    (folder / "last").write_text("2")
print("ready", flush=True)
print(sorted(p.name for p in shared.made_once("it", make).iterdir()))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A session of its own."""
    monkeypatch.setattr(shared, "_session", [tmp_path / "shared"])
    return tmp_path / "shared"


def make(folder: Path) -> None:
    (folder / "deep").mkdir()
    (folder / "deep" / "a.txt").write_text("a")


def test_processes_that_ask_at_once_get_one_whole_folder(tmp_path: Path) -> None:
    """One makes it, slowly; the others wait for its end."""
    line = [sys.executable, "-c", ASKS, str(tmp_path / "shared"), str(tmp_path / "log")]
    environment = {**os.environ, "PYTHONPATH": str(Path(shared.__file__).parent)}
    asking = [
        subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=environment)  # noqa: S603 - our own script
        for _ in range(3)
    ]
    for process in asking:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    (tmp_path / "go").touch()
    assert [process.communicate()[0] for process in asking] == ["['first', 'last']\n"] * 3
    assert (tmp_path / "log").read_text() == "made\n"


def test_what_is_shared_is_read_only(folder: Path) -> None:
    """For all but root, who is found afterwards."""
    made = shared.made_once("it", make)
    assert made == folder / "it"
    assert {p.stat().st_mode & 0o222 for p in (made, *made.rglob("*"))} == {0}


@pytest.mark.parametrize("change", ["over", "beside", "away"])
def test_a_writer_is_found(folder: Path, change: str) -> None:
    """A file changed, added or removed is named; nothing else is."""
    made = shared.made_once("group/it", make)
    shared.made_once("other", make)
    assert shared.what_was_written() == []
    for path in (made, made / "deep", made / "deep" / "a.txt"):
        path.chmod(0o700)
    if change == "over":
        (made / "deep" / "a.txt").write_text("b")
    elif change == "beside":
        (made / "b.txt").write_text("b")
    else:
        (made / "deep" / "a.txt").unlink()
    name = "b.txt" if change == "beside" else "deep/a.txt"
    assert shared.what_was_written() == [f"group/it/{name}"]
    assert folder in made.parents


def test_what_could_not_be_made_is_made_again(folder: Path) -> None:
    """Nothing half made is ever given away."""

    def fails(here: Path) -> None:
        make(here)
        raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        shared.made_once("it", fails)
    assert shared.what_was_written() == []
    assert (shared.made_once("it", make) / "deep" / "a.txt").read_text() == "a"
    assert folder.is_dir()


def test_a_copy_may_be_written_to(folder: Path, tmp_path: Path) -> None:
    """Of a folder and of a file."""
    made = shared.made_once("it", make)
    shared.copied(made, tmp_path / "mine")
    (tmp_path / "mine" / "deep" / "a.txt").write_text("b")
    (shared.copied(made / "deep" / "a.txt", tmp_path / "one.txt")).write_text("c")
    assert shared.what_was_written() == []
    assert folder.is_dir()
