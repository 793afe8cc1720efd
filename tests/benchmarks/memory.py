"""What memory a run takes at its peak, by its length: the command and its child, with the trace.

auv-acoustic at a step of 1 ms, for 15, 30 and 60 simulated minutes; with `--day` also for a day,
without a trace. Memory that the two processes share counts once (Linux: proportional set size).

`python -m tests.benchmarks.memory --json` prints {"memory": {MINUTES: {"points", "peak_mb",
"seconds", "traced"}}}.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil
from rich.table import Table

from tests.benchmarks._show import show

MINUTES = (15, 30, 60)
DAY = 24 * 60
_EVERY_S = 0.05
_RUN = """
from cosim import run

run("auv-acoustic", {trace!r}, settings=["run.end={end}", "run.step=0.001"],
    fmus=__import__("pathlib").Path({folder!r}), flavour="native")
"""


def peak_of(command: list[str]) -> tuple[float, float]:
    """Return the peak memory of a command and its children [MB], and its seconds."""
    began, peak = time.perf_counter(), 0
    process = psutil.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    while process.poll() is None:
        used = 0
        for one in (process, *process.children(recursive=True)):
            try:
                used += one.memory_full_info().pss
            except psutil.Error:  # it has just ended
                continue
        peak = max(peak, used)
        time.sleep(_EVERY_S)
    if process.returncode:
        raise RuntimeError(process.stderr.read().decode())
    return peak / 1e6, time.perf_counter() - began


def measured(minutes: int, folder: Path, *, traced: bool) -> dict[str, Any]:
    """Peak memory and seconds of one run."""
    trace = str(folder / "run.mcap") if traced else None
    code = _RUN.format(end=60.0 * minutes, trace=trace, folder=str(folder))
    peak_mb, seconds = peak_of([sys.executable, "-c", code])
    return {
        "points": 60_000 * minutes,
        "peak_mb": round(peak_mb, 1),
        "seconds": round(seconds, 1),
        "traced": traced,
    }


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        measured(1, folder, traced=True)  # builds the FMUs, compiles the kernel
        found = {minutes: measured(minutes, folder, traced=True) for minutes in MINUTES}
        if "--day" in sys.argv:
            found[DAY] = measured(DAY, folder, traced=False)
    view = Table("simulated minutes", "points, about", "peak MB", "seconds", "trace")
    for minutes, one in found.items():
        traced = "yes" if one["traced"] else "no"
        view.add_row(
            str(minutes),
            str(one["points"]),
            f"{one['peak_mb']:.0f}",
            f"{one['seconds']:.1f}",
            traced,
        )
    show(view, {"memory": {str(minutes): one for minutes, one in found.items()}})


if __name__ == "__main__":
    main()
