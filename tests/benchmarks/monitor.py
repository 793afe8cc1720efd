"""What it costs to measure the law of a run: CPU of recorded runs with it and without.

The runs are those of a command in one process, trace and zero-state run included, without a child
process. Both ways take turns, and of each the least of several counts, since other work only adds.

`python -m tests.benchmarks.monitor [TIMES] [--json] [SCENARIO ...]`: 7 times by default.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rich.console import Console
from rich.table import Table

from cosim.scenario import (
    FmuCache,
    PreparedScenario,
    execute_recorded,
    load,
    prepare,
    supervision_of,
)
from cosim.scenario.execute import _Runs

SCENARIOS = ("auv-acoustic", "auv-survey", "auv-remote", "survey-outages", "auv-direct")


def cpu_s(prepared: PreparedScenario, folder: Path) -> float:
    """Return the CPU time of a recorded run [s]."""
    alone = replace(supervision_of(prepared.loaded.scenario), method=None)
    before = time.process_time()
    execute_recorded(prepared, folder / "run.mcap", supervision=alone)
    return time.process_time() - before


def measured(name: str, folder: Path, times: int) -> dict[str, Any]:
    """Return the least CPU times of a scenario with the law measured, and without."""
    loaded = load(name)
    prepared = prepare(loaded, FmuCache(folder / "fmus", loaded.folder))
    without = patch.object(_Runs, "_law_measures", lambda *_: None)
    least = [float("inf"), float("inf")]
    cpu_s(prepared, folder)
    for _ in range(times):
        least[0] = min(least[0], cpu_s(prepared, folder))
        with without:
            least[1] = min(least[1], cpu_s(prepared, folder))
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
