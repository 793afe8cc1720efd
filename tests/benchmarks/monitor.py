"""What it costs to judge a run by its guarantee: CPU of runs with it and without.

With it the law of the run is measured; without it every other figure of an outcome is. The runs are
in one process, the zero-state run included, without a trace. Both ways take turns, and of each the
least of several counts, since other work only adds.

`python -m tests.benchmarks.monitor [TIMES] [--json] [SCENARIO ...]`: 7 times by default.
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

from cosim.scenario import (
    ALL_FIGURES,
    FmuCache,
    PreparedScenario,
    Wanted,
    execute_unrecorded,
    load,
    prepare,
)

SCENARIOS = ("auv-acoustic", "auv-survey", "auv-remote", "survey-outages", "auv-direct")


OF_GUARANTEE = {
    *("assumptions", "departures", "guarantee_claimed", "facts", "disturbed", "state_growth"),
    "plant_differences",
}
"""Metrics of a run that say what its guarantee is worth."""


def cpu_s(prepared: PreparedScenario, wanted: Wanted) -> float:
    """Return the CPU time of a run with these figures [s]."""
    before = time.process_time()
    execute_unrecorded(prepared, keep=False, wanted=wanted)
    return time.process_time() - before


def others(prepared: PreparedScenario) -> Wanted:
    """Return every figure of a run but those of its guarantee."""
    found = execute_unrecorded(prepared, keep=False)[0].to_json()
    names = (f"metrics.{name}" for name in found["metrics"] if name not in OF_GUARANTEE)
    return Wanted([*names, *(key for key in found if key != "metrics")])


def measured(name: str, folder: Path, times: int) -> dict[str, Any]:
    """Return the least CPU times of a scenario with its guarantee judged, and without."""
    loaded = load(name)
    prepared = prepare(loaded, FmuCache(folder / "fmus", loaded.folder))
    wanted = ALL_FIGURES, others(prepared)
    least = [float("inf"), float("inf")]
    for _ in range(times):
        for way, figures in enumerate(wanted):
            least[way] = min(least[way], cpu_s(prepared, figures))
    share = least[0] / least[1] - 1
    return {"scenario": name, "with_s": least[0], "without_s": least[1], "share": share}


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("times", nargs="?", type=int, default=7)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [measured(name, Path(folder), given.times) for name in given.scenarios]
    if given.json:
        print(json.dumps(found, indent=1))
        return
    table = Table("scenario", "with [ms]", "without [ms]", "more")
    for one in found:
        times = (f"{1e3 * one[key]:.1f}" for key in ("with_s", "without_s"))
        table.add_row(one["scenario"], *times, f"{100 * one['share']:.1f} %")
    Console().print(table)


if __name__ == "__main__":
    main()
