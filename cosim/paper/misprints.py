"""Unstable loops that Eq. (14) accepts as stable if it is taken as printed.

The matrices below are this project's. A solver finds X, Rbar, Qbar for the printed form, and
-Omega (as printed) > 0 is proved for them in fractions. The rightmost root of the loop shows that
it is unstable all the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np
from scipy import optimize

from cosim.hinf import spectral_abscissa
from cosim.hinf.delay_lti import ClosedLoop
from cosim.hinf.lmi import in_cvxpy, variables_of
from cosim.hinf.theorems import Inequality, exact_unknowns, first_failure, itself, shapes_of
from cosim.models import Delay, DelaySystem, paper_example
from cosim.paper.lmi import solve
from cosim.paper.omega import PRINTED, Case, Reading, minus_omega_as_read
from cosim.paper.row import THEOREM_2, How, Row, Verdict

_LARGEST_X = 1e3


@dataclass(frozen=True)
class Counterexample:
    """An unstable loop x' = A x + A1 x(t-d) without control that a printed form accepts.

    name : the misprinted block.
    reading : Eq. (14) with this misprint alone.
    """

    name: str
    reading: Reading
    A: tuple[tuple[float, ...], ...]
    A1: tuple[tuple[float, ...], ...]
    d: float
    k1: float
    k2: float
    gamma: float = 5.0

    @property
    def case(self) -> Case:
        """The loop with C = D = I and without control and uncertainty."""
        n = len(self.A)
        system = DelaySystem(self.A, None, np.eye(n), np.eye(n), delays=[Delay(self.d, self.A1)])
        return Case(system, self.k1, self.k2, self.gamma)

    @property
    def abscissa(self) -> float:
        """Real part of the rightmost root [1/s]."""
        return float(spectral_abscissa(ClosedLoop([self.A, self.A1], [0.0, self.d])))


COUNTEREXAMPLES = (
    Counterexample("Ω12", Reading(omega_12=False), ((-1.0,),), ((2.0,),), 0.3, -0.2, 0.2),
    Counterexample(
        "Ω25",
        Reading(omega_25=False),
        ((1.0, 2.0), (-1.0, 1.0)),
        ((-3.0, 2.0), (-2.0, -2.0)),
        0.2,
        -5.0,
        5.0,
        20.0,
    ),
)
"""One loop for each misprinted block of Eq. (14)."""


def misprint_rows() -> list[Row]:
    """Return one row per counterexample."""
    return [_row(example) for example in COUNTEREXAMPLES]


def _row(example: Counterexample) -> Row:
    accepted, root = accepts(example.case, example.reading), example.abscissa
    loop = f"A = {_text(example.A)}, A1 = {_text(example.A1)}, d = {example.d:g}"
    return Row(
        THEOREM_2,
        f"Theorem 2 with {example.name} as printed",
        "(14) feasible, so the loop is stable",
        f"{loop}: (14) is {'feasible' if accepted else 'not proved feasible'} at "
        f"k1 = {example.k1:g}, k2 = {example.k2:g}, γ = {example.gamma:g}; "
        f"the rightmost root is {root:+.4f}",
        How.CERTIFIED if accepted else How.COMPUTED,
        Verdict.IMPOSSIBLE if accepted and root > 0 else Verdict.HOLDS,
        "As printed, the theorem accepts a loop that diverges (no control, C = D = I).",
        value=root,
        follows_from=(f"Eq. (14): {example.name}",),
    )


def accepts(case: Case, reading: Reading) -> bool:
    """Return whether this reading of Eq. (14) is proved feasible."""
    _, point = margin(case, reading)
    if point is None:
        return False
    inequalities = _inequalities(case, reading)
    unknowns = exact_unknowns(shapes_of(inequalities), point)
    return first_failure(inequalities, unknowns) is None


def margin(case: Case, reading: Reading) -> tuple[float, dict[str, Any] | None]:
    """Find the largest t with Omega <= -t I, X, Qbar >= t I, X <= 1000 I, t <= 1, and the point.

    This is not a proof. A negative t means that the solver finds no solution.
    """
    inequalities, t = _inequalities(case, reading), cp.Variable()
    unknowns = variables_of(inequalities) | {"gamma": case.gamma}
    X, Q, n = unknowns["X"], unknowns["Q"], len(case.system.A)
    lmi = in_cvxpy(inequalities[0], unknowns)
    bounds = [lmi >> t * np.eye(lmi.shape[0]), t <= 1]
    bounds += [X >> t * np.eye(n), Q >> t * np.eye(n), X << _LARGEST_X * np.eye(n)]
    if not solve(cp.Maximize(t), bounds):
        return -1.0, None
    values = {name: np.asarray(getattr(x, "value", x)) for name, x in unknowns.items()}
    return float(np.asarray(t.value)), values


def _inequalities(case: Case, reading: Reading) -> list[Inequality]:
    n = len(case.system.A)
    return [minus_omega_as_read(case, reading), *(itself(name, n) for name in "XQR")]


def greatest_delay_as_printed(gamma: float, near: float) -> float:
    """Compute the greatest feasible delay of Eq. (14) as printed, for section 5 [s].

    k1, k2 are the printed ones; `near` is a first guess [s].
    """
    s = paper_example

    def at(d: float) -> float:
        return margin(Case(s.system(d), s.K1, s.K2, gamma), PRINTED)[0]

    low, high = near / 1.25, near * 1.25
    while at(low) < 0:
        low /= 2
    while at(high) > 0:
        high *= 2
    return float(optimize.brentq(at, low, high, xtol=1e-6))


def _text(rows: tuple[tuple[float, ...], ...]) -> str:
    if len(rows) == 1:
        return f"{rows[0][0]:g}"
    return "[" + "; ".join(" ".join(f"{x:g}" for x in row) for row in rows) + "]"
