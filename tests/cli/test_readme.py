"""Every command, file and program that the README shows does what it says."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cli.shell import COMMAND, cosim, trace_of
from shared import copied, fmu_store

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text("utf-8")
MASTER = (ROOT / "docs" / "explanation" / "master.md").read_text("utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
LINES = [
    line.split(" #")[0].strip()
    for language, block in BLOCKS
    if language in ("", "sh", "bash", "console")
    for line in block.splitlines()
    if line.strip()
]
COMMANDS = [line for line in LINES if not line.startswith("make ")]


def files() -> dict[str, str]:
    """The TOML blocks by their first line, which names them; each is used by a command."""
    blocks = [block for language, block in BLOCKS if language == "toml"]
    result = {re.match(r"# (\S+\.toml)\n", block)[1]: block for block in blocks}  # type: ignore[index]
    typed = " ".join(COMMANDS)
    written = {f"{name}.toml" for name in re.findall(r"cosim scenario new (\S+)", typed)}
    written |= set(re.findall(r"cosim ssp import \S+ -o (\S+)", typed))
    assert set(result) | written == {word for word in typed.split() if word.endswith(".toml")}
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a reader types: what is flown before is there, and the files that are shown."""
    folder = tmp_path_factory.mktemp("reader")
    copied(fmu_store("python", "native", "native-fmi3"), folder / "fmus")
    ran = trace_of("auv-acoustic")
    copied(ran.parent, folder / ran.parent.name)
    for name, text in files().items():
        (folder / name).write_text(text, "utf-8")
    shutil.copy(ROOT / "build_fmu.py", folder)
    return folder


def run(words: list[str | Path], folder: Path) -> None:
    done = subprocess.run(  # noqa: S603 - what the README tells people to type
        words, cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("line", [line for line in LINES if line.startswith("make ")])
def test_target_exists(line: str) -> None:
    """What is said to `make` is a target of the Makefile."""
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for target in line.split()[1:]:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_commands_and_programs_work(folder: Path) -> None:
    """Typed in the order of the README, each command and each Python block ends with success.

    One test, since what a line writes, a later one reads.
    """
    failed = {}
    programs = [block for language, block in BLOCKS if language == "python"]
    programs += re.findall(r"^```python\n(.*?)^```$", MASTER, re.MULTILINE | re.DOTALL)
    for text, attempt in [(line, typed) for line in COMMANDS] + [(b, program) for b in programs]:
        try:
            attempt(text, folder)
        except AssertionError as error:
            failed[text] = str(error)
    assert not failed


def typed(line: str, folder: Path) -> None:
    """What a reader types."""
    name, *arguments = shlex.split(line)
    if name == "cosim":
        result = cosim(*arguments, cwd=folder)
        assert result.code == 0, result.err
        if "--json" in arguments:
            assert result.json
    elif name == "python":
        run([sys.executable, *arguments], folder)
    else:
        run([COMMAND.with_name(name), *arguments], folder)


def program(block: str, folder: Path) -> None:
    """What a reader runs."""
    run([sys.executable, "-c", block], folder)


def test_every_block_is_known() -> None:
    """No fenced block escapes these tests."""
    assert {language for language, _ in BLOCKS} <= {"", "sh", "bash", "console", "toml", "python"}
    assert COMMANDS


def test_every_link_and_picture_exists() -> None:
    """What the README points to in the repository is there."""
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if "://" not in target:
            assert (ROOT / target).exists(), target


def test_verbs_of_the_readme_are_in_the_help(tmp_path: Path) -> None:
    """Every command line of the README names a verb that the help lists."""
    out = cosim("--help", cwd=tmp_path).out + cosim("trace", "--help", cwd=tmp_path).out
    verbs = {line.split()[1] for line in COMMANDS if line.startswith("cosim ")}
    assert all(re.search(rf"\b{verb}\b", out) for verb in verbs)
