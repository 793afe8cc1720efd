"""Systems and solutions that several tests of the certificate start from.

The solutions come from the solver's LMI, which the certificate shares no code with.
"""

from __future__ import annotations

import warnings
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from cosim.hinf.certificate.proof import Variables
from cosim.hinf.lmi.theorem_2_lmi import omega, unknowns
from cosim.models.delay_system import Delay, DelaySystem

Array = NDArray[np.float64]


def value(expression: Any) -> Array:
    """A cvxpy expression's value, or an array as it is."""
    return np.asarray(getattr(expression, "value", expression), dtype=np.float64)


def solved(
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...], gamma: float | None
) -> tuple[str, Array, Variables]:
    """Solver's word, gain and variables of greatest margin."""
    v = unknowns(system, gain=None, gamma=gamma)
    whole, positive = omega(system, k1, k2, v)
    n, margin = system.A.shape[0], cp.Variable()
    constraints = [(whole + whole.T) / 2 << -margin * np.eye(whole.shape[0]), margin <= 1]
    constraints += [v.X << 100 * np.eye(n), *(p >> margin * np.eye(n) for p in positive)]
    problem = cp.Problem(cp.Maximize(margin), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate solution is a case like any other
        problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
    X = value(v.X)
    K: Array = np.zeros((0, n))
    if system.B.shape[1]:
        K = np.asarray(np.linalg.solve(X.T, value(v.Y).T).T, dtype=np.float64)
    eps = None if v.eps.value is None else float(v.eps.value)
    Q, R = tuple(map(value, v.Q)), tuple(map(value, v.R))
    return problem.status, K, Variables(X, Q, R, eps, k1, k2, gamma)


def benchmark(d: float) -> DelaySystem:
    """Stable exactly for d < 6.172581371 (published example)."""
    return DelaySystem([[-2.0, 0.0], [0.0, -0.9]], delays=[Delay(d, [[-1, 0], [-1, -1]])])


def random_system(
    rng: np.random.Generator,
    *,
    late: bool,
    any_age: bool,
    uncertain: bool,
    scale: float = 1.0,
    blocks: list[list[int]] | None = None,
) -> DelaySystem:
    """n = 2, m = 1, q = 2, p = 2, two delays; the second may carry the feedback; F is 3 x 2."""

    def r(*shape: int) -> Array:
        return scale * rng.standard_normal(shape)

    H = [r(2, 2) for _ in range(3)] if uncertain else [None] * 3
    delays = (
        Delay(float(rng.uniform(0.1, 0.8)), r(2, 2), H[1]),
        Delay(float(rng.uniform(0.1, 0.8)), r(2, 2), H[2], feedback=late, any_age=any_age),
    )
    A = r(2, 2) - 3 * scale * np.eye(2)
    E = r(2, 3) if uncertain else None
    matrices = (A, r(2, 1), r(2, 2), r(2, 2), r(2, 2), r(2, 1), E, H[0])
    return DelaySystem(*matrices, delays, uncertainty_blocks=blocks)
