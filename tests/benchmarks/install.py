"""What an installation costs: seconds, megabytes, packages; and what runs after it.

Three fresh environments without pip, the versions of `constraints.txt`:

* the six packages that everything stands on, alone;
* auv-cosim from its wheel, without extras;
* auv-cosim from its wheel, with the extra `all` (only if asked for: it is large).

In the second, with nothing else on the path (no compiler, no git), the commands of the README
run. Megabytes are the bytes of all files, byte code of the installer included.

`python -m tests.benchmarks.install [WHEEL] [--all] [--json]`: without WHEEL, one is built. Exit
code 1: a command failed, or the installation is larger than 1.13 times the six packages; the aim
is 1.1, beyond which the exact arithmetic of the proofs (python-flint) takes 27 MB, and what draws
the command line (typer with rich, Pygments and pydantic) 24 MB.

With `--size` (`make install-size`) the second alone is made, and listed by distribution: what the
six bring and what this project adds, who requires each, and what it would cost to leave it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tests.benchmarks._distributions import SIX, figures_of, sizes, table_of

ROOT = Path(__file__).parents[2]
AIM, MOST = 1.1, 1.13
WIDTH = 130
VERBS = (
    ("--help",),
    ("demo",),
    ("run", "auv-acoustic"),
    ("run", "paper-example"),
    ("fmu", "check", "AuvPlant"),
    ("trace", "info", "traces/auv-acoustic.mcap"),
)


@dataclass(frozen=True)
class Installed:
    """An environment: what was asked for, and what that brought."""

    name: str
    seconds: float
    megabytes: float
    packages: int


@dataclass(frozen=True)
class Called:
    """A command in an environment with nothing else on the path."""

    command: str
    exit_code: int
    seconds: float
    last_line: str


def installed(name: str, wanted: list[str], folder: Path) -> Installed:
    """Make an environment without pip, and install into it."""
    venv.create(folder, with_pip=False)
    before = time.perf_counter()
    python = folder / "bin" / "python"
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    constraints = ["--disable-pip-version-check", "-c", str(ROOT / "constraints.txt")]
    _run([*command, *constraints, *wanted])
    seconds = time.perf_counter() - before
    files = [path for path in (folder / "lib").rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files if not path.is_symlink())
    packages = len([*(folder / "lib").glob("*/site-packages/*.dist-info")])
    return Installed(name, round(seconds, 1), round(size / 1e6, 1), packages)


def called(environment: Path, verb: tuple[str, ...], folder: Path) -> Called:
    """Call a command of the environment, in a folder of its own."""
    arguments = [str(folder / a) if a == "AuvPlant" else a for a in verb]
    if "AuvPlant" in verb:
        arguments[-1] = next(str(p) for p in environment.rglob("native/AuvPlant.fmu"))
    before = time.perf_counter()
    done = subprocess.run(  # noqa: S603 - our own command
        [str(environment / "bin" / "cosim"), *arguments],
        cwd=folder,
        env={"PATH": str(environment / "bin"), "HOME": str(folder), "TERM": "dumb"},
        capture_output=True,
        text=True,
        check=False,
    )
    lines = (done.stderr if done.returncode else done.stdout).strip().splitlines() or [""]
    seconds = round(time.perf_counter() - before, 2)
    return Called(f"cosim {' '.join(verb)}", done.returncode, seconds, lines[-1].strip())


def _run(command: list[str]) -> None:
    # what is found by PYTHONPATH counts as installed
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(  # noqa: S603 - pip
        command, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")


def wheel_of(given: str | None, folder: Path) -> Path:
    """Return the wheel that is named, or build one."""
    if given is not None:
        return Path(given).resolve()
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check"]
    _run([*command, "--no-deps", "-w", str(folder), str(ROOT)])
    return next(folder.glob("auv_cosim-*.whl"))


def measured(given: str | None, *, everything: bool) -> dict[str, Any]:
    """Install, count and call."""
    with tempfile.TemporaryDirectory(prefix="cosim-install-") as name:
        scratch = Path(name)
        wheel = wheel_of(given, scratch)
        six = installed(" ".join(SIX), [*SIX], scratch / "six")
        own = installed("auv-cosim", [str(wheel)], scratch / "own")
        found = [six, own]
        if everything:
            found.append(installed("auv-cosim[all]", [f"{wheel}[all]"], scratch / "all"))
        work = scratch / "work"
        work.mkdir()
        calls = [called(scratch / "own", verb, work) for verb in VERBS]
        return {
            "wheel_bytes": wheel.stat().st_size,
            "installed": [asdict(one) for one in found],
            "calls": [asdict(one) for one in calls],
            "megabytes_ratio": round(own.megabytes / six.megabytes, 4),
            "aim": AIM,
            "most": MOST,
        }


def size(given: str | None, *, as_json: bool) -> None:
    """Install auv-cosim alone, and print what each distribution takes."""
    with tempfile.TemporaryDirectory(prefix="cosim-install-") as name:
        scratch = Path(name)
        installed("auv-cosim", [str(wheel_of(given, scratch))], scratch / "own")
        found = sizes((scratch / "own" / "lib").glob("*/site-packages"))
    if as_json:
        print(json.dumps(figures_of(found), indent=1))
    else:
        Console(width=WIDTH).print(table_of(found))


def main() -> None:
    """Print the tables, or JSON."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.install")
    parser.add_argument("wheel", nargs="?")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--size", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.size:
        size(options.wheel, as_json=options.json)
        return
    found = measured(options.wheel, everything=options.all)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        costs = Table(title="pip install into a fresh environment", title_justify="left")
        for column in ("what", "s", "MB", "packages"):
            costs.add_column(column, justify="left" if column == "what" else "right")
        for one in found["installed"]:
            costs.add_row(*map(str, one.values()))
        costs.caption = f"{found['megabytes_ratio']} x the six packages; the aim is {AIM}"
        calls = Table(title="with nothing else on the path", title_justify="left")
        for column in ("command", "exit code", "s", "last line"):
            calls.add_column(column, justify="right" if column in {"exit code", "s"} else "left")
        for one in found["calls"]:
            calls.add_row(*(escape(str(value)) for value in one.values()))
        Console().print(costs, calls)
    if found["megabytes_ratio"] > MOST or any(one["exit_code"] for one in found["calls"]):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
