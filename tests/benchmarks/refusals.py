"""What designs of varied systems cost, how close they come, and which are refused.

    python -m tests.benchmarks.refusals [COUNT] [--grid] [--chains] [--json]

Designs `COUNT` systems of varied shape (200), and prints per number of states: designs, refusals,
CPU seconds, and gamma over the exact norm of the nominal loop. With --grid each refused system
is also tried with cvxpy and Clarabel on the plain LMI over 20 x 20 pairs k1, k2. With --chains,
spring-mass chains of 12 to 24 states, once by this project and once by cvxpy with Clarabel on
the same LMI at the same k1, k2, in one run.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import cvxpy as cp
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1] / "hinf"))
sys.path.insert(0, str(Path(__file__).parents[1]))

from test_routes import certified_over_grid
from varied_systems import chain, varied_system

from cosim.core import NotAchievableError
from cosim.hinf import as_cvxpy, check_certificate, design

COUNT = 200
CHAINS = (12, 16, 20, 24)
AT = ((-2.5,), (2.5,))
"""k1, k2 of the chains."""


def survey(count: int, *, grid: bool) -> dict[str, Any]:
    """Design `count` systems; return one row per number of states, and what was refused."""
    rows: dict[int, list[tuple[float, float | None]]] = {}
    refused: list[dict[str, Any]] = []
    for seed in range(count):
        system = varied_system(seed)
        start = time.process_time()
        try:
            found = design(system)
            ratio = (found.gamma or 0.0) / found.exact_norm if found.exact_norm else None
        except NotAchievableError as error:
            ratio = None
            refused.append({"seed": seed, "what": error.what})
            if grid:
                refused[-1]["certified_over_grid"] = certified_over_grid(system)
        rows.setdefault(len(system.A), []).append((time.process_time() - start, ratio))
    return {
        "rows": {
            n: {
                "systems": len(made),
                "refused": sum(ratio is None for _, ratio in made),
                "seconds": statistics.median(seconds for seconds, _ in made),
                "slowest": max(seconds for seconds, _ in made),
                "ratio": statistics.median([r for _, r in made if r is not None] or [float("nan")]),
                "worst": max((r for _, r in made if r is not None), default=float("nan")),
            }
            for n, made in sorted(rows.items())
        },
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
    """Print the tables, or JSON."""
    numbers = [int(x) for x in sys.argv[1:] if x.isdigit()]
    made: dict[str, Any] = {}
    if "--chains" in sys.argv:
        made["chains"] = chains()
    if numbers or "--chains" not in sys.argv:
        made["systems"] = survey(*(numbers or [COUNT]), grid="--grid" in sys.argv)
    if "--json" in sys.argv:
        print(json.dumps(made, indent=1))
        return
    console = Console()
    for name, rows in (
        ("chains", made.get("chains", [])),
        ("systems", [{"n": n} | x for n, x in made.get("systems", {}).get("rows", {}).items()]),
    ):
        if not rows:
            continue
        table = Table(*rows[0], title=name)
        for row in rows:
            table.add_row(*(f"{x:.4g}" if isinstance(x, float) else str(x) for x in row.values()))
        console.print(table)
    for one in made.get("systems", {}).get("refused", []):
        console.print(one)


if __name__ == "__main__":
    main()
