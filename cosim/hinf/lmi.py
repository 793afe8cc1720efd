"""The LMI of Theorem 2, corrected, for any number of delays, as a cvxpy problem.

For users with constraints of their own on X, Y, Q, R: `as_cvxpy`. cvxpy is imported when it is
called; the project's own designs use `cosim.hinf.assembly` instead.

Functional V = x'Px + sum_j (int_{t-dj}^t x'Qj x + int_{-dj}^0 int_{t+th}^t x''Rj x'), Lemma 2
per delay with M1j = k1j P, M2j = k2j P; X = P^-1, Rbar = R^-1, Qbar = P^-1 Q P^-1, Y = K X.
With s_i = 1/k2_i and G_i = A_i X + phi_i B Y (phi_i = 1 where the feedback acts), block order
[x, x1..xN, w, z, xdot_1..xdot_N, m1..mN, h]:

    (x,x)        G0 + G0' + sum Qbar_i + 2 sum k1_i X + eps E E'
    (x,xi)       s_i G_i - k1_i s_i X + X
    (xi,xi)      -s_i^2 Qbar_i - 2 s_i X
    (x,w), (w,w), (w,z), (z,z)          C, -gamma I, D1', -gamma I
    (x,z), (xi,z)                       (D X + phi_0 D2 Y)', s_i phi_i (D2 Y)'
    (x,xdot_j), (xi,xdot_j), (w,xdot_j) sqrt(dj) (G0' + eps E E'), sqrt(dj) s_i G_i', sqrt(dj) C'
    (xdot_j,xdot_l)                     -delta_jl Rbar_j + sqrt(dj dl) eps E E'
    (x,mj), (xj,mj), (mj,mj)            sqrt(dj) k1j Rbar_j, sqrt(dj) Rbar_j, -Rbar_j
    (x,h), (xi,h), (h,h)                X H0', s_i X Hi', -eps I

With one delay and immediate feedback this is Theorem 2, Eq. (14), its misprints corrected:
Omega_12 needs k2^-1 A1 X and Omega_25 needs A1'. Rows xdot and m are divided by sqrt(d), a
congruence that keeps the LMI regular as d -> 0; at d = 0 they decouple and are left out. With
Qbar_j = 0 (`any_age`) it holds for every time-varying age up to dj.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.analysis import gain_of
from cosim.hinf.from_control import checked_system
from cosim.hinf.scaling import scaling_of
from cosim.hinf.synthesis import Design, check_achievable, checked_scalars, design, rounded_gain
from cosim.models import DelaySystem, Matrix

_SINGULAR = 1e14  # condition number of X beyond which Y X^-1 is noise


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The LMI's unknowns, as cvxpy variables or expressions.

    X (n, n); Y (m, n); Q, R one (n, n) per delay, Q zero where any age is allowed; eps and
    gamma scalars.
    """

    X: Any
    Y: Any
    Q: tuple[Any, ...]
    R: tuple[Any, ...]
    eps: Any
    gamma: Any


