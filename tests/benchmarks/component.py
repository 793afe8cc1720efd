"""What a step of a component in Python costs, beside an FMU of pythonfmu and one in C.

The paper's plant flies with u = K x, computed by each; `python -m tests.benchmarks.component
--json` prints {WAY: us of CPU per communication point}. The run without a controller is taken off.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cosim import Component, Scenario, build_fmu, run
from cosim.hinf import system_by_name

GAIN = (0.6432, -0.5679)
POINTS, REPEATS = 100_000, 3


class Law(Component):
    """u = K x."""

    inputs, outputs = {"x": 2}, {"u": 1}

    def step(self, t: float, dt: float, u: Any) -> Any:  # noqa: ARG002
        x = u["x"]
        return {"u": GAIN[0] * x[0] + GAIN[1] * x[1]}


def cost(scenario: Scenario) -> float:
    """CPU time per point [us], the least of some runs; opening and a short run are taken off."""
    least = []
    for until in (10.0, 10.0 + POINTS / 100):
        times = []
        for _ in range(REPEATS):
            begin = time.process_time()
            run(scenario.set("run.end", until), supervise=False, keep=False)
            times.append(time.process_time() - begin)
        least.append(min(times))
    return (least[1] - least[0]) / POINTS * 1e6


def figures() -> dict[str, float]:
    """Cost of each way [us per point]."""
    alone = Scenario(step=0.01, until=1).add("plant", system_by_name("paper").system)

    def closed(controller: Any) -> Scenario:
        found = alone.add("law", controller).connect("plant.x", "law.x")
        return found.connect("law.u", "plant.u")

    with tempfile.TemporaryDirectory() as folder:
        bare = cost(alone)
        ways: dict[str, Any] = {
            "component in Python": Law,
            "FMU of pythonfmu": build_fmu("PaperController", Path(folder, "python"), "python"),
            "FMU in C": build_fmu("PaperController", Path(folder, "native")),
        }
        return {way: cost(closed(what)) - bare for way, what in ways.items()}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON alone")
    as_json = parser.parse_args().json
    found = figures()
    if as_json:
        print(json.dumps(found, indent=1))
        return
    view = Table("way", "us per point", title="A step of a controller")
    for way, value in found.items():
        view.add_row(way, f"{value:.2f}")
    Console().print(view)


if __name__ == "__main__":
    main()
