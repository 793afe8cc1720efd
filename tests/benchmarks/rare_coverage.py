"""How often the 95 % intervals of rare events cover the truth, and how often none is given.

Linear and chi-square problems, two separated regions, islands: closed forms of `rare_problems`,
by both methods, in 2 to 20 dimensions.

`python -m tests.benchmarks.rare_coverage [REPEATS] [--json] [--samples N] [--only WORD]` prints
{"repeats", "samples", "problems": [{"problem", "kind", "method", "truth", "given", "covered",
"refused", "coverage", "runs"}]}: counts, the share covered of the intervals given (null: none
given), and the mean number of runs; without `--json` also as a table. 600 repeats take an hour.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

if __package__ == "tests.benchmarks":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from study.rare_problems import ISLANDS, MODES, PLAIN, Problem

from cosim.study import estimated, importance_sampling, subset_simulation

METHODS = ("subset", "importance")
LEVELS = 12


def measured(problem: Problem, method: str, seed: int, samples: int) -> tuple[bool, bool, int]:
    """Return whether an interval is given, whether it covers the truth, and the number of runs."""
    runs = 0

    def counted(u: Any) -> Any:
        nonlocal runs
        runs += len(u)
        return problem.limit(u)

    d = problem.dimensions
    found = estimated(
        subset_simulation(d, samples, LEVELS, seed)
        if method == "subset"
        else importance_sampling(d, samples, samples, LEVELS, seed),
        counted,
    )
    if found.probability is None:
        return False, False, runs
    low, high = found.interval(0.95)
    return True, low <= problem.truth <= high, runs


def row(problem: Problem, method: str, repeats: int, samples: int) -> dict[str, Any]:
    """Return the counts of one problem by one method."""
    all_of = [measured(problem, method, 1000 + seed, samples) for seed in range(repeats)]
    given, covered, runs = np.array(all_of, float).sum(axis=0)
    return {
        "problem": problem.name,
        "kind": problem.kind,
        "method": method,
        "truth": problem.truth,
        "given": int(given),
        "covered": int(covered),
        "refused": repeats - int(given),
        "coverage": float(covered / given) if given else None,
        "runs": round(runs / repeats),
    }


def _row(place: tuple[int, str, int, int]) -> dict[str, Any]:
    return row((*PLAIN, *MODES, *ISLANDS)[place[0]], *place[1:])


def main() -> None:
    """Measure and print."""
    read = argparse.ArgumentParser(description=__doc__)
    read.add_argument("repeats", type=int, nargs="?", default=600)
    read.add_argument("--samples", type=int, default=1000)
    read.add_argument("--only", default="")
    read.add_argument("--json", action="store_true")
    asked = read.parse_args()
    places = [
        (i, method, asked.repeats, asked.samples)
        for i, problem in enumerate((*PLAIN, *MODES, *ISLANDS))
        for method in METHODS
        if asked.only in f"{problem.name} {problem.kind} {method}"
    ]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(_row, places))
    if not asked.json:
        table = Table("problem", "method", "probability", "covered", "of", "%", "refused", "runs")
        for each in rows:
            share = "" if each["coverage"] is None else f"{100 * each['coverage']:.1f}"
            table.add_row(
                each["problem"],
                each["method"],
                f"{each['truth']:.3g}",
                *(str(each[key]) for key in ("covered", "given")),
                share,
                str(each["refused"]),
                str(each["runs"]),
            )
        Console(width=120).print(table)
    print(json.dumps({"repeats": asked.repeats, "samples": asked.samples, "problems": rows}))


if __name__ == "__main__":
    main()
