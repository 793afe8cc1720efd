"""Unstable loops that Eq. (14) accepts as stable if it is taken as printed.

The matrices below are this project's. A solver finds X, Rbar, Qbar for the printed form, and
-Omega (as printed) > 0 is proved for them in fractions. The rightmost root of the loop shows that
it is unstable all the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cvxpy as cp
import numpy as np
from scipy import optimize

from cosim.hinf import spectral_abscissa
from cosim.hinf.delay_lti import ClosedLoop
from cosim.models import paper_example
from cosim.paper.exact import Exact, decimals, fractions, is_positive
from cosim.paper.lmi import mirrored, solve, symmetric_expression
from cosim.paper.omega import PRINTED, Data, Reading, Unknowns, omega
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
    def data(self) -> Data:
        """The loop with the symbols of Eq. (7), with C = D = I and without uncertainty."""
        n = len(self.A)
        one, none = np.eye(n), np.zeros((n, 1))
        return Data(
            A=np.array(self.A),
            A1=np.array(self.A1),
            B=none,
            C=one,
            D=one,
            D1=0 * one,
            D2=none,
            E=none,
            H=none.T,
            H1=none.T,
            d=self.d,
            k1=self.k1,
            k2=self.k2,
            gamma=self.gamma,
        )

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


def misprint_rows() -> list[Row]:
    """Return one row per counterexample."""
    return [_row(example) for example in COUNTEREXAMPLES]


def _row(example: Counterexample) -> Row:
    accepted, root = accepts(example.data, example.reading), example.abscissa
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


def accepts(s: Data, reading: Reading) -> bool:
    """Return whether this reading of Eq. (14) is proved feasible."""
    _, point = margin(s, reading)
    if point is None:
        return False
    exact = s.each(decimals)
    v = Unknowns(
        _symmetric(point.X),
        _symmetric(point.R),
        _symmetric(point.Q),
        fractions(point.Y),
        fractions(point.eps).item(),
    )
    Omega: Exact = np.block(mirrored(omega(exact, v, reading)))
    return all(map(is_positive, (-Omega, v.X, v.R, v.Q)))


def margin(s: Data, reading: Reading) -> tuple[float, Unknowns | None]:
    """Find the largest t with Omega <= -t I, X, Qbar >= t I, X <= 1000 I, t <= 1, and the point.

    This is not a proof. A negative t means that the solver finds no solution.
    """
    (n, m), t = s.B.shape, cp.Variable()
    X, R, Q = (cp.Variable((n, n), symmetric=True) for _ in range(3))
    Y, eps = cp.Variable((m, n)), cp.Variable()
    Omega = symmetric_expression(omega(s, Unknowns(X, R, Q, Y, eps), reading))
    bounds = [Omega << -t * np.eye(Omega.shape[0]), t <= 1]
    bounds += [X >> t * np.eye(n), Q >> t * np.eye(n), X << _LARGEST_X * np.eye(n)]
    if not solve(cp.Maximize(t), bounds):
        return -1.0, None
    values = [np.asarray(V.value, dtype=np.float64) for V in (X, R, Q, Y, eps)]
    return float(np.asarray(t.value)), Unknowns(*values)


def greatest_delay_as_printed(gamma: float, near: float) -> float:
    """Compute the greatest feasible delay of Eq. (14) as printed, for section 5 [s].

    k1, k2 are the printed ones; `near` is a first guess [s].
    """
    s = paper_example
    letters = ("A", "A1", "B", "C", "D", "D1", "D2", "E", "H", "H1", "d")
    given = {letter: getattr(s, letter) for letter in letters}
    data = Data(**given, k1=s.K1, k2=s.K2, gamma=gamma).each(np.array)

    def at(d: float) -> float:
        return margin(replace(data, d=d), PRINTED)[0]

    low, high = near / 1.25, near * 1.25
    while at(low) < 0:
        low /= 2
    while at(high) > 0:
        high *= 2
    return float(optimize.brentq(at, low, high, xtol=1e-6))


def _symmetric(matrix: Any) -> Exact:
    exact = fractions(matrix)
    half: Exact = (exact + exact.T) / 2
    return half


def _text(rows: tuple[tuple[float, ...], ...]) -> str:
    if len(rows) == 1:
        return f"{rows[0][0]:g}"
    return "[" + "; ".join(" ".join(f"{x:g}" for x in row) for row in rows) + "]"
