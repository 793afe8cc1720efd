"""What a command costs before it does anything: modules loaded, and seconds of CPU.

Every verb runs in processes of its own, in a folder where its FMUs and traces are already; the
least of several is taken, since other work only adds. `--from` measures an installation: the
Python of any environment that has the package.

`python -m tests.benchmarks.start [TIMES] [--from PYTHON] [--json]`: 7 times by default. Exit code
1: more than 0.3 s for `cosim --help`, or 0.6 s for `cosim run paper-example`.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

TIMES = 7
LIMITS = {"--help": 0.3, "run paper-example": 0.6}
VERBS = (
    "--help",
    "run --help",
    "design --help",
    "trace --help",
    "scenario list",
    "run paper-example",
    "run auv-acoustic",
    "trace info traces/paper-example.mcap",
    "trace verify traces/paper-example.mcap",
    "fmu info FMU",
    "certificate check DESIGN",
    "design paper",
)
_PACKAGE = "from pathlib import Path; import cosim; print(Path(cosim.__file__).parent)"


@dataclass(frozen=True)
class Start:
    """A verb: the modules that it loads, in all and of the package, and its least CPU time."""

    verb: str
    modules: int
    own: int
    cpu_s: float
    limit_s: float | None


def cpu_s(command: list[str], folder: Path, times: int) -> float:
    """Return the least CPU time of a command and its children."""
    least = float("inf")
    for _ in range(times):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, cwd=folder, capture_output=True, check=True)  # noqa: S603 - ours
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)
        least = min(least, used)
    return least


def modules(python: str, arguments: list[str], folder: Path) -> list[str]:
    """Return the modules that a verb loads, by Python's own account."""
    command = [python, "-X", "importtime", "-m", "cosim", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)  # noqa: S603
    lines = (line for line in done.stderr.splitlines() if line.startswith("import time:"))
    names = [line.rpartition("|")[2].strip() for line in lines]
    return [name for name in names if name != "imported package"]


def measured(python: str, times: int) -> list[Start]:
    """Measure every verb."""
    with tempfile.TemporaryDirectory(prefix="cosim-start-") as name:
        folder = Path(name)
        package = Path(subprocess.check_output([python, "-c", _PACKAGE], text=True).strip())  # noqa: S603
        subprocess.run(  # noqa: S603 - what later commands find: FMUs, a trace, byte code
            [python, "-m", "cosim", "run", "paper-example"],
            cwd=folder,
            capture_output=True,
            check=True,
        )
        places = [
            *folder.rglob("PaperController.fmu"),
            *package.rglob("native/PaperController.fmu"),
        ]
        named = {
            "FMU": str(places[0]),
            "DESIGN": str(package / "scenario/library/designs/paper-printed-gain.json"),
        }
        found = []
        for verb in VERBS:
            arguments = [named.get(word, word) for word in verb.split()]
            loaded = modules(python, arguments, folder)
            own = [one for one in loaded if one == "cosim" or one.startswith("cosim.")]
            seconds = cpu_s([python, "-m", "cosim", *arguments], folder, times)
            found.append(Start(verb, len(loaded), len(own), round(seconds, 3), LIMITS.get(verb)))
        return found


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.start")
    parser.add_argument("times", nargs="?", type=int, default=TIMES)
    parser.add_argument("--from", dest="python", default=sys.executable)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    found = measured(options.python, options.times)
    if options.json:
        print(json.dumps([asdict(one) for one in found], indent=1))
    else:
        table = Table(title="to start a command", title_justify="left")
        for column in ("cosim ...", "modules", "own", "CPU s", "at most"):
            table.add_column(column, justify="left" if column == "cosim ..." else "right")
        for one in found:
            limit = "" if one.limit_s is None else f"{one.limit_s:g}"
            table.add_row(one.verb, str(one.modules), str(one.own), f"{one.cpu_s:.3f}", limit)
        Console().print(table)
    if any(one.limit_s is not None and one.cpu_s > one.limit_s for one in found):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
