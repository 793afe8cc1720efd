"""What a design costs as the states become more: beside one solve of the same LMI in cvxpy.

    python -m tests.benchmarks.design_sizes [N ...] [--json]

Chains of N states (default 2 4 8 12), steered at both ends, whose least gamma asks for a gain
without bound. In one run, in CPU seconds:

* design: `cosim design`, its proof and the start of its process included;
* cvxpy: the LMI of Theorem 2 at one pair k1 = -k2, modelled and solved by Clarabel.

Beside them the gamma of the design, and the best certified gamma of the gains of cvxpy at three
pairs with weights 0, .01 and .1 on |Y|, each analysed, where no entry is above 1000. Exponents are
slopes of log seconds over log N, by least squares; null for a single N.
"""

from __future__ import annotations

import json
import math
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np
from rich.table import Table

from cosim.core import InputError
from cosim.hinf import analyse, as_cvxpy
from cosim.models import DelaySystem, Matrix

if __package__ == "tests.benchmarks":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hinf"))
from varied_systems import steered_chain

from tests.benchmarks._show import show

PAIRS, WEIGHTS = (0.1, 0.5, 1.0), (0.0, 0.01, 0.1)
K_LIMIT = 1e3
SIZES = (2, 4, 8, 12)
COLUMNS = ("n", "design_s", "cvxpy_s", "ratio", "gamma", "gamma_of_cvxpy", "largest_K")


def gains_by_cvxpy(
    system: DelaySystem, pairs: Sequence[float] = PAIRS
) -> tuple[list[Matrix], float]:
    """Return the gains (m, n) that a user of cvxpy finds, and the CPU seconds of one solve."""
    found, seconds = [], []
    for k in pairs:
        for weight in WEIGHTS:
            began = time.process_time()
            asked = as_cvxpy(system, (-k,), (k,))
            price = weight * cp.norm(asked.Y, "fro")
            problem = cp.Problem(cp.Minimize(asked.gamma + price), asked.problem.constraints)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # an inaccurate gain is analysed like any other
                problem.solve(solver="CLARABEL")
            seconds.append(time.process_time() - began)
            with suppress(InputError):  # it has found nothing
                found.append(asked.gain())
    return [K for K in found if np.abs(K).max() <= K_LIMIT], float(np.median(seconds))


def row_of(n: int, folder: Path) -> dict[str, Any]:
    """Return the figures of the chain of n states."""
    system, file = steered_chain(n), folder / f"{n}.toml"
    matrices = {x: getattr(system, x) for x in ("A", "B", "C", "D", "D2")}
    matrices["A1"] = system.delays[0].A
    lines = [f"{name} = {value.tolist()}" for name, value in matrices.items()]
    file.write_text("\n".join(["[system]", *lines, f"d = {system.delays[0].d}", ""]))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "cosim", "design", str(file), "--json"]
    done = subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - ourselves
    design = json.loads(done.stdout)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    gains, one_solve = gains_by_cvxpy(system)
    others = (analyse(system, K).gamma for K in gains)
    figures = (n, spent, one_solve, spent / one_solve, design["gamma"])
    best = min((x for x in others if x is not None), default=None)
    return dict(zip(COLUMNS, (*figures, best, float(np.abs(design["K"]).max())), strict=True))


def exponent(rows: list[dict[str, Any]], name: str) -> float | None:
    """Return the slope of log seconds over log n; None for a single n."""
    if len(rows) < 2:
        return None
    n, seconds = ([math.log(row[key]) for row in rows] for key in ("n", name))
    return float(np.polyfit(n, seconds, 1)[0])


def main() -> None:
    """Measure, print."""
    sizes = [int(x) for x in sys.argv[1:] if x != "--json"] or list(SIZES)
    with tempfile.TemporaryDirectory() as folder:
        rows = [row_of(n, Path(folder)) for n in sizes]
    exponents = {name: exponent(rows, f"{name}_s") for name in ("design", "cvxpy")}
    words = ", ".join(f"{name} {x:.2f}" for name, x in exponents.items() if x is not None)
    title = f"Designs of chains; exponents in n: {words or 'of one n, none'}"
    table = Table(title=title, title_justify="left")
    for column in COLUMNS:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(*("-" if row[x] is None else f"{row[x]:.4g}" for x in COLUMNS))
    show(table, {"rows": rows, "exponents": exponents})


if __name__ == "__main__":
    main()
