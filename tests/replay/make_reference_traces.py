"""Makes the traces that are kept in traces/reference: the built-in scenarios, cut short.

python tests/replay/make_reference_traces.py [NAME ...]

A trace that is there already is left alone: it stands for the version that wrote it.
"""

from __future__ import annotations

import platform
import re
import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

from cosim.scenario import FmuCache, execute_run, load, parse, prepare

FOLDER = Path(__file__).parents[2] / "traces" / "reference"
ENDS = {
    "auv-acoustic": 8.0,
    "auv-acoustic-naive": 8.0,
    "auv-direct": 5.0,
    "auv-worst-case": 8.0,
    "paper-worst-case": 0.5,
}
"""Seconds that are kept of each scenario; paper-example is kept whole, by an earlier version."""


def make(name: str, folder: Path) -> Path:
    """Fly the first seconds of a scenario into `folder`/NAME.mcap."""
    loaded = load(name)
    text, changed = re.subn(r"(?m)^end = \S+$", f"end = {ENDS[name]}", loaded.text)
    assert changed == 1, f"{name}: {changed} lines say when it ends"
    short = parse(text, name=name, where=name, folder=loaded.folder)
    target = folder / f"{name}.mcap"
    with tempfile.TemporaryDirectory() as fmus:
        prepared = prepare(short, FmuCache(root=Path(fmus), folder=Path.cwd()))
        # which numbers come out depends on the C library, not on the kernel of a machine
        machine = "-".join((platform.system(), platform.machine(), *platform.libc_ver()))
        with (
            patch("platform.platform", lambda: machine),
            patch.object(sys, "argv", ["cosim", "run", f"{name}, to t = {ENDS[name]:g} s"]),
        ):
            execute_run(prepared, target)
    return target


if __name__ == "__main__":
    for wanted in sys.argv[1:] or ENDS:
        if (FOLDER / f"{wanted}.mcap").exists():
            print(f"{wanted}: kept as it is")  # noqa: T201 - a script
            continue
        made = make(wanted, FOLDER)
        print(f"{wanted}: {made.stat().st_size} bytes")  # noqa: T201
