"""The LMI of Theorem 2, corrected, for any number of delays, as a cvxpy problem.

For users with constraints of their own on X, Y, Q, R, by `as_cvxpy`. cvxpy is imported when its
variables are made; the project's own designs use `cosim.hinf.lmi.assembly` instead.

Functional V = x'Px + sum_j (int_{t-dj}^t x'Qj x + int_{-dj}^0 int_{t+th}^t x''Rj x'), Lemma 2
per delay with M1j = k1j P, M2j = k2j P; X = P^-1, Rbar = R^-1, Qbar = P^-1 Q P^-1, Y = K X.
With s_i = 1/k2_i and G_i = A_i X + phi_i B Y (phi_i = 1 where the feedback acts), block order
[x, x1..xN, w, z, xdot_1..xdot_N, m1..mN, h]:

    (x,x)        G0 + G0' + sum Qbar_i + 2 sum k1_i X + E L_p E'
    (x,xi)       s_i G_i - k1_i s_i X + X
    (xi,xi)      -s_i^2 Qbar_i - 2 s_i X
    (x,w), (w,w), (w,z), (z,z)          C, -gamma I, D1', -gamma I
    (x,z), (xi,z)                       (D X + phi_0 D2 Y)', s_i phi_i (D2 Y)'
    (x,xdot_j), (xi,xdot_j), (w,xdot_j) sqrt(dj) (G0' + E L_p E'), sqrt(dj) s_i G_i', sqrt(dj) C'
    (xdot_j,xdot_l)                     -delta_jl Rbar_j + sqrt(dj dl) E L_p E'
    (x,mj), (xj,mj), (mj,mj)            sqrt(dj) k1j Rbar_j, sqrt(dj) Rbar_j, -Rbar_j
    (x,h), (xi,h), (h,h)                X H0', s_i X Hi', -L_q

With one delay and immediate feedback this is Theorem 2, Eq. (14), its misprints corrected:
Omega_12 needs k2^-1 A1 X and Omega_25 needs A1'. Rows xdot and m are divided by sqrt(d), a
congruence that keeps the LMI regular as d -> 0; at d = 0 they decouple and are left out. With
Qbar_j = 0 (`any_age`) it holds for every time-varying age up to dj.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.models import DelaySystem, Matrix


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The LMI's unknowns, as cvxpy variables or expressions.

    X (n, n); Y (m, n); Q, R one (n, n) per delay, Q zero where any age is allowed; eps and
    gamma scalars, eps one per block of F where there are several.
    """

    X: Any
    Y: Any
    Q: tuple[Any, ...]
    R: tuple[Any, ...]
    eps: Any
    gamma: Any


def unknowns(system: DelaySystem, *, gain: Matrix | None, gamma: float | None) -> Unknowns:
    """Return new unknowns; with a given `gain` Y = K X, a given `gamma` is a number."""
    import cvxpy as cp  # noqa: PLC0415

    n, m = system.B.shape
    X = cp.Variable((n, n), symmetric=True, name="X")
    Y: Any = cp.Variable((m, n), name="Y") if gain is None else gain @ X
    Q = tuple(
        np.zeros((n, n)) if delay.any_age else cp.Variable((n, n), PSD=True, name=f"Q{j}")
        for j, delay in enumerate(system.delays, 1)
    )
    R = tuple(
        cp.Variable((n, n), symmetric=True, name=f"R{j}") for j in range(1, len(system.delays) + 1)
    )
    free = cp.Variable(name="gamma") if gamma is None else gamma
    blocks = len(system.blocks)
    eps = cp.Variable(blocks, name="eps") if blocks > 1 else cp.Variable(name="eps")
    return Unknowns(X, Y, Q, R, eps, free)


