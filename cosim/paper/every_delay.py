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
from fractions import Fraction
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.models import DelaySystem
from cosim.paper.exact import fractions, is_positive
from cosim.paper.lmi import mirrored, solve, symmetric_expression, unit_block, zeros

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


def _blocks(s: Any, X: Any, Y: Any, Q: Any, eps: Any, gamma: Any) -> list[list[Any]]:
    """Return the upper block rows of the matrix above, for fractions and for cvxpy."""
    n, q = s["C"].shape
    p, r = s["D"].shape[0], s["H"].shape[0]
    G = s["A"] @ X + s["B"] @ Y
    return [
        [
            G + G.T + Q + eps * (s["E"] @ s["E"].T),
            s["A1"] @ X,
            s["C"],
            (s["D"] @ X + s["D2"] @ Y).T,
            X @ s["H"].T,
        ],
        [-Q, zeros(n, q), zeros(n, p), X @ s["H1"].T],
        [-gamma * unit_block(q), s["D1"].T, zeros(q, r)],
        [-gamma * unit_block(p), zeros(p, r)],
        [-eps * unit_block(r)],
    ]


def _matrices(system: DelaySystem) -> dict[str, Any]:
    named = {name: getattr(system, name) for name in ("A", "B", "C", "D", "D1", "D2", "E", "H")}
    return {**named, "A1": system.delays[0].A, "H1": system.delays[0].H}


def _solve(
    system: DelaySystem, K: NDArray[np.float64] | None, gamma: float | None
) -> dict[str, Any] | None:
    """Solve for the least gamma, or at a given one for the largest margin; None if infeasible."""
    n, m = system.B.shape
    X, Q = (cp.Variable((n, n), symmetric=True) for _ in range(2))
    eps, t = cp.Variable(), cp.Variable()
    Y: Any = cp.Variable((m, n)) if K is None else K @ X
    level: Any = cp.Variable() if gamma is None else gamma
    lmi = symmetric_expression(_blocks(_matrices(system), X, Y, Q, eps, level))
    rows = np.eye(lmi.shape[0])
    bounds = [lmi << (0 if gamma is None else -t) * rows]
    bounds += [X >> 0, X << 1e3 * np.eye(n), t <= 1]
    goal = cp.Minimize(level) if gamma is None else cp.Maximize(t)
    if not solve(goal, bounds) or (gamma is not None and not float(np.asarray(t.value)) > 0):
        return None
    values = {
        name: np.asarray(V.value, dtype=np.float64)
        for name, V in zip("XYQ", (X, Y, Q), strict=True)
    }
    return {
        **values,
        "eps": float(np.asarray(eps.value)),
        "gamma": float(np.asarray(level.value)) if gamma is None else gamma,
    }


def _proved(
    system: DelaySystem, K: NDArray[np.float64], gamma: float, point: dict[str, Any]
) -> bool:
    X, Q = (fractions(point[name]) for name in ("X", "Q"))
    X, Q = (X + X.T) / 2, (Q + Q.T) / 2
    exact = {name: fractions(M) for name, M in _matrices(system).items()}
    eps, level = Fraction(point["eps"]), Fraction(gamma)
    lmi = np.block(mirrored(_blocks(exact, X, fractions(K) @ X, Q, eps, level)))
    return is_positive(-lmi) and is_positive(X)
