"""What supervising a run costs: the child, the shared rows and the parent that follows.

Each scenario is run with its trace, supervised and in one process, taking turns; FMUs, design and
imports are made before. The difference of the least times is what a run pays once. Two small FMUs
in C over 100,000 points, without a trace, show what it pays per point.

`python -m tests.benchmarks.supervision --json` prints {"supervision": {CASE: {"points",
"supervised_s", "in_process_s", "difference_ms"}}}.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from rich.table import Table

from cosim.scenario import run
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu

SCENARIOS = ("auv-acoustic", "paper-example")
TURNS = 15
TINY = """\
title = "Two small FMUs"
connect = ["a.x -> b.u", "b.x -> a.u"]

[run]
end = 100.0
step = 0.001

[components.a]
fmu = "tiny6.fmu"

[components.b]
fmu = "tiny6.fmu"
"""


def measured(scenario: str, folder: Path, *, traced: bool) -> dict[str, Any]:
    """Least seconds of a run, supervised and in one process."""
    least = dict.fromkeys((True, False), float("inf"))
    points = 0
    for _ in range(TURNS):
        for supervise in least:
            began = time.perf_counter()
            outcome = run(
                scenario,
                folder / "t.mcap" if traced else None,
                fmus=folder,
                flavour="native",
                supervise=supervise,
            )
            least[supervise] = min(least[supervise], time.perf_counter() - began)
            points = outcome.steps + 1
    return {
        "points": points,
        "supervised_s": least[True],
        "in_process_s": least[False],
        "difference_ms": 1e3 * (least[True] - least[False]),
    }


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        tiny_fmu(6, folder)
        (folder / "tiny.toml").write_text(TINY)
        found = {name: measured(name, folder, traced=True) for name in SCENARIOS}
        found["two small FMUs"] = measured(str(folder / "tiny.toml"), folder, traced=False)
    view = Table(title="a whole run, least of many", title_justify="left")
    for column in ("", "points", "supervised", "in one process", "difference", "per point"):
        view.add_column(column, justify="right" if column else "left")
    for name, row in found.items():
        view.add_row(
            name,
            str(row["points"]),
            f"{1e3 * row['supervised_s']:.1f} ms",
            f"{1e3 * row['in_process_s']:.1f} ms",
            f"{row['difference_ms']:.1f} ms",
            f"{1e6 * row['difference_ms'] / row['points']:.0f} ns",
        )
    show(view, {"supervision": found})


if __name__ == "__main__":
    main()
