"""The LMI of Theorem 2, corrected, in rational arithmetic, for the exact certificate.

Derived from the functional independently of the solver's LMI, so that an error in one shows in
the other. Notation and derivation:

    V = x'Px + sum_j (int_{t-dj}^t x'Qj x + int_{-dj}^0 int_{t+th}^t x''Rj x')

Lemma 2 per delay with M1j = k1j P, M2j = k2j P; then multiply from both sides by X = P^-1 in
every x block, and by Rbar_j = Rj^-1 where the terms dj x''Rj x' (row r_j) and
dj M_j'Rj^-1 M_j (row m_j) are removed by Lemma 3; Qbar_j = X Qj X, Y = K X. Lemma 1 removes
F(t) (row h) with an eps for each block of F, L_p and L_q of `block_multipliers`. With
G_i = A_i X + phi_i B Y, rows of x_j multiplied by k2j and those of r_j and m_j by sqrt(dj) (a
congruence that avoids roots and quotients):

    (x,x)               G0 + G0' + sum Qbar_j + 2 sum k1j X + E L_p E'
    (x,xj)              Gj + (k2j - k1j) X
    (xj,xj)             -Qbar_j - 2 k2j X
    (x,w), (w,w)        C, -gamma I
    (x,z), (xj,z)       (D X + phi_0 D2 Y)', phi_j (D2 Y)'
    (w,z), (z,z)        D1', -gamma I
    (x,rj), (xi,rj)     dj (G0' + E L_p E'), dj Gi'
    (w,rj), (rj,rl)     dj C', -delta_jl dj Rbar_j + dj dl E L_p E'
    (x,mj), (xj,mj)     dj k1j Rbar_j, dj k2j Rbar_j
    (mj,mj)             -dj Rbar_j
    (x,h), (xj,h)       X H0', X Hj'
    (h,h)               -L_q

If all inputs are doubles then all entries are dyadic rationals. At dj = 0 the rows r_j and
m_j are zero and left out: there x(t-dj) = x(t), both their terms vanish, and V' < 0 follows
on the subspace xj = x without them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cosim.hinf.certificate.block_multipliers import scalings
from cosim.hinf.certificate.rational import exact, exact_matrix, identity, lower_triangle
from cosim.models import DelaySystem


@dataclass(frozen=True)
class ExactVariables:
    """The LMI's variables as rationals: `fmpq_mat` and `fmpq`.

    X (n, n); Q, R one (n, n) per delay (Qbar, Rbar of the table); k1, k2 one number per
    delay; eps one number, or a tuple of one per block of F, None where nothing is uncertain;
    gamma None for stability alone.
    """

    X: Any
    Q: tuple[Any, ...]
    R: tuple[Any, ...]
    eps: Any
    k1: tuple[Any, ...]
    k2: tuple[Any, ...]
    gamma: Any

    def matrices(self) -> list[tuple[str, Any]]:
        """Return every matrix with its name: all must be symmetric."""
        several = [(f"{name}[{j}]", M) for name in "QR" for j, M in enumerate(getattr(self, name))]
        return [("X", self.X), *several]


@dataclass(frozen=True)
class Shift:
    """The system of e^{rate t} x(t): A_0 + rate I, and growth_j times A_j, B, H_j.

    rate : a `fmpq`.
    growth : one `fmpq` per delay, in place of e^{rate tau_j}; B where the feedback is delayed.
    """

    rate: Any
    growth: tuple[Any, ...]


@dataclass(frozen=True)
class ExactLmi:
    """-Omega: its lower triangle row by row, and the block name of every row."""

    lower: list[list[Any]]
    row_names: list[str]


def minus_omega(  # noqa: C901 - one table, read from top to bottom
    system: DelaySystem, Y: Any, v: ExactVariables, shift: Shift | None = None
) -> ExactLmi:
    """Return -Omega of the module's table, exactly.

    Parameters
    ----------
    system : the doubles of its matrices and delays are taken exactly.
    Y : (m, n) `fmpq_mat`, K X.
    v : the variables.
    shift : for a rate of decay, the shifted system is used.
    """
    n, N = system.A.shape[0], len(system.delays)
    later = range(1, N + 1)
    d = [exact(0.0), *(exact(delay.d) for delay in system.delays)]
    spread = [j for j in later if d[j] > 0]
    B, D2Y = exact_matrix(system.B), exact_matrix(system.D2) * Y
    A = [exact_matrix(system.A), *(exact_matrix(delay.A) for delay in system.delays)]
    H = [exact_matrix(system.H), *(exact_matrix(delay.H) for delay in system.delays)]
    acts = [system.immediate_feedback, *(delay.feedback for delay in system.delays)]
    G = [A[i] * v.X + B * Y if acts[i] else A[i] * v.X for i in range(N + 1)]
    G, H = (G, H) if shift is None else _shifted(G, H, v.X, shift)
    C = exact_matrix(system.C)
    L_p, L_q = scalings(system.blocks, v.eps)
    E = exact_matrix(system.E)
    EE = E * L_p * E.transpose()

    sizes = {"x": n} | {f"x{j}": n for j in later}
    t: dict[tuple[str, str], Any] = {}
    t["x", "x"] = G[0] + G[0].transpose() + EE
    for j in later:
        Q, k1, k2 = v.Q[j - 1], v.k1[j - 1], v.k2[j - 1]
        t["x", "x"] += Q + 2 * k1 * v.X
        t["x", f"x{j}"] = G[j] + (k2 - k1) * v.X
        t[f"x{j}", f"x{j}"] = -Q - 2 * k2 * v.X
    if v.gamma is not None:
        sizes |= {"w": system.C.shape[1], "z": system.D.shape[0]}
        z = exact_matrix(system.D) * v.X
        t["x", "z"] = (z + D2Y if acts[0] else z).transpose()
        for j in later:
            if acts[j]:
                t[f"x{j}", "z"] = D2Y.transpose()
        t["x", "w"] = C
        t["w", "w"] = -v.gamma * identity(sizes["w"])
        t["w", "z"] = exact_matrix(system.D1).transpose()
        t["z", "z"] = -v.gamma * identity(sizes["z"])
    sizes |= {f"r{j}": n for j in spread} | {f"m{j}": n for j in spread}
    for j in spread:
        R = d[j] * v.R[j - 1]
        t["x", f"r{j}"] = d[j] * (G[0].transpose() + EE)
        for i in later:
            t[f"x{i}", f"r{j}"] = d[j] * G[i].transpose()
        if v.gamma is not None:
            t["w", f"r{j}"] = d[j] * C.transpose()
        for k in spread:
            if k >= j:
                t[f"r{j}", f"r{k}"] = d[j] * d[k] * EE
        t[f"r{j}", f"r{j}"] -= R
        t["x", f"m{j}"] = v.k1[j - 1] * R
        t[f"x{j}", f"m{j}"] = v.k2[j - 1] * R
        t[f"m{j}", f"m{j}"] = -R
    if system.blocks:
        sizes["h"] = system.H.shape[0]
        for i in range(N + 1):
            t["x" if i == 0 else f"x{i}", "h"] = v.X * H[i].transpose()
        t["h", "h"] = -L_q

    negated = {key: -block for key, block in t.items()}
    names = [name for name in sizes for _ in range(sizes[name])]
    return ExactLmi(lower_triangle(list(sizes), sizes, negated), names)


def _shifted(G: list[Any], H: list[Any], X: Any, shift: Shift) -> tuple[list[Any], list[Any]]:
    """Return G and H of the shifted system; all terms of a delay have its growth."""
    late_G = [growth * M for growth, M in zip(shift.growth, G[1:], strict=True)]
    late_H = [growth * M for growth, M in zip(shift.growth, H[1:], strict=True)]
    return [G[0] + shift.rate * X, *late_G], [H[0], *late_H]
