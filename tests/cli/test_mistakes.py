"""The mistakes of new users, one by one: each is refused, names its place, and says what to do.

They are in `mistakes.toml`: what is written in place of what is right, or a command, and the words
behind "try:" that the message must have.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from cli.shell import Result, cosim

MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))
RIGHT: dict[str, str] = MISTAKES["right"]
FILES = {"scenario": "mine.toml", "system": "sys.toml", "study": "study.toml"}
CHECKED_BY = {
    "scenario": ("scenario", "check"),
    "system": ("analyse",),
    "study": ("study", "check"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of a user: right ones, and some of another kind, empty, or not text."""
    folder = tmp_path_factory.mktemp("mistakes")
    for kind, name in FILES.items():
        (folder / name).write_text(RIGHT[kind], "utf-8")
    others = {
        "bad.fmu": b"not a zip",
        "other.zip": b"PK",
        "list.json": b"[1, 2]",
        "gain.json": b"{}",
        "list.csv": b"a,b\n1,2\n",
        "file": b"x",
        "latin.toml": "title = 'Später'".encode("latin-1"),
        "t.mcap": b"text\n" * 9,
    }
    empty = ("empty.toml", "empty.json", "empty.mcap", "empty.fmu")
    for name, content in (others | dict.fromkeys(empty, b"")).items():
        (folder / name).write_bytes(content)
    for name in ("folder", "folder.fmu"):
        (folder / name).mkdir()
    return folder


def complaint(result: Result, place: str, words: str) -> str | None:
    """Return what a command prints; None where that names the place and says what to do."""
    text = result.out + result.err
    begin = "\n".join(text.splitlines()[:2])  # a check says first how many mistakes there are
    right = (
        result.code in (1, 2)
        and "Traceback" not in text
        and "unexpected" not in text
        and place in begin
        and any(line.strip().startswith("try:") and words in line for line in text.splitlines())
    )
    return None if right else text


@pytest.mark.parametrize("kind", FILES)
def test_a_mistake_in_a_file_says_what_to_do(kind: str, folder: Path, fmus: Path) -> None:
    """Each alone in a file that is right otherwise; the place is its line."""
    wrong = {}
    path, more = folder / FILES[kind], ("--fmus", str(fmus.parent)) if kind == "scenario" else ()
    for old, new, place, words in MISTAKES[kind]:
        assert old in RIGHT[kind]
        path.write_text(RIGHT[kind].replace(old, new, 1), "utf-8")
        text = complaint(cosim(*CHECKED_BY[kind], path.name, *more, cwd=folder), place, words)
        if text is not None:
            wrong[new] = (place, words, text)
    path.write_text(RIGHT[kind], "utf-8")
    assert not wrong


def test_a_mistake_in_a_command_says_what_to_do(folder: Path) -> None:
    """A file that is missing, empty, of another kind, a folder; an option that cannot be."""
    wrong = {}
    for line, words in MISTAKES["commands"]:
        text = complaint(cosim(*line.split(), cwd=folder), "", words)
        if text is not None:
            wrong[line] = (words, text)
    assert not wrong


def test_a_key_that_is_meant_is_one(folder: Path, fmus: Path) -> None:
    """What "did you mean" names in place of a key is a key of that table."""
    wrong = {}
    for old, new, _, words in MISTAKES["scenario"]:
        key, equals, value = new.partition(" = ")
        meant = re.fullmatch(r"did you mean (\w+)\?", words)
        renamed = equals and re.fullmatch(r"\w+", key) and key != old.partition(" = ")[0]
        if meant is None or not renamed or "\n" in new:
            continue
        text = RIGHT["scenario"].replace(old, f"{meant[1]} = {value}", 1)
        (folder / "meant.toml").write_text(text, "utf-8")
        check = ("scenario", "check", "meant.toml", "--fmus", str(fmus.parent))
        checked = cosim(*check, cwd=folder)
        if "there is no key" in checked.out + checked.err:
            wrong[new] = words
    assert not wrong


def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    """Without permission: how to allow it."""
    path = tmp_path / "secret.toml"
    path.write_text(RIGHT["scenario"], "utf-8")
    path.chmod(0)
    try:
        path.read_text("utf-8")
    except PermissionError:
        assert complaint(cosim("run", path, cwd=tmp_path), "secret.toml", "chmod u+r") is None
    else:
        pytest.skip("this user may read everything")
