"""Every block of every page, and of the README, does what it says, in the order of the page."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from docs.page_blocks import (
    LANGUAGES,
    NOT_RUN,
    ROOT,
    SLOW,
    Block,
    Reader,
    blocks_of,
    indented_commands,
    pages,
)
from shared import copied, fmu_store, share_of

FLAVOURS = ("native", "python")


def _parameters() -> list[Any]:
    """Return every page with blocks; of the slow ones a third, with a SHARE.

    The README is followed literally, from the wheel, by every gate.
    """
    found = []
    kept, slow = share_of(range(3)), 0
    for page in pages():
        if not any(b.is_run for b in blocks_of(page)):
            continue
        if page == ROOT / "README.md":
            found.append(pytest.param(page, id=page.name, marks=pytest.mark.slow))
            continue
        is_slow = SLOW in page.read_text("utf-8")
        slow += is_slow
        if not is_slow or slow % 3 in kept:
            marks = [pytest.mark.slow] if is_slow else []
            found.append(pytest.param(page, id=str(page.relative_to(ROOT)), marks=marks))
    return found


def _not_in_a_clone(folder: str, names: list[str]) -> set[str]:
    """Return what git does not have, and what takes long to copy and no command needs."""
    made = {name for name in names if name.startswith((".", "__pycache__"))}
    if Path(folder) == ROOT:
        made |= {"fmus", "traces", "studies", "site", "dist", "build", "tests"} & set(names)
    return made


@pytest.mark.parametrize("page", _parameters())
def test_blocks_do_what_the_page_says(page: Path, tmp_path: Path) -> None:
    """From the first to the last, in an empty folder: what a block uses, one before it made.

    FMUs of the catalogue are there, which the commands would build; and what a clone has.
    """
    if page == ROOT / "README.md":
        shutil.copytree(ROOT, tmp_path, ignore=_not_in_a_clone, dirs_exist_ok=True)
    elif "build_fmu.py" in page.read_text("utf-8"):
        shutil.copy(ROOT / "build_fmu.py", tmp_path)
    copied(fmu_store(*FLAVOURS), tmp_path / "fmus")
    reader = Reader(tmp_path)
    for block in blocks_of(page):
        try:
            reader.do(block)
        except Exception as error:
            error.add_note(f"{page.relative_to(ROOT)}:{block.line}")
            raise


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_no_block_escapes(page: Path) -> None:
    """Each is of a language that is run, or says why it is not; none is indented."""
    for block in blocks_of(page):
        assert block.language in LANGUAGES or not block.is_run, (page.name, block.line)
        assert block.is_run or len(block.note) > len(NOT_RUN) + 5, (page.name, block.line)
    assert indented_commands(page) == []


def test_a_wrong_block_is_seen(tmp_path: Path) -> None:
    """The reader itself: a command that fails, output that differs, a file without a name."""
    reader = Reader(tmp_path)
    for language, text, note in (
        ("sh", "cosim run no-such-scenario\n", ""),
        ("sh", "make no-such-target\n", ""),
        ("sh", "pip install 'auv-cosim[no_such_extra]'\n", ""),
        ("python", "assert 1 == 2\n", ""),
        ("toml", "[run]\nend = 1\n", ""),
        ("toml", "[run]\nno_such_key = 1\n", "part of a scenario"),
    ):
        with pytest.raises((AssertionError, ValueError)):
            reader.do(Block(1, language, text, note))
    reader.do(Block(1, "python", "print('gamma  2.5 certified')\n", ""))
    reader.do(Block(1, "text", "gamma ... certified\n", ""))
    with pytest.raises(AssertionError, match="not in the output"):
        reader.do(Block(1, "text", "gamma 2.6\n", ""))


def test_links_and_pictures_of_the_readme_exist() -> None:
    """What the README points to in the repository is there; `mkdocs build` looks at the rest."""
    text = (ROOT / "README.md").read_text("utf-8")
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", text)
    assert len(targets) > 10
    for target in targets:
        assert "://" in target or (ROOT / target).exists(), target


def test_pages_point_to_nothing_outside() -> None:
    """No page loads anything from another host."""
    for page in pages():
        for target in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text("utf-8")):
            assert "://" not in target
            assert (page.parent / target).exists(), (page, target)
