"""The blocks of a page of the documentation, and how each is done as a reader would.

| block | what is done with it |
|---|---|
| `sh` | each line is a command, typed in the folder of the page |
| `toml` that begins with `# NAME.toml` | that file is written |
| `toml` below `<!-- part of a scenario -->` | the tables are read as tables of a scenario |
| `python` that begins with `# NAME.py` | that file is written |
| `python` | run, in one namespace for the whole page |
| `text` | every line is in what the commands before it wrote; `...` stands for anything |
| `math` | converted |
| `yaml` | parsed by a test of its page, and otherwise not run |
| anything below `<!-- not run: WHY -->` | nothing |

A page with `<!-- slow -->` is left out of the default tests.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from cli.shell import cosim

from cosim.scenario import ScenarioPart

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
SLOW = "<!-- slow -->"
PART = "part of a scenario"
NOT_RUN = "not run: "
_FENCE = re.compile(
    r"^(?:[ ]*<!-- (?P<note>[^>]+) -->\n\n?)?(?P<in>[ ]*)```(?P<language>\w*)[^\n]*\n"
    r"(?P<text>.*?)^(?P=in)```$",
    re.MULTILINE | re.DOTALL,
)
_NAMED = re.compile(r"# (\S+\.(?:toml|py))\n")
_OURS = re.compile(r"^(?:cosim|python|fmpy) ")
SETUP = ("python3 -m venv .venv", ". .venv/bin/activate")
"""What every reader of an install section knows; the gate does the same to get its wheel."""
LANGUAGES = {"sh", "toml", "python", "text", "math", "yaml"}


@dataclass(frozen=True)
class Block:
    """A fenced block: its line, its language, its text, and the comment above it."""

    line: int
    language: str
    text: str
    note: str

    @property
    def file(self) -> str | None:
        """Name of the file that the block is, if it is one."""
        named = _NAMED.match(self.text)
        return named[1] if named else None

    @property
    def is_run(self) -> bool:
        """Whether anything is done with it."""
        return not self.note.startswith(NOT_RUN)

    @property
    def commands(self) -> list[str]:
        """The lines that are typed, each without its comment; a trailing backslash joins two."""
        joined = self.text.replace("\\\n", " ")
        lines = (re.sub(r"\s+#\s.*", "", line).strip() for line in joined.splitlines())
        return [" ".join(line.split()) if "'" not in line else line for line in lines if line]


def blocks_of(page: Path) -> list[Block]:
    """Return every fenced block of a page, in order."""
    text = page.read_text("utf-8")
    found = []
    for match in _FENCE.finditer(text):
        indent = len(match["in"])
        body = "".join(line[indent:] for line in match["text"].splitlines(keepends=True))
        line = text.count("\n", 0, match.start("language")) + 1
        found.append(Block(line, match["language"], body, (match["note"] or "").strip()))
    return found


def pages() -> list[Path]:
    """Return every page that is written by hand, or begins so, and the README first."""
    heads = ROOT.glob("docs_site/heads/*.md")
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md")), *sorted(heads)]


def indented_commands(page: Path) -> list[str]:
    """Return commands in indented blocks, which no test would see."""
    outside = _FENCE.sub("", page.read_text("utf-8"))
    return [line for line in outside.splitlines() if re.match(r" {4,}(cosim|python|pip) ", line)]


@dataclass
class Reader:
    """Who does what a page says, in a folder of its own."""

    folder: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    output: str = ""

    def do(self, block: Block) -> None:
        """Do one block; AssertionError if it does not do what the page says."""
        if not block.is_run:
            return
        if block.file is not None:
            file = self.folder / block.file
            file.parent.mkdir(exist_ok=True)
            file.write_text(block.text, "utf-8")
            return
        match block.language:
            case "sh":
                self.output = "".join(self._typed(line) for line in block.commands)
            case "python":
                self.output = self._run(block)
            case "text":
                for missing in self._not_in_output(block.text):
                    raise AssertionError(f"not in the output: {missing}\n{self.output}")
            case "toml":
                assert block.note == PART, "a file without a name, or a part without its note"
                self._as_scenario(block.text)
            case _:
                assert block.language == "math", block.language

    def _typed(self, line: str) -> str:
        name, *arguments = shlex.split(line)
        if name == "cosim":
            result = cosim(*arguments, cwd=self.folder)
            assert result.code == 0, f"{line}\n{result.out}\n{result.err}"
            return result.out + result.err
        if name in ("pip", "make") or line in SETUP:
            checked_by_name(line)
            return ""
        program = Path(sys.executable).with_name("python" if name == "python" else name)
        done = subprocess.run(  # noqa: S603 - what the page tells people to type
            [program, *arguments],
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
            env={
                **os.environ,
                "MPLBACKEND": "Agg",
                "PATH": f"{program.parent}:{os.environ['PATH']}",
            },
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
        return done.stdout + done.stderr

    def _run(self, block: Block) -> str:
        printed = StringIO()
        code = compile(block.text, f"line {block.line}", "exec")
        with chdir(self.folder), redirect_stdout(printed):
            exec(code, self.names)  # noqa: S102 - what the page tells people to run
        return printed.getvalue()

    def _not_in_output(self, text: str) -> Iterator[str]:
        output = _plain(self.output)
        for line in text.splitlines():
            pattern = ".*?".join(re.escape(_plain(part)) for part in line.split("..."))
            if not re.search(pattern, output):
                yield line

    def _as_scenario(self, text: str) -> None:
        tables = tomllib.loads(text)
        for part in tables.get("components", {}).values():
            part.setdefault("fmu", "x.fmu")
        run = {"end": 1.0, "step": 0.1, **tables.pop("run", {})}
        data = {"title": "a part", "components": {"x": {"fmu": "x.fmu"}}, **tables, "run": run}
        ScenarioPart.model_validate(data)


def checked_by_name(line: str) -> None:
    """Check a line that installs or makes: the extras and targets that it names exist."""
    if line.startswith("make "):
        makefile = (ROOT / "Makefile").read_text("utf-8")
        for target in line.split()[1:]:
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
        return
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    for names in re.findall(r"\[([\w,]+)\]", line):
        assert set(names.split(",")) <= set(extras["optional-dependencies"]), line


def _plain(text: str) -> str:
    """Return text as it reads whatever the width of the terminal."""
    return " ".join(text.split())
