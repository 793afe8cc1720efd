"""The page of first lines: what each command answers, from running its examples.

python -m docs_site.first_lines     # runs them in an empty folder, and writes the page
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from docs_site.help_examples import commands, followed, in_order, why_not_run

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "first-lines.md"
_HEAD = """# First lines

Every command answers in its first line; `--json` has the same line under the key `answer`. Then
come the commands that make sense next, then what the answer rests on; `--details` shows the rest.
These are the answers of the first example of each command, typed in an empty folder one after the
other. `python -m docs_site.first_lines` writes this page.

| command | answer |
|---|---|
"""
_ROW = re.compile(r"^\| `(cosim [^`]*)` \| (.*) \|$", re.MULTILINE)
_NUMBER = re.compile(r"\d[\d.]*(e[-+]?\d+)?")
_RAW = {
    "scenario show": "the scenario as TOML",
    "scenario schema": "the schema as JSON",
    "study schema": "the schema as JSON",
    "trace cite": "the paragraph and the entries, to be copied",
}
"""Commands whose output is a file, which no line may precede, and what it is."""


def rows() -> dict[str, str]:
    """Return what the page has: command -> answer."""
    return dict(_ROW.findall(PAGE.read_text("utf-8")))


def answer_in(printed: str) -> str:
    """Return the answer in what a command printed on a wide terminal."""
    return printed.partition("\n")[0].strip()


def alike(one: str, other: str) -> bool:
    """Whether two answers are the same but for their numbers, as on another machine."""
    return _NUMBER.sub("#", one) == _NUMBER.sub("#", other)


def shown() -> dict[str, str]:
    """Return the command that the page has for each verb, by the words after `cosim`."""
    firsts = {}
    for words, examples in commands().items():
        usable = [line for line in examples if why_not_run(line) is None]
        if usable and words not in _RAW:
            firsts[words] = usable[0]
    return firsts


def _page(answers: dict[str, str]) -> str:
    parts = [f"| `{line}` | {answers[line]} |" for line in shown().values()]
    raw = [f"| `cosim {words}` | no line before it: {what} |" for words, what in _RAW.items()]
    return _HEAD + "\n".join([*parts, *raw]) + "\n"


def _answers(folder: Path) -> dict[str, str]:
    answers = {}
    for line in followed(folder, in_order()):
        done = subprocess.run(  # noqa: S602 - what the help tells people to type
            line.replace("--open", ""),
            shell=True,
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "COLUMNS": "400"},
        )
        answers[line] = answer_in(done.stdout)
        sys.stderr.write(f"{line}\n  {answers[line]}\n")
    return answers


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        PAGE.write_text(_page(_answers(Path(place))), "utf-8")
