"""Theorem 2, corrected, for any number of delays: the inequality that designs a gain.

    V = x'Px + sum_j (int_{t-dj}^t x'Qj x + int_{-dj}^0 int_{t+th}^t x''Rj x')

Lemma 2 per delay with M1j = k1j P, M2j = k2j P; then multiply from both sides by X = P^-1 in
every x block, and by Rbar_j = Rj^-1 where the terms dj x''Rj x' (row r_j) and
dj M_j'Rj^-1 M_j (row m_j) are removed by Lemma 3; Qbar_j = X Qj X, Y = K X. Lemma 1 removes
F(t) (row h) with an eps for each block of F. Rows of x_j are multiplied by k2j, those of r_j and
m_j by sqrt(dj): a congruence that avoids roots and quotients. With e = x + sum_j dj r_j, He M =
M + M', and phi_i = 1 for what the feedback acts through,

    -Omega = -He(e'(sum_i (A_i X + phi_i B Y) x_i + C w) + h'sum_i H_i X x_i
                 + z'(D X x + D2 Y sum_i phi_i x_i + D1 w)
                 + sum_j (k1j x + k2j x_j)'(X (x - x_j) + dj Rbar_j m_j))
             + gamma (w'w + z'z) - sum_b eps_b (|E_b'e|^2 - |h_b|^2)
             - sum_j (x'Qbar_j x - x_j'Qbar_j x_j - dj r_j'Rbar_j r_j - dj m_j'Rbar_j m_j).

At dj = 0 rows r_j and m_j are zero and left out: there x(t-dj) = x(t), both their terms vanish,
and V' < 0 follows on the subspace xj = x without them. With Qbar_j = 0 it holds for every age up
to dj, however it varies. Misprints of the paper: Omega_12 needs k2^-1 A1 X, Omega_25 A1'.

A rate of decay is proved for the system of e^{rate t} x(t): A_0 + rate I, and growth_j times
everything that acts through delay j (`Shift`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.hinf.exact import exact, exact_matrix, identity
from cosim.hinf.theorems.inequality import Inequality, Signal, itself
from cosim.hinf.theorems.loop import eps_by_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cosim.models import DelaySystem, Matrix


@dataclass(frozen=True)
class ExactVariables:
    """The unknowns as rationals, `fmpq_mat` and `fmpq`.

    X (n, n); Q, R one (n, n) per delay (Qbar, Rbar above); k1, k2 one number per delay; eps one
    number, or a tuple of one per block of F, None where nothing is uncertain; gamma None for
    stability alone.
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

    def by_name(self) -> dict[str, Any]:
        """Return the unknowns of `minus_omega` by name."""
        return {**dict(self.matrices()), **eps_by_name(self.eps), "gamma": self.gamma}


@dataclass(frozen=True)
class Shift:
    """The system of e^{rate t} x(t): A_0 + rate I, and growth_j times A_j, B, H_j.

    rate : a `fmpq`.
    growth : one `fmpq` per delay, in place of e^{rate tau_j}; B where the feedback is delayed.
    """

    rate: Any
    growth: tuple[Any, ...]


def positive(system: DelaySystem) -> list[Inequality]:
    """Return what must be positive beside -Omega: X, and Q_j, R_j where -Omega does not say so."""
    n = len(system.A)
    names = ["X", *(f"Q[{j}]" for j, x in enumerate(system.delays) if not x.any_age)]
    # where dj > 0, R is a diagonal block of -Omega
    names += [f"R[{j}]" for j, x in enumerate(system.delays) if x.d == 0]
    return [itself(name, n) for name in names]


def minus_omega(  # noqa: C901 - one sum, read from top to bottom
    system: DelaySystem,
    k1: Sequence[Any],
    k2: Sequence[Any],
    *,
    bounded: bool,
    gain: Matrix | None = None,
    shift: Shift | None = None,
) -> Inequality:
    """Return -Omega in X, Q[j], R[j], eps[b], gamma, and in Y or, with a `gain`, for Y = K X.

    Parameters
    ----------
    system, gain : their doubles are taken exactly.
    k1, k2 : one `fmpq` per delay.
    bounded : whether there is a gamma to prove.
    shift : for a rate of decay, the shifted system is used.
    """
    n, later = len(system.A), range(1, 1 + len(system.delays))
    A = [exact_matrix(M) for M in (system.A, *(x.A for x in system.delays))]
    H = [exact_matrix(M) for M in (system.H, *(x.H for x in system.delays))]
    acts = [bool(system.immediate_feedback), *(bool(x.feedback) for x in system.delays)]
    growth = [1, *((1 for _ in later) if shift is None else shift.growth)]
    if shift is not None:
        A[0] += shift.rate * identity(n)
    d = [exact(0.0), *(exact(x.d) for x in system.delays)]
    spread = [j for j in later if d[j] > 0]
    rows = {"x": n} | {f"x{j}": n for j in later}
    rows |= {"w": system.C.shape[1], "z": len(system.D)} if bounded else {}
    rows |= {f"r{j}": n for j in spread} | {f"m{j}": n for j in spread}
    rows |= {"h": len(system.H)} if system.blocks else {}
    form = Inequality("-Omega", rows)
    x = [form.row("x"), *(form.row(f"x{j}") for j in later)]
    e = sum((d[j] * form.row(f"r{j}") for j in spread), x[0])

    def acted(left: Signal, M: Matrix, right: Signal, weight: Any) -> None:
        """Subtract weight He(left'M Y right)."""
        to = exact_matrix(M) if gain is None else exact_matrix(M) * exact_matrix(gain)
        form.twice("Y" if gain is None else "X", to.transpose() * left, right, -weight)

    for i, (each, s) in enumerate(zip(x, growth, strict=True)):
        form.twice("X", A[i].transpose() * e, each, -s)
        if acts[i]:
            acted(e, system.B, each, s)
            if bounded:
                acted(form.row("z"), system.D2, each, 1)
        if system.blocks:
            form.twice("X", H[i].transpose() * form.row("h"), each, -s)
    if bounded:
        w, z = form.row("w"), form.row("z")
        form.twice("X", exact_matrix(system.D).transpose() * z, x[0], -1)
        form.twice(None, e, exact_matrix(system.C) * w, -1)
        form.twice(None, z, exact_matrix(system.D1) * w, -1)
        form.number("gamma", w)
        form.number("gamma", z)
    for j, delay in enumerate(system.delays):
        both = k1[j] * x[0] + k2[j] * x[j + 1]
        form.twice("X", both, x[0] - x[j + 1], -1)
        if not delay.any_age:
            form.square(f"Q[{j}]", x[0], -1)
            form.square(f"Q[{j}]", x[j + 1])
        if delay.d > 0:
            r, m = form.row(f"r{j + 1}"), form.row(f"m{j + 1}")
            form.square(f"R[{j}]", r, d[j + 1])
            form.square(f"R[{j}]", m, d[j + 1])
            form.twice(f"R[{j}]", both, m, -d[j + 1])
    E = exact_matrix(system.E).transpose()
    for b, (columns, of_H) in enumerate(system.blocks):
        form.number(f"eps[{b}]", (E * e).rows(columns), -1)
        form.number(f"eps[{b}]", form.row("h").rows(of_H))
    return form
