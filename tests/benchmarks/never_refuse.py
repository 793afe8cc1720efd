"""What designs of varied systems cost, how close they come, and which are refused.

    python -m tests.benchmarks.never_refuse [FIRST LAST] [--grid] [--chains] [--json]

Designs 200 systems of varied shape (seeds FIRST to LAST, the last left out), and prints per number
of states: designs, refusals, CPU seconds, and gamma over the exact norm of the nominal loop; then
a line for each that is refused. With --grid each of these is also tried with cvxpy and Clarabel on
the plain LMI over 20 x 20 pairs k1, k2. With --chains, spring-mass chains of 12 to 24 states, once
by this project and once by cvxpy with Clarabel on the same LMI at the same k1, k2, in one run.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import cvxpy as cp
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1] / "hinf"))
sys.path.insert(0, str(Path(__file__).parents[1]))

from test_routes import certified_over_grid
from varied_systems import chain, varied_system

from cosim.core import NotAchievableError
from cosim.hinf import as_cvxpy, check_certificate, design
from tests.benchmarks._show import show

CHAINS = (12, 16, 20, 24)
AT = ((-2.5,), (2.5,))
"""k1, k2 of the chains."""


def survey(seeds: range, *, grid: bool) -> dict[str, Any]:
    """Design the systems; return one row per number of states, and what was refused."""
    rows: dict[int, list[tuple[float, float | None]]] = {}
    refused: list[dict[str, Any]] = []
    for seed in seeds:
        system = varied_system(seed)
        start = time.process_time()
        try:
            found = design(system, alternatives=False)
            ratio = (found.gamma or 0.0) / found.exact_norm if found.exact_norm else None
            if not check_certificate(found.certificate).valid:
                raise AssertionError(f"the certificate of system {seed} does not hold")
        except NotAchievableError as error:
            ratio = None
            refused.append({"seed": seed, "what": error.what})
            if grid:
                refused[-1]["certified_over_grid"] = certified_over_grid(system)
        rows.setdefault(len(system.A), []).append((time.process_time() - start, ratio))
    return {
        "rows": [
            {
                "n": n,
                "systems": len(made),
                "refused": sum(ratio is None for _, ratio in made),
                "seconds": statistics.median(seconds for seconds, _ in made),
                "slowest": max(seconds for seconds, _ in made),
                "ratio": statistics.median([r for _, r in made if r is not None] or [math.nan]),
                "worst": max((r for _, r in made if r is not None), default=math.nan),
            }
            for n, made in sorted(rows.items())
        ],
        "refused": refused,
    }


def chains() -> list[dict[str, float]]:
    """Return CPU seconds of a proved design, of cvxpy's solve, and of the certificate's check."""
    rows = []
    for n in CHAINS:
        system = chain(n)
        start = time.process_time()
        found = design(system, *AT, order=None, search=False)
        ours = time.process_time() - start
        start = time.process_time()
        valid = check_certificate(found.certificate).valid
        check = time.process_time() - start
        start = time.process_time()
        least = as_cvxpy(system, *AT).problem.solve(solver=cp.CLARABEL)
        theirs = time.process_time() - start
        gamma = found.gamma or float("nan")
        rows.append(
            {"n": n, "gamma": gamma, "cvxpy": least, "seconds": ours, "cvxpy_seconds": theirs}
            | {"check_seconds": check, "valid": valid}
        )
    return rows


def main() -> None:
    """Print the tables and JSON."""
    numbers = [int(x) for x in sys.argv[1:] if x.isdigit()] or [0, 200]
    if "--chains" in sys.argv:
        rows = chains()
        show(_table("chains", rows), rows)
        return
    made = survey(range(*numbers), grid="--grid" in sys.argv)
    show(_table("systems", made["rows"]), made, *map(str, made["refused"]))


def _table(title: str, rows: list[dict[str, Any]]) -> Table:
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*(f"{x:.4g}" if isinstance(x, float) else str(x) for x in row.values()))
    return table


if __name__ == "__main__":
    main()
