"""One output at one place: what a user sees, and whether all is as it must be."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from chaos.command import ENVIRONMENT, Command, Ended, cosim_line
from outputs.every_output import OUTPUTS, Output
from outputs.places import NOTHING, OF_USERS, OLD, PLACES, NotHereError, Place, standing

FOLDERS = ("new", "a file", "a circle", "null", "a pipe alone", *OF_USERS[:2])
"""The places of what goes into a folder; a file in its place is refused."""
SLOW = ("a link",)
"""The places that a slow command is tried whole at, beside those that refuse it."""
_REFUSED = (2, 3)
_NEVER = re.compile(r"Traceback|[Uu]nexpected|Exception ignored")


class Row(NamedTuple):
    """An output, and the name of a place."""

    output: Output
    place: str

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.output.name}: {self.place}"


class Found(NamedTuple):
    """What became of a row; `skipped` : why it was not tried."""

    row: Row
    ended: Ended | None
    becomes: str
    departures: tuple[str, ...]
    skipped: str = ""


def rows() -> Iterator[Row]:
    """Every output at every place that is one for it."""
    for output in OUTPUTS:
        for place in FOLDERS if output.kind == "folder" else PLACES:
            planted = place == "a planted link"
            if not planted or output.kind == "trace":
                yield Row(output, place)


def try_row(row: Row, stock: Path, home: Path) -> Found:
    """Call the command with its output at the place.

    stock : what the commands read.
    home : an empty folder.
    """
    home.chmod(0o711)
    if row.output.needs is not None and find_spec(row.output.needs) is None:
        return Found(row, None, "", (), f"without {row.output.needs}")
    try:
        with standing(row.place, home, f"out{row.output.suffix}") as place:
            becomes = _becomes(row, place)
            whole = becomes in ("written", "written into", "refused late")
            if row.output.slow and whole and row.place not in SLOW:
                return Found(row, None, becomes, (), "takes long; at a link it is tried")
            ended = _called(row, place, stock, home)
            wrong = tuple(_departures(row, place, becomes, ended))
            return Found(row, ended, becomes, wrong)
    except NotHereError as error:
        return Found(row, None, "", (), str(error))


def _becomes(row: Row, place: Place) -> str:
    """What must become of the output: a trace, or a folder, is nothing to be written into."""
    into = place.becomes == "written into" or row.place == "full"
    if row.output.kind == "trace" and (into or row.place == "a planted link"):
        return "refused"
    if row.output.kind == "folder":
        return "written" if row.place == "new" else "refused"
    if row.place == "a folder" and row.output.suffix == ".mat":
        return "written inside"
    return place.becomes


def _called(row: Row, place: Place, stock: Path, home: Path) -> Ended:
    work, scratch = home / "work", home / "tmp"
    for folder in (work, scratch):
        folder.mkdir()
        folder.chmod(0o777)
    arguments = row.output.arguments(stock)
    line = cosim_line(*row.output.verb.split(), *arguments, row.output.option, place.path)
    environment = {**os.environ, **ENVIRONMENT, "TMPDIR": str(scratch)}
    if place.user is not None:
        line = [*_as_user(place.user), *line]
        environment["HOME"] = str(work)
    return Command(line, work, scratch, env=environment).ended()


def _as_user(number: int) -> list[str]:
    setpriv = shutil.which("setpriv")
    if setpriv is None or sys.platform != "linux":
        raise NotHereError("no command to act as another user")
    return [setpriv, f"--reuid={number}", f"--regid={number}", "--clear-groups"]


def _departures(row: Row, place: Place, becomes: str, ended: Ended) -> Iterator[str]:
    expected = _REFUSED if becomes.startswith("refused") else (row.output.usual,)
    if ended.code is None:
        yield "it hangs"
    elif ended.code not in expected:
        yield f"exit code {ended.code}, expected {' or '.join(map(str, expected))}"
    if never := _NEVER.search(ended.printed):
        yield f"printed: {never[0]}"
    if wrong := _wrong_place(row, place, becomes):
        yield wrong
    yield from (f"left: {line}" for line in ended.processes_left)
    yield from (f"left in the temporary folder: {name}" for name in ended.files_left)
    if place.path.parent.is_dir() and not place.path.is_dir():
        beside = {path.name for path in place.path.parent.iterdir() if "partial" in path.name}
        allowed = {f"{place.path.name}.partial"} if row.output.kind == "trace" else set()
        yield from (f"left beside it: {name}" for name in sorted(beside - allowed))


def _wrong_place(row: Row, place: Place, becomes: str) -> str:
    """What is wrong with the place afterwards."""
    wrong = place.after()
    if becomes == "written inside" or (row.output.kind == "folder" and becomes == "written"):
        filled = place.path.is_dir() and any(place.path.iterdir())
        return "" if filled else "the folder is empty"
    if row.output.kind == "folder" and row.place == "a file":
        return "" if place.path.read_bytes() == OLD else "the file is overwritten"
    if row.output.kind == "trace" and row.place == "a pipe":  # which a trace is not written into
        return "" if wrong == NOTHING else wrong or "the pipe received something"
    return wrong
