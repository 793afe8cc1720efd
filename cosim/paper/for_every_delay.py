"""A gain and a gamma that are certified for every constant delay at once (see Table 2).

With V = x'Px + int_{t-d}^t x'Qx (Theorem 1's functional without R, which is where d enters),
X = P^-1, Qbar = XQX, Y = KX and Lemma 1 for the uncertainty, V' + z'z/gamma - gamma w'w < 0
follows for every d >= 0 from

    [ G + G' + Qbar + eps E E'   A1 X    C         (D X + D2 Y)'   X H'   ]
    [ *                          -Qbar   0         0               X H1'  ]
    [ *                          *       -gamma I  D1'             0      ]  < 0,  G = A X + B Y
    [ *                          *       *         -gamma I        0      ]
    [ *                          *       *         *               -eps I ]

and X > 0. It is solved, then proved in fractions for the gain as its doubles, with Y := K X.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.hinf.exact import exact_matrix
from cosim.hinf.lmi import in_cvxpy, variables_of
from cosim.hinf.theorems import Inequality, exact_unknowns, first_failure, itself, shapes_of
from cosim.models import DelaySystem
from cosim.paper.lmi import solve

_ABOVE_LEAST = (2e-6, 1e-5, 1e-4, 1e-3, 1e-2)
_DECIMALS = 6


@dataclass(frozen=True)
class EveryDelay:
    """A bound of the gain that is certified for every constant delay.

    gamma : bound of the gain from w to z, uncertainty included.
    K : (m, n) the gain, as its doubles.
    """

    gamma: float
    K: NDArray[np.float64]


def every_delay(system: DelaySystem, gain: ArrayLike | None = None) -> EveryDelay | None:
    """Find the least gamma that is proved for every constant delay; None if there is none.

    Parameters
    ----------
    system : Eq. (7) with one delay and immediate feedback, uncertainty, w and z.
    gain : (m, n); None to design one.
    """
    K = None if gain is None else np.array(gain, dtype=np.float64)
    least = _solve(system, K, None)
    if least is None:
        return None
    for share in _ABOVE_LEAST:
        gamma = float(f"{least['gamma'] * (1 + share):.7g}")
        tried = _gain(system, gamma) if K is None else K
        if tried is None:
            continue
        point = _solve(system, tried, gamma)
        if point is not None and _proved(system, tried, gamma, point):
            return EveryDelay(gamma, tried)
    return None


def _gain(system: DelaySystem, gamma: float) -> NDArray[np.float64] | None:
    first = _solve(system, None, gamma)
    if first is None:
        return None
    K = np.linalg.solve(first["X"], first["Y"].T).T
    return np.asarray(np.round(K, _DECIMALS) + 0.0, dtype=np.float64)


def _inequalities(system: DelaySystem, K: NDArray[np.float64] | None) -> list[Inequality]:
    """Return minus the matrix above and X, in X, Q, eps, gamma and Y, or for Y = K X of a gain."""
    n, q = system.C.shape
    sizes = {"x": n, "x_d": n, "w": q, "z": len(system.D), "h": len(system.H)}
    form = Inequality("-Phi", sizes)
    x, delayed, w, z, h = map(form.row, sizes)
    gain = None if K is None else exact_matrix(K)
    acting = ((system.A, system.B, x), (system.D, system.D2, z))
    for of_x, of_u, row in acting:
        form.twice("X", exact_matrix(of_x).transpose() * row, x, -1)
        M = exact_matrix(of_u) if gain is None else exact_matrix(of_u) * gain
        form.twice("Y" if gain is None else "X", M.transpose() * row, x, -1)
    form.twice("X", exact_matrix(system.delays[0].A).transpose() * x, delayed, -1)
    form.twice("X", exact_matrix(system.H).transpose() * h, x, -1)
    form.twice("X", exact_matrix(system.delays[0].H).transpose() * h, delayed, -1)
    form.twice(None, x, exact_matrix(system.C) * w, -1)
    form.twice(None, z, exact_matrix(system.D1) * w, -1)
    form.square("Q", x, -1)
    form.square("Q", delayed)
    form.number("eps", exact_matrix(system.E).transpose() * x, -1)
    for number, row in (("eps", h), ("gamma", w), ("gamma", z)):
        form.number(number, row)
    return [form, itself("X", n)]


def _solve(
    system: DelaySystem, K: NDArray[np.float64] | None, gamma: float | None
) -> dict[str, Any] | None:
    """Solve for the least gamma, or at a given one for the largest margin; None if infeasible."""
    inequalities, n, t = _inequalities(system, K), len(system.A), cp.Variable()
    unknowns = variables_of(inequalities)
    if gamma is not None:
        unknowns["gamma"] = gamma
    lmi = in_cvxpy(inequalities[0], unknowns)
    bounds = [lmi >> (0 if gamma is None else t) * np.eye(lmi.shape[0])]
    bounds += [unknowns["X"] >> 0, unknowns["X"] << 1e3 * np.eye(n), t <= 1]
    goal = cp.Minimize(unknowns["gamma"]) if gamma is None else cp.Maximize(t)
    if not solve(goal, bounds) or (gamma is not None and not float(np.asarray(t.value)) > 0):
        return None
    return {name: np.asarray(getattr(x, "value", x)) for name, x in unknowns.items()}


def _proved(
    system: DelaySystem, K: NDArray[np.float64], gamma: float, point: dict[str, Any]
) -> bool:
    inequalities = _inequalities(system, K)
    values = exact_unknowns(shapes_of(inequalities), {**point, "gamma": gamma})
    return first_failure(inequalities, values) is None
