"""Two scalars in an algebraic loop: their FMUs, and what they do, worked out by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scalar import scalar_fmu
from shared import made_once

from cosim.master import EngineName

ENGINES: tuple[EngineName, ...] = ("python", "kernel")
PAIR = {
    "p": {"a": -1.0, "b": 1.5, "x0": 1.0, "e": 0.3},
    "q": {"a": -0.5, "b": -2.0, "x0": -0.5, "e": 0.2, "c": 2.0},
}
LOOP = (("p.y", "q.u"), ("q.y", "p.u"))
STEP, STOP, POINTS = 0.1, 1.0, 11


def declared() -> Path:
    """The FMU of both, made once."""
    return made_once("scalar", scalar_fmu) / "scalar-11.fmu"


def undeclared() -> Path:
    """The same, but it does not declare which outputs depend on the input."""

    def make(folder: Path) -> None:
        scalar_fmu(folder, declared=False)

    return made_once("scalar-undeclared", make) / "scalar-11-undeclared.fmu"


def output(name: str, x: float, u: float) -> float:
    return PAIR[name].get("c", 1.0) * x + PAIR[name]["e"] * u


def advanced(name: str, x: float, u: float, h: float = STEP) -> float:
    a, b = PAIR[name]["a"], PAIR[name]["b"]
    return math.exp(a * h) * x + math.expm1(a * h) / a * b * u


def settled() -> tuple[float, float]:
    """y of p and q at the start, from the two linear equations."""
    (cp, ep), (cq, eq) = ((PAIR[n].get("c", 1.0), PAIR[n]["e"]) for n in PAIR)
    solved = np.linalg.solve([[1.0, -ep], [-eq, 1.0]], [cp * PAIR["p"]["x0"], cq * PAIR["q"]["x0"]])
    return float(solved[0]), float(solved[1])


def cut_at_p() -> dict[str, list[float]]:
    """The loop with q.y -> p.u one step late, Jacobi: by hand."""
    x = {name: given["x0"] for name, given in PAIR.items()}
    rows: dict[str, list[float]] = {"p.u": [], "q.u": [], "p.y": [], "q.y": []}
    u = settled()[1]
    for _ in range(POINTS):
        y = output("p", x["p"], u)
        z = output("q", x["q"], y)
        for name, value in (("p.u", u), ("p.y", y), ("q.u", y), ("q.y", z)):
            rows[name].append(value)
        x = {"p": advanced("p", x["p"], u), "q": advanced("q", x["q"], y)}
        u = z
    return rows
