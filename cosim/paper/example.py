"""Rows of section 5: gamma = 5 at d = 0.3 s, the printed gain, and its stability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from cosim.core import Progress
from cosim.hinf import Result, analyse, characteristic_roots, design, hinf_norm
from cosim.hinf.delay_lti import ClosedLoop, NormResult, close
from cosim.models import DelaySystem, paper_example as printed
from cosim.paper.for_every_delay import EveryDelay
from cosim.paper.greatest_delays import CHOSEN_GAMMA, ORDER, direct_term
from cosim.paper.row import EXAMPLE, How, Row, Verdict
from cosim.paper.simulation import simulate

_WORST_END = 40.0
"""Length of the run at the worst frequency [s]."""


@dataclass(frozen=True, eq=False)
class Example:
    """Designs and analyses of section 5.

    least, searched : designs at the printed k1, k2, and at the best k1, k2 found.
    by_theorem_2 : the printed K at the printed k1, k2.
    by_theorem_1, bessel_legendre : the printed K by Theorem 1, and by Bessel-Legendre of `ORDER`.
    """

    system: DelaySystem
    least: Result
    searched: Result
    by_theorem_2: Result
    by_theorem_1: Result
    bessel_legendre: Result


def solve_example(report_progress: Progress) -> Example:
    """Compute all designs and analyses of section 5."""
    system, k1, k2 = printed.system(), (printed.K1,), (printed.K2,)
    K = [printed.PRINTED_K]
    report_progress("section 5, design", 0.0)
    least = design(system, k1, k2, order=None)
    report_progress("section 5, search", 0.3)
    searched = design(system, k1, k2, search=True, order=None)
    report_progress("section 5, the printed gain", 0.7)
    return Example(
        system,
        least,
        searched,
        design(system, k1, k2, gain=K, order=None),
        analyse(system, K, order=0),
        analyse(system, K, order=ORDER),
    )


def example_rows(known: Example, everywhere: EveryDelay | None) -> list[Row]:
    """Return the rows of section 5; `everywhere`: the printed K at every delay."""
    return [
        _readings(known.system),
        _index(),
        *_gamma(known),
        *_printed_gain(known),
        _worst_run(known),
        *stability_rows(known.system, everywhere),
    ]


def _readings(s: DelaySystem) -> Row:
    n, q, p = s.A.shape[0], s.C.shape[1], s.D1.shape[0]
    return Row(
        EXAMPLE,
        "the data",
        "D = -1, E = -0.1, F(t) = 0.5 sin t; w with two components in ẇ = Gw",
        f"D = -I, E = -0.1 I, F = 0.5 sin t I of size {n}; C is {n} × {q} and D1 {p} × {q}, so w "
        "is one component of the exosystem",
        None,
        Verdict.CORRECTED,
        "Scalars are printed where matrices are needed, and C has one column where ẇ = Gw has two "
        "rows. This is the reading used here.",
    )


def _index() -> Row:
    eigenvalues = np.linalg.eigvals(np.array(printed.G))
    damping = float(np.abs(eigenvalues.real).max())
    return Row(
        EXAMPLE,
        "the performance index J and ẇ = Gw",
        "J over [0, ∞), ‖z‖ ≤ γ‖w‖",
        f"G has the eigenvalues ±{abs(eigenvalues[0].imag):g}j, real parts {damping:g}: ∫wᵀw grows "
        "without end",
        How.COMPUTED,
        Verdict.CORRECTED if damping == 0 else Verdict.DOES_NOT,
        "An undamped w has no norm over [0, ∞). The proof of Theorem 1 bounds every finite "
        "horizon, and that is what is measured here.",
    )


def _gamma(known: Example) -> list[Row]:
    witness = direct_term(known.system, printed.GAMMA)
    least, best = known.least, known.searched
    D1 = known.system.D1
    floor = float(np.linalg.norm(D1, 2))
    return [
        Row(
            EXAMPLE,
            CHOSEN_GAMMA,
            "feasible",
            f"vᵀΩv = {witness} for v = (w, z) = (1, D1/γ): Ω < 0 is impossible",
            How.CERTIFIED,
            Verdict.IMPOSSIBLE if witness >= 0 else Verdict.HOLDS,
            f"‖D1‖ = ‖({_entries(D1)})‖ = {floor:g}, and at high frequency the gain from w to z is "
            f"that of D1 whatever K is. Every γ of the theorem is greater than {floor:g}.",
            printed_value=printed.GAMMA,
            value=float(witness),
        ),
        Row(
            EXAMPLE,
            "the least γ at k1 = 0.6, k2 = 0.2",
            "none: γ = 5 is chosen",
            f"{least.gamma:.7g} certified, {least.least_gamma:.7g} by the solver",
            How.CERTIFIED,
            Verdict.NOT_COMPARABLE,
            f"For K = ({_numbers(least.K)}).",
            value=least.gamma,
        ),
        Row(
            EXAMPLE,
            "the least γ over k1, k2",
            "none: k1 = 0.6, k2 = 0.2 are chosen",
            f"{best.gamma:.7g} at k1 = {best.k1[0]:.4g}, k2 = {best.k2[0]:.4g}",
            How.CERTIFIED,
            Verdict.NOT_COMPARABLE,
            f"Not 5, but arbitrarily close to it; K = ({_numbers(best.K)}).",
            value=best.gamma,
        ),
    ]


def _printed_gain(known: Example) -> list[Row]:
    one, two, sharp = known.by_theorem_1, known.by_theorem_2, known.bessel_legendre
    norm = peak_of(close(known.system, [printed.PRINTED_K]))
    K = f"K = ({_numbers(np.array(printed.PRINTED_K))})"
    return [
        Row(
            EXAMPLE,
            "the gain K",
            K,
            f"at these k1, k2 it is certified for γ = {two.gamma:.6g}, by Theorem 1 for "
            f"{_six(one.gamma)}, by Bessel-Legendre of order {ORDER} for {_six(sharp.gamma)}",
            How.CERTIFIED,
            Verdict.IMPOSSIBLE,
            "No gain can be derived for γ = 5 by Theorem 2. The text does not say at which "
            "feasible point the solver stopped.",
            printed_value=printed.GAMMA,
            value=one.gamma,
            follows_from=(CHOSEN_GAMMA,),
        ),
        Row(
            EXAMPLE,
            "(ii) with the printed K: ‖z‖ ≤ 5‖w‖",
            "5",
            f"exact norm of the nominal loop {norm.value:.6f}, at {norm.frequency:.3f} rad/s",
            How.COMPUTED,
            Verdict.DOES_NOT if norm.value > printed.GAMMA else Verdict.HOLDS,
            "Without any uncertainty a sine of this frequency is already amplified by more than 5.",
            printed_value=printed.GAMMA,
            value=norm.value,
            follows_from=(CHOSEN_GAMMA,),
        ),
    ]


def _worst_run(known: Example) -> Row:
    frequency = peak_of(close(known.system, [printed.PRINTED_K])).frequency
    run = simulate(
        initial=(0.0, 0.0),
        frequency=frequency,
        amplitude=0.0,
        end=_WORST_END,
        points=2001,
        step=0.02,
    )
    paper = simulate(initial=(0.0, 0.0), frequency=1.0, amplitude=0.5, end=_WORST_END, points=401)
    return Row(
        EXAMPLE,
        "(ii) in time, from rest",
        "at most 5",
        f"{run.gain:.5f} under w = sin {frequency:.3f} t; {paper.gain:.4f} under the paper's own "
        "w = sin t, F = 0.5 sin t",
        How.MEASURED,
        Verdict.DOES_NOT if run.gain > printed.GAMMA else Verdict.HOLDS,
        f"√(∫zᵀz / ∫wᵀw) over {_WORST_END:g} s. The paper's own disturbance does not show it.",
        printed_value=printed.GAMMA,
        value=run.gain,
        follows_from=(CHOSEN_GAMMA,),
    )


def peak_of(loop: ClosedLoop) -> NormResult:
    """Return the exact norm of a stable loop."""
    norm = hinf_norm(loop)
    if norm is None:
        raise ArithmeticError("expected a stable loop")
    return norm


def _numbers(K: Any) -> str:
    return " ".join(f"{x:.4f}" for x in np.ravel(K))


def _entries(matrix: Any) -> str:
    return ", ".join(f"{x:g}" for x in np.ravel(matrix))


def _six(value: float | None) -> str:
    return "no γ" if value is None else f"{value:.6g}"


def stability_rows(system: DelaySystem, everywhere: EveryDelay | None) -> list[Row]:
    """Return the rows on stability, at the printed delay and at every other delay."""
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
            "The delayed part is weak compared with the rest, so this loop has no greatest delay.",
            value=radius,
        ),
    ]


def largest_radius(A: Any, A1: Any) -> float:
    """Return the maximum over omega >= 0 of the spectral radius of (j omega I - A)^-1 A1."""
    one = np.eye(A.shape[0])

    def radius(omega: float) -> float:
        return float(np.abs(np.linalg.eigvals(np.linalg.solve(1j * omega * one - A, A1))).max())

    a, a1 = float(np.linalg.norm(A, 2)), float(np.linalg.norm(A1, 2))
    grid = np.linspace(0.0, 2 * (a + a1), 401)
    beyond = a1 / (grid[-1] - a)  # a bound beyond the grid
    best = int(np.argmax([radius(omega) for omega in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    least: Any = optimize.minimize_scalar(
        lambda omega: -radius(omega), bounds=(low, high), method="bounded"
    )
    return max(radius(float(grid[best])), -float(least.fun), float(beyond))


def _roots(roots: Any) -> str:
    roots_text: list[str] = []
    for root in roots:
        text = f"{root.real:.3f}" + (f" ± {abs(root.imag):.3f}j" if abs(root.imag) > 1e-9 else "")
        if text not in roots_text:
            roots_text.append(text)
    return ", ".join(roots_text)
