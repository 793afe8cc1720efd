"""Rows on the stability of section 5's loop with the printed gain."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import optimize

from cosim.hinf import characteristic_roots, close
from cosim.models import DelaySystem, paper_example as printed
from cosim.paper.every_delay import EveryDelay
from cosim.paper.row import EXAMPLE, How, Row, Verdict


def stability_rows(system: DelaySystem, everywhere: EveryDelay | None) -> list[Row]:
    """At the printed delay, and at every other; `everywhere`: the printed K for all of them."""
    loop = close(system, [printed.PRINTED_K])
    roots = characteristic_roots(loop, 3)
    radius = largest_radius(loop.A[0], loop.A[1])
    stable = bool(roots[0].real < 0)
    holds_everywhere = stable and radius < 1 and everywhere is not None
    proof = "no proof" if everywhere is None else f"γ = {everywhere.gamma:.7g} certified"
    return [
        Row(
            EXAMPLE,
            "(i) the closed loop with the printed K",
            "asymptotically stable at d = 0.3 s",
            f"rightmost roots {_roots(roots)}",
            How.COMPUTED,
            Verdict.HOLDS if stable else Verdict.DOES_NOT,
            "Exact roots of the nominal loop; with every admissible F(t) it is certified above.",
            value=float(roots[0].real),
        ),
        Row(
            EXAMPLE,
            "the closed loop with the printed K at other delays",
            "stable, at d = 0.3 s",
            f"stable for every delay: max ρ((jωI - A_K)⁻¹A1) = {radius:.4f} < 1; with any F(t), "
            f"{proof} for every constant delay",
            How.COMPUTED if everywhere is None else How.CERTIFIED,
            Verdict.HOLDS if holds_everywhere else Verdict.DOES_NOT,
            "The delayed part is weak against the rest, so that this loop has no greatest delay "
            "at all.",
            value=radius,
        ),
    ]


def largest_radius(A: Any, A1: Any) -> float:
    """max over omega >= 0 of the spectral radius of (j omega I - A)^-1 A1."""
    one = np.eye(A.shape[0])

    def radius(omega: float) -> float:
        return float(np.abs(np.linalg.eigvals(np.linalg.solve(1j * omega * one - A, A1))).max())

    a, a1 = float(np.linalg.norm(A, 2)), float(np.linalg.norm(A1, 2))
    grid = np.linspace(0.0, 2 * (a + a1), 401)
    beyond = a1 / (grid[-1] - a)  # a bound of what follows
    best = int(np.argmax([radius(omega) for omega in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found: Any = optimize.minimize_scalar(
        lambda omega: -radius(omega), bounds=(low, high), method="bounded"
    )
    return max(radius(float(grid[best])), -float(found.fun), float(beyond))


def _roots(roots: Any) -> str:
    roots_text: list[str] = []
    for root in roots:
        text = f"{root.real:.3f}" + (f" ± {abs(root.imag):.3f}j" if abs(root.imag) > 1e-9 else "")
        if text not in roots_text:
            roots_text.append(text)
    return ", ".join(roots_text)
