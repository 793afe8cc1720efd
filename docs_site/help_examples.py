"""The examples in the help of every command, in an order in which each finds what it reads."""

from __future__ import annotations

import inspect
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from cosim.cli.first_hour import FIRST_HOUR
from docs_site.cli_page import listed

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
    return {
        words: examples_of(command.help or "")
        for words, command in listed()
        if not hasattr(command, "commands")
    }


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


def followed(folder: Path, lines: Iterable[str]) -> Iterator[str]:
    """Yield the lines that can be followed in a folder, each once what it reads is there.

    It writes what no command makes: a reader's own system, and a trace that was cut.
    """
    (folder / "my-system.toml").write_text(OWN_SYSTEM, "utf-8")
    trace = folder / "traces" / "auv-survey.mcap"
    for line in lines:
        if why_not_run(line) is not None:
            continue
        if "trace recover" in line:
            shutil.copy(trace, f"{trace}.partial")
            os.truncate(f"{trace}.partial", trace.stat().st_size // 2)
        yield line


def other_code(line: str) -> int:
    """Return the exit code that a line may have beside 0."""
    return OTHER_CODES.get(" ".join(line.split()[1:3]), 0)


def why_not_run(line: str) -> str | None:
    """Return why an example cannot be followed; None where it can."""
    return next((why for words, why in NOT_RUN.items() if words in line), None)
