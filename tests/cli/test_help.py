"""The help of every command: it wraps, and its examples can be typed as they stand."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest
from cli.commands import leaf_of, listed_commands
from cli.shell import cosim
from shared import copied, fmu_store, share_of

from docs_site import first_lines
from docs_site.help_examples import followed, in_order, other_code

EXAMPLE = re.compile(r"^  (cosim .*)$", re.MULTILINE)
BEFORE = tuple(
    f"cosim {verb}"
    for verb in (
        *("run auv-acoustic", "demo", "scenario", "design", "fmu build", "fmu controller", "ssp"),
        *("study run", "trace rerun", "vehicle new", "link record"),
    )
)
"""What writes the files that others read."""
EVERY = [(), *(found.path for found in listed_commands())]
"""The words of every command and group that is listed, `cosim` itself first."""


def words_of(line: str) -> list[str]:
    """Return the words after `cosim`, without a redirection."""
    return shlex.split(re.sub(r" > \S+$", "", line))[1:]


def examples(path: tuple[str, ...], folder: Path) -> list[str]:
    """Return the examples of a command, those that are broken joined again."""
    text = cosim(*path, "--help", cwd=folder, columns=60).out
    return EXAMPLE.findall(re.sub(r" \\\n +", " ", text))


@pytest.mark.parametrize("width", [60, 80, 120])
def test_every_help_wraps(width: int, tmp_path: Path) -> None:
    """No line beyond the terminal, no word cut off, and full lines where there is more text."""
    for path in EVERY:
        out = cosim(*path, "--help", cwd=tmp_path, columns=width).out
        assert out.startswith("Usage: cosim")
        lines = out.splitlines()
        assert max(map(len, lines)) <= width, (path, max(lines, key=len))
        assert "…" not in out
        assert "\b" not in out
        body = re.split(r"\n\n\w.*:\n", out.partition("\n\n")[2])[0]
        for line, after in pairwise(body.splitlines()):
            if line.strip() and after.strip():
                assert len(line) + 1 + len(after.split()[0]) > width - 3, (path, line, after)


def test_every_command_has_examples_that_parse(tmp_path: Path) -> None:
    """Each names its own command; options, arguments and choices exist."""
    for path in EVERY:
        if hasattr(leaf_of(list(path))[0], "commands"):
            continue
        found = examples(path, tmp_path)
        assert found, path
        assert any(line.startswith(f"cosim {' '.join(path)}") for line in found)
        for line in found:
            words = words_of(line)
            leaf, context, rest = leaf_of(words)
            leaf.make_context(leaf.name, rest, parent=context)


def test_cosim_alone_shows_a_first_hour(tmp_path: Path) -> None:
    """Commands that exist, in lines that fit a narrow terminal; exit code 0."""
    result = cosim(cwd=tmp_path)
    assert result.code == 0
    assert max(map(len, result.out.splitlines())) <= 60
    typed = [line for line in EXAMPLE.findall(result.out) if "COMMAND" not in line]
    assert len(typed) == 4
    for line in typed:
        leaf, context, rest = leaf_of(words_of(line))
        leaf.make_context(leaf.name, rest, parent=context)


@pytest.mark.slow
def test_the_first_screen_is_followed_literally(tmp_path: Path) -> None:
    """Its commands one after the other, in an empty folder; the demo answers before it shows."""
    copied(fmu_store("native"), tmp_path / "fmus")
    lines = [line for line in EXAMPLE.findall(cosim(cwd=tmp_path).out) if "COMMAND" not in line]
    printed_by = {}
    for line in lines:
        done = cosim(*words_of(line), cwd=tmp_path)
        assert done.code == 0, (line, done.err)
        printed_by[line] = done.out.splitlines()
    demo = printed_by["cosim demo"]
    assert demo[0].startswith("delay-aware: the guarantee holds for this run")
    assert demo[1].startswith("naive: the guarantee is not claimed")
    after = [line.strip() for line in demo[demo.index("next:") + 1 : demo.index("")]]
    assert len(after) == 2
    for line in after:  # what it says to do next can be copied as it stands
        assert cosim(*words_of(line), cwd=tmp_path).code in (0, 1), line


@pytest.mark.slow
def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Typed one after the other, after what `cosim` alone shows: each answers in its first line.

    The answers are those of the page of first lines. With a SHARE, those that write what others
    read, and an eighth of the others.
    """
    copied(fmu_store("python", "native"), tmp_path / "fmus")
    monkeypatch.setattr("webbrowser.open", lambda _: True)
    answers, failed = first_lines.rows(), {}
    lines = in_order()
    kept = share_of(range(8))
    lines = [line for i, line in enumerate(lines) if line.startswith(BEFORE) or i % 8 in kept]
    for line in followed(tmp_path, lines):
        done = cosim(*words_of(line), cwd=tmp_path, columns=400)
        answer = first_lines.answer_in(done.out)
        if done.code not in {0, other_code(line)}:
            failed[line] = done.err
        elif line in answers and not first_lines.alike(answer, answers[line]):
            failed[line] = f"answers: {answer}\non the page: {answers[line]}"
    assert not failed, "\n".join(f"{line}\n{error}" for line, error in failed.items())


def test_the_page_of_first_lines_has_every_command() -> None:
    """Its rows are the first examples of all commands that are listed, as they stand."""
    assert set(first_lines.shown().values()) <= set(first_lines.rows())
    assert all(first_lines.rows().values())
    assert not first_lines.alike("written: a.toml, 3 lines", "written: b.toml, 3 lines")
