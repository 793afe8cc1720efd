"""Systems and solutions that several tests of the certificate start from.

The solutions come from cvxpy's form of the inequality.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from cosim.hinf.certificate import (
    CertificateCheck,
    Guarantees,
    certificate_to_json,
    claim_of,
    theorem_2_proof,
)
from cosim.hinf.exact import exact
from cosim.hinf.lmi import in_cvxpy, variables_of
from cosim.hinf.theorems import Proof, minus_omega, positive
from cosim.models import Delay, DelaySystem

Array = NDArray[np.float64]


def value(expression: Any) -> Array:
    """A cvxpy expression's value, or an array as it is."""
    return np.asarray(getattr(expression, "value", expression), dtype=np.float64)


@dataclass(frozen=True)
class Point:
    """k1, k2 and unknowns of Theorem 2 by name, as floats."""

    k1: tuple[float, ...]
    k2: tuple[float, ...]
    unknowns: dict[str, Any]

    def changed(self, **unknowns: Any) -> Point:
        """With other unknowns; X_0 is X[0]."""
        named = {f"{k[0]}[{k[2:]}]" if k[1:2] == "_" else k: x for k, x in unknowns.items()}
        return replace(self, unknowns={**self.unknowns, **named})

    def proof(self, system: DelaySystem, K: Any) -> Proof:
        return theorem_2_proof(system, K, self.k1, self.k2, self.unknowns)

    def certify(self, system: DelaySystem, K: Any) -> CertificateCheck:
        proof = self.proof(system, K)
        reason = proof.failure(system, np.asarray(K))
        return CertificateCheck(reason is None, reason, claim_of(system, proof.gamma))

    def document(
        self, system: DelaySystem, K: Any, guarantees: Guarantees | None = None
    ) -> dict[str, Any]:
        return certificate_to_json(system, K, self.proof(system, K), guarantees)


def solved(
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...], gamma: float | None
) -> tuple[str, Array, Point]:
    """Solver's word, gain and point of greatest margin."""
    k = [exact(x) for x in k1], [exact(x) for x in k2]
    form = minus_omega(system, *k, bounded=system.has_performance)
    v = variables_of([form, *positive(system)])
    n, margin, N = system.A.shape[0], cp.Variable(), len(system.delays)
    unit = {f"x{j}": 1 / k for j, k in enumerate(k2, 1)}
    late = [(j, x.d**-0.5) for j, x in enumerate(system.delays, 1) if x.d > 0]
    unit |= {f"s{j}": size for j, size in late}
    D = np.diag([unit.get(name, 1.0) for name, size in form.rows.items() for _ in range(size)])
    whole = in_cvxpy(form, v)
    constraints = [D @ (whole + whole.T) @ D / 2 >> margin * np.eye(len(D)), margin <= 1]
    constraints += [] if gamma is None else [v["gamma"] == gamma]
    constraints += [v["X"] << 100 * np.eye(n)]
    constraints += [M >> margin * np.eye(n) for name, M in v.items() if name[0] in "XQR"]
    problem = cp.Problem(cp.Maximize(margin), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate solution is a case like any other
        problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
    X = value(v["X"])
    K: Array = np.zeros((0, n))
    if system.B.shape[1]:
        K = np.asarray(np.linalg.solve(X.T, value(v["Y"]).T).T, dtype=np.float64)
    unknowns: dict[str, Any] = {f"{name}[{j}]": np.zeros((n, n)) for name in "QR" for j in range(N)}
    unknowns |= {k: float(x.value) if x.ndim == 0 else value(x) for k, x in v.items()}
    unknowns |= {} if gamma is None else {"gamma": gamma}
    return problem.status, K, Point(k1, k2, unknowns)


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
