"""The examples in the help of every command, in an order in which each finds what it reads."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import typer.main

from cosim.cli import app
from cosim.cli.first_hour import FIRST_HOUR

NOT_RUN = {
    "study sensitivity": "no command before makes a study of this kind",
    "trace play": "a server, until Ctrl-C",
    "trace view": "opens a window",
    "--scheduler": "needs a cluster",
    "--workers": "needs a cluster",
    "paper --html": "computes for half a minute what `cosim paper` has computed",
    "theirs.ssp": "an archive of somebody else",
    "my-system.toml --outages": "this system has no feedback that is late",
    "flight.mcap": "a trace of one's own",
    "--design gain.json": "this design is not proved across outages",
    "modem.log": "a log of one's own",
}
"""Words of examples that nobody can follow here, and why."""
OTHER_CODES = {"trace diff": 1, "trace recover": 3, "migrate --check": 1}
"""Of examples that compare different runs, read a trace that was cut, and find old files."""
OWN_SYSTEM = """[system]
A = [[-5.0, 0.0], [6.0, -10.0]]
A1 = [[-1.0, 0.0], [2.0, 1.0]]
B = [[-1.0], [3.0]]
C = [[4.0], [3.0]]
D = [[-1.0, 0.0], [0.0, -1.0]]
D1 = [[4.0], [3.0]]
D2 = [[3.0], [-1.0]]
d = 0.3
"""
"""my-system.toml, the file that a reader has."""
_WRITING = (
    *("scenario new", "ssp export", "scenario", "design", "fmu build", "fmu controller", "ssp"),
    *("study run", "trace rerun", "vehicle new", "link record"),
)
"""Commands that write the files that others read, first to last."""
_FIRST = re.compile(r"^  (cosim .*)$", re.MULTILINE)


def first_screen() -> list[str]:
    """Return the commands that `cosim` alone names."""
    return [line for line in _FIRST.findall(FIRST_HOUR) if "COMMAND" not in line]


def examples_of(text: str) -> list[str]:
    """Return the command lines at the end of a help text."""
    block = inspect.cleandoc(text.replace("\f", "")).partition("\b\n")[2]
    return [line.strip() for line in block.splitlines() if line.strip()]


def commands() -> dict[str, list[str]]:
    """Return the examples of each listed command, by its words after `cosim`."""
    return dict(_below(typer.main.get_command(app), ""))


def in_order() -> list[str]:
    """Return every example once: the first screen, what writes files, then the others."""

    def place(words: str) -> int:
        firsts = (i for i, start in enumerate(_WRITING) if words.startswith(start))
        return next(firsts, len(_WRITING))

    listed = sorted(commands().items(), key=lambda item: place(item[0]))
    # some read the trace of such a run; the first screen makes others
    lines = ["cosim run auv-acoustic", "cosim run auv-acoustic-naive", *first_screen()]
    lines += [line for _, examples in listed for line in examples]
    return list(dict.fromkeys(lines))


def why_not_run(line: str) -> str | None:
    """Return why an example cannot be followed; None where it can."""
    return next((why for words, why in NOT_RUN.items() if words in line), None)


def _below(group: Any, path: str) -> Iterator[tuple[str, list[str]]]:
    for name, listed in list(group.commands.items()):
        if listed.hidden:
            continue
        context = group.context_class(group, info_name=name)
        _, command, _ = group.resolve_command(context, [name])
        words = f"{path} {name}".strip()
        if hasattr(command, "commands"):
            yield from _below(command, words)
        else:
            yield words, examples_of(command.help or "")