def omega(  # noqa: C901, PLR0912, PLR0915 - one table, read from top to bottom
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...], v: Unknowns
) -> tuple[Any, list[Any]]:
    """Return Omega of the module's table, and the other matrices that must be positive.

    Rows without a size (no disturbance, nothing uncertain, d = 0) are left out.
    """
    import cvxpy as cp  # noqa: PLC0415

    n, N = system.A.shape[0], len(system.delays)
    late = [j for j in range(1, N + 1) if system.delays[j - 1].d > 0]
    root = {j: math.sqrt(system.delays[j - 1].d) for j in late}
    A = [system.A, *(delay.A for delay in system.delays)]
    H = [system.H, *(delay.H for delay in system.delays)]
    phi = [system.immediate_feedback, *(delay.feedback for delay in system.delays)]
    s = [1.0, *(1.0 / value for value in k2)]
    G = [A[i] @ v.X + (system.B @ v.Y if phi[i] else 0.0) for i in range(N + 1)]
    sizes: dict[str, int] = {f"x{i}": n for i in range(N + 1)}
    if system.has_performance:
        sizes |= {"w": system.C.shape[1], "z": system.D.shape[0]}
    sizes |= {f"r{j}": n for j in late} | {f"m{j}": n for j in late}
    if system.H.shape[0]:
        sizes["h"] = system.H.shape[0]
    # L_p and L_q have the eps of each block of F on its columns of E and rows of H
    blocks = system.blocks or ((slice(0), slice(0)),)
    each = [v.eps[i] for i in range(len(blocks))] if len(blocks) > 1 else [v.eps]
    channels = list(zip(each, blocks, strict=True))
    EE = sum(eps * (system.E[:, p] @ system.E[:, p].T) for eps, (p, _) in channels)

    t: dict[tuple[str, str], Any] = {}
    t["x0", "x0"] = G[0] + G[0].T + sum(v.Q) + 2.0 * sum(k1) * v.X + EE
    for i in range(1, N + 1):
        t["x0", f"x{i}"] = s[i] * G[i] + (1.0 - k1[i - 1] * s[i]) * v.X
        t[f"x{i}", f"x{i}"] = -(s[i] ** 2) * v.Q[i - 1] - 2.0 * s[i] * v.X
    if system.has_performance:
        t["x0", "w"] = system.C
        t["w", "w"] = -v.gamma * np.eye(sizes["w"])
        t["w", "z"] = system.D1.T
        t["z", "z"] = -v.gamma * np.eye(sizes["z"])
        for i in range(N + 1):
            z: Any = system.D @ v.X if i == 0 else 0.0
            if phi[i]:
                z += system.D2 @ v.Y
            if i == 0 or phi[i]:
                t[f"x{i}", "z"] = s[i] * z.T
    for j in late:
        t["x0", f"r{j}"] = root[j] * (G[0].T + EE)
        for i in range(1, N + 1):
            t[f"x{i}", f"r{j}"] = root[j] * s[i] * G[i].T
        if system.has_performance:
            t["w", f"r{j}"] = root[j] * system.C.T
        for k in (k for k in late if k >= j):
            t[f"r{j}", f"r{k}"] = root[j] * root[k] * EE - (v.R[j - 1] if j == k else 0.0)
        t["x0", f"m{j}"] = root[j] * k1[j - 1] * v.R[j - 1]
        t[f"x{j}", f"m{j}"] = root[j] * v.R[j - 1]
        t[f"m{j}", f"m{j}"] = -v.R[j - 1]
    if "h" in sizes:
        for i in range(N + 1):
            t[f"x{i}", "h"] = s[i] * v.X @ H[i].T
        ones = np.eye(sizes["h"])
        t["h", "h"] = -sum(eps * np.diag(ones[q].sum(axis=0)) for eps, (_, q) in channels)

    def block(row: str, column: str) -> Any:
        if (row, column) in t:
            return t[row, column]
        if (column, row) in t:
            return t[column, row].T
        return np.zeros((sizes[row], sizes[column]))

    whole = cp.bmat(  # type: ignore[attr-defined]  # re-exported by a wildcard
        [[block(row, column) for column in sizes] for row in sizes]
    )
    positive = [v.X, *(v.R[j - 1] for j in range(1, N + 1) if j not in late)]
    return whole, positive
