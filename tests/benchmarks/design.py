"""What a design costs: the assembled LMI against the straightforward way, in one run.

Least gamma for the paper's example and for the vehicle, each over a few k1, k2 in turn, as a
search asks for them:

* ours: the LMI assembled once, handed to Clarabel directly;
* cvxpy and Clarabel: the LMI written down and handed over anew for every k1, k2;
* cvxpy and CVXOPT: the same with an interior-point solver of the other kind, one dense system
  in the unknowns a step (python -m pip install "auv-cosim[bench]");
* cvxpy and SCS: the same with a first-order solver, at its default accuracy and for at most
  five seconds a solve.

Prints a table, and JSON with --json. Figures are ratios to ours; the milliseconds beside them
hold for this machine alone. The largest relative deviation from Clarabel's gamma says whether
the same thing was computed.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import cvxpy as cp
import numpy as np
from rich.console import Console
from rich.table import Table

from cosim.hinf import as_cvxpy, auv_system
from cosim.hinf.delay_lti import one_thread
from cosim.hinf.lmi import Answer, Problem
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem, paper_example

SCALES = (0.9, 1.0, 1.1)
"""Multiples of k1 and k2 that are asked for."""
PATIENCE = 5.0
"""Seconds that SCS may take for one solve; it ends with what it has."""
CASES: dict[str, tuple[DelaySystem, tuple[float, ...], tuple[float, ...]]] = {
    "paper": (paper_example.system(), (paper_example.K1,), (paper_example.K2,)),
    "auv": (auv_system(), DEFAULT_K1, DEFAULT_K2),
}


@one_thread
def ours(
    system: DelaySystem, points: list[tuple[tuple[float, ...], tuple[float, ...]]]
) -> list[float]:
    """Least gammas by the assembled LMI."""
    problem = Problem(system)
    delays = tuple(delay.d for delay in system.delays)
    values = []
    for k1, k2 in points:
        answer = problem.least_gamma(Scalars(k1, k2, delays))
        values.append(answer.value if isinstance(answer, Answer) else np.nan)
    return values


def loop(
    system: DelaySystem, points: list[tuple[tuple[float, ...], tuple[float, ...]]], solver: str
) -> list[float]:
    """Least gammas by the loop a user writes with cvxpy."""
    values = []
    for k1, k2 in points:
        asked = as_cvxpy(system, k1, k2)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is inaccurate shows in the deviation
            asked.problem.solve(
                solver=solver, **({"time_limit_secs": PATIENCE} if solver == "SCS" else {})
            )
        values.append(np.nan if asked.gamma.value is None else float(asked.gamma.value))
    return values


def rows_of(name: str, repeats: int) -> list[dict[str, Any]]:
    """One row per way of solving."""
    system, one, two = CASES[name]
    points = [(tuple(s * k for k in one), tuple(s * k for k in two)) for s in SCALES]
    ways: dict[str, Callable[[], list[float]]] = {
        "ours": lambda: ours(system, points),
        "cvxpy, Clarabel": lambda: loop(system, points, "CLARABEL"),
        "cvxpy, CVXOPT": lambda: loop(system, points, "CVXOPT"),
        "cvxpy, SCS": lambda: loop(system, points, "SCS"),
    }
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    values: dict[str, list[float]] = {}
    for _ in range(repeats):  # interleaved: a slow spell of the machine hits all alike
        for way, run in ways.items():
            began = time.perf_counter()
            values[way] = run()
            seconds[way].append(time.perf_counter() - began)
    median = {way: statistics.median(times) for way, times in seconds.items()}
    truth = np.array(values["cvxpy, Clarabel"])
    return [
        {
            "system": name,
            "way": way,
            "ms_per_solve": 1e3 * median[way] / len(points),
            "ratio_to_ours": median[way] / median["ours"],
            "deviation": _finite(np.abs(np.array(values[way]) / truth - 1).max()),
        }
        for way in ways
    ]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def main() -> None:
    """Measure, print."""
    if "CVXOPT" not in cp.installed_solvers():
        sys.exit('CVXOPT is not installed: python -m pip install "auv-cosim[bench]"')
    rows = [row for name, repeats in (("paper", 5), ("auv", 1)) for row in rows_of(name, repeats)]
    if "--json" in sys.argv:
        print(json.dumps({"benchmark": "design", "rows": rows}, indent=1, allow_nan=False))
        return
    table = Table(title="Least gamma at given k1, k2; medians", title_justify="left")
    for column in ("system", "way", "ms per solve", "ratio to ours", "deviation of gamma"):
        table.add_column(column, justify="left" if column in {"system", "way"} else "right")
    for row in rows:
        deviation = "no solution" if row["deviation"] is None else f"{row['deviation']:.1e}"
        table.add_row(
            row["system"],
            row["way"],
            f"{row['ms_per_solve']:.1f}",
            f"{row['ratio_to_ours']:.1f}",
            deviation,
        )
    Console().print(table)


if __name__ == "__main__":
    main()