@dataclass(frozen=True, eq=False)
class CvxpyLmi(Unknowns):
    """The LMI of one system at given k1, k2, as a cvxpy problem.

    X, Y, Q, R, eps, gamma are variables of these names (Q1, R1 for the first delay); Y is an
    expression if the gain is given, gamma a number if it is given, Q zero for any age.

    Attributes
    ----------
    system, k1, k2 : of the LMI.
    constraints : -Omega >= 0, X >= 0, and for a delay of zero R >= 0.
    problem : minimise gamma over them; with a given gamma, or without w and z, maximise t with
        -Omega >= t I and X of trace n.
    """

    system: DelaySystem
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    constraints: list[Any]
    problem: Any

    def gain(self) -> Matrix:
        """Return K = Y X^-1 (m, n) of the solved problem, rounded as in every design.

        Raises
        ------
        InputError : the variables have no value (nothing was solved), or X is singular.
        """
        X, Y = self.X.value, self.Y.value
        if X is None or Y is None or not np.linalg.cond(X) < _SINGULAR:
            raise InputError(
                "there is no gain in X and Y",
                where="X, Y",
                expected="the values of a solved problem, X regular",
                got="no value" if X is None or Y is None else "X as good as singular",
                hint="call solve() and look at its status; bound X from below, X >> 0.01 I",
            )
        K = np.asarray(np.linalg.solve(X.T, Y.T).T, dtype=np.float64)
        return rounded_gain(K, scaling_of(self.system))

    def design(self, gamma: float | None = None) -> Design:
        """Return the design with this gain, proved exactly at k1, k2.

        The proof has variables of its own, without the constraints that were added. Its least
        gamma is at most that of the problem.

        Parameters
        ----------
        gamma : a bound to prove instead of the least one of this gain.

        Raises
        ------
        InputError : as `gain`.
        NotAchievableError : the gain could not be certified.
        """
        return design(self.system, self.k1, self.k2, gamma=gamma, gain=self.gain())


def as_cvxpy(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
) -> CvxpyLmi:
    """Formulate the LMI of Theorem 2 as a cvxpy problem, to which constraints can be added.

    Parameters
    ----------
    system : Eq. (7) with delays (n states, m inputs).
    k1, k2 : one number per delay, k2 not zero.
    gamma : a bound to meet instead of the least one.
    gain : (m, n) a given gain; then Y = K X.

    Returns
    -------
    CvxpyLmi
        X (n, n) symmetric, Y (m, n), Q and R one (n, n) per delay, eps and gamma scalars, the
        `constraints` and the `problem`; after solving, `design()` proves the gain.

    Raises
    ------
    InputError : numbers that do not fit the system, or no B.
    NotAchievableError : gamma <= ||D1||.

    Examples
    --------
    A gain whose first control does not use the second state, X diagonal:

    >>> import cvxpy as cp
    >>> from cosim.hinf import as_cvxpy
    >>> from cosim.models import paper_example
    >>> lmi = as_cvxpy(paper_example.system(), [0.6], [0.2])
    >>> more = [lmi.X[0, 1] == 0, lmi.Y[0, 1] == 0]
    >>> least = cp.Problem(lmi.problem.objective, [*lmi.constraints, *more]).solve(cp.CLARABEL)
    >>> found = lmi.design()
    >>> abs(float(found.K[0, 1])) < 1e-5, found.gamma < least * 1.001
    (True, True)
    """
    import cvxpy as cp  # noqa: PLC0415 - slow to load, and few need it

    system = checked_system(system, control=True)
    p = checked_scalars(system, k1, k2)
    if gamma is not None:
        check_achievable(gamma, system)
    v = unknowns(system, gain=None if gain is None else gain_of(system, gain), gamma=gamma)
    whole, positive = omega(system, p.k1, p.k2, v)
    least = gamma is None and system.has_performance
    margin = 0.0 if least else cp.Variable(name="margin")
    constraints = [(whole + whole.T) / 2 << -margin * np.eye(whole.shape[0])]
    constraints += [matrix >> 0 for matrix in positive]
    if least:
        objective: Any = cp.Minimize(v.gamma)
    else:
        # without a free gamma the LMI is homogeneous: fix the size of the solution
        constraints.append(sum(v.X[i, i] for i in range(len(system.A))) == len(system.A))
        objective = cp.Maximize(margin)
    problem = cp.Problem(objective, constraints)
    return CvxpyLmi(
        **vars(v), system=system, k1=p.k1, k2=p.k2, constraints=constraints, problem=problem
    )


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
    return Unknowns(X, Y, Q, R, cp.Variable(name="eps"), free)


def omega(  # noqa: C901, PLR0912 - one table, read from top to bottom
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
    EE = v.eps * (system.E @ system.E.T)

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
        t["h", "h"] = -v.eps * np.eye(sizes["h"])

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
