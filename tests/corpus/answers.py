"""Asks the product about the files of the corpus, through its command line and its faces.

PYTHONPATH=tests python -m corpus.answers [FACE FILE ...] writes the answers that `answers.json`
does not have yet, or those named again. An answer that is there stands for the version that gave
it.
"""

from __future__ import annotations

import json
import platform
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import shared
from corpus.faces import FACES, TOGETHER
from corpus.files import HERE, corpus, kept

from cosim.core import LossError

ANSWERS = HERE / "answers.json"


def machine() -> dict[str, str]:
    """What the last bit of a run depends on, beside the binaries of the FMUs."""
    libc = "".join(platform.libc_ver())
    found = {"machine": platform.machine(), "libc": libc, "python": platform.python_version()}
    return {**found, "numpy": version("numpy")}


def ask(face: str, name: str, place: Path) -> dict[str, Any]:
    """Return what one face of the product says of a file; what is written goes to `place`."""
    answer = FACES[face][1](name, place)
    text = json.dumps(answer, sort_keys=True).replace(f"{corpus()}/", "").replace(f"{place}/", "")
    found: dict[str, Any] = json.loads(text)
    return found


def asked() -> list[tuple[str, str]]:
    """Every face with every file that it is asked about, in order."""
    return [
        (face, name) for face, (of, _) in FACES.items() for name in (*kept(), *TOGETHER) if of(name)
    ]


def main(wanted: list[tuple[str, str]]) -> None:
    """Write the answers that are missing, and those that are wanted again."""
    found = json.loads(ANSWERS.read_text("utf-8")) if ANSWERS.exists() else {"machine": machine()}
    for face, name in asked():
        if name in found.setdefault(face, {}) and (face, name) not in wanted:
            continue
        with tempfile.TemporaryDirectory() as place:
            try:
                found[face][name] = ask(face, name, Path(place))
            except (AssertionError, LossError, KeyError) as error:
                sys.exit(f"{face} {name}: {error!r}")
    ANSWERS.write_text(_one_a_line(found), "utf-8")


def _one_a_line(answers: dict[str, dict[str, Any]]) -> str:
    """Return them as JSON with a line for each answer, so that a difference names its file."""

    def line(name: str, answer: Any) -> str:
        return f"  {json.dumps(name)}: {json.dumps(answer, sort_keys=True, ensure_ascii=False)}"

    faces = (
        f" {json.dumps(face)}: {{\n"
        + ",\n".join(line(name, of[name]) for name in sorted(of))
        + "\n }"
        for face, of in sorted(answers.items())
    )
    return "{\n" + ",\n".join(faces) + "\n}\n"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as session:
        shared.share_below(Path(session).resolve())
        main([*zip(sys.argv[1::2], sys.argv[2::2], strict=True)])
