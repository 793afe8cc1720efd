"""The LMI that designs a gain with the Bessel-Legendre inequality of order N.

The functional and the inequality are those of `analysis_lmi`, where an unknown K would be
multiplied by P and R. So x' is kept as a variable, tied to f = sum_i A_i x(t-di) + B K x(t-df)
+ C w + E p by a multiplier (Finsler's lemma, the descriptor method of Fridman):

    2 (x'U + x''U_0 + sum_jk W_jk'U_jk) (f - x')  is added to Phi.

K is then multiplied by the U alone. With U_0 = U S_0 and U_jk = U S_jk for **given** S, and
x = X xh for each of x, x', xj, W_jk, where X'U = I,

    2 (xh + S_0' xh' + sum S_jk' Wh_jk)' (sum_i A_i X xh_i + B Y xh_f + C w + E p - X xh'),

Y = K X, while P, Qj, Rj become Ph = X'P X (every block), Qh, Rh without restriction. With
p = eh ph, eh = 1/eps (one for each block of F), and z and q by Schur complements the whole is
linear in X (n, n; not symmetric), Y, Ph, Qh, Rh, eh and gamma, in [x, x', x1.., W.., w, p, z, h].
For feedback over a delay B Y is multiplied by that xh_i instead.

**What is lost.** The conditions are convex for fixed S only, and a fixed S restricts them.
Scalar S_0 = b I, S_jk = 0 is the usual choice. At a gain that the analysis already proves
nothing is lost: its Phi < 0 follows with U = P_00, U_0 = sum dj^2 Rj, U_jk = dj P_k0
(the coupling of x' in Phi, and its own block), so that with

    S_0' = sum dj^2 Rj P_00^-1,   S_jk' = dj P_0k P_00^-1

this LMI has a solution at that gamma with that K, and its least gamma is not higher. Analysis
and synthesis in turn therefore only improve a gain of Theorem 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.hinf.certificate import AnalysisVariables
from cosim.hinf.lmi.bessel_legendre_rows import BesselLegendreRows, symmetrised
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.loop_lmi import Constraints, GainLmi
from cosim.hinf.lmi.svec import Array, product, svec
from cosim.models import DelaySystem


@dataclass(frozen=True)
class Multipliers:
    """S_0' [s] and S_jk' (per positive delay j, k below its order), each (n, n)."""

    rate: Array
    means: tuple[tuple[Array, ...], ...]


def multipliers_of(v: AnalysisVariables, system: DelaySystem) -> Multipliers:
    """Return the multipliers with which synthesis loses nothing at the gain that `v` proves."""
    n = len(system.A)
    X = np.linalg.inv(v.P[:n, :n])
    late = [delay for delay in system.delays if delay.d > 0]
    rate = sum((x.d**2 * R for x, R in zip(late, v.R, strict=True)), np.zeros((n, n)))
    means, row = [], n
    for delay in late:
        order = 0 if delay.any_age else v.order
        blocks = [v.P[:n, row + k * n : row + (k + 1) * n] for k in range(order)]
        means.append(tuple(delay.d * block @ X for block in blocks))
        row += n * order
    return Multipliers(np.asarray(rate @ X), tuple(means))


def scalar_multipliers(b: float, system: DelaySystem, order: int) -> Multipliers:
    """Return the multipliers S_0 = b I [s], the others zero."""
    n = len(system.A)
    late = [delay for delay in system.delays if delay.d > 0]
    zeros = [(np.zeros((n, n)),) * (0 if delay.any_age else order) for delay in late]
    return Multipliers(b * np.eye(n), tuple(zeros))


class BesselLegendreLmi(GainLmi[Multipliers]):
    """The LMI of one system at one order.

    Parameters
    ----------
    system : Eq. (7), with a positive delay.
    order : N, of every delay that is constant.
    K : (m, n) a gain of about the expected size: it sets the units.
    reference : a gamma of about the expected size; None for stability alone.
    """

    def __init__(self, system: DelaySystem, order: int, K: Array, reference: float | None) -> None:
        super().__init__(system, K, reference)
        self._system = system
        performance = (system.C.shape[1], system.D.shape[0]) if reference is not None else (0, 0)
        self._rows = BesselLegendreRows(system, order, self._T, performance)

    def _constraints(self, multiplier: Multipliers, gamma: float | None) -> Constraints:
        n = len(self._A[0])
        rows = self._rows
        M = rows.at["x"] + self._turned(multiplier.rate) / self._T @ rows.at["r"]
        for (i, _), own in zip(rows.times, multiplier.means, strict=True):
            for k, S in enumerate(own):
                M = M + self._turned(S) @ rows.at[f"W{i},{k}"]
        columns = self._tied(M)
        functional, bessel = rows.functional([x.any_age for x in self._system.delays])
        columns |= functional
        constant = np.zeros(rows.total * (rows.total + 1) // 2)
        if self._E.size:
            p, h = rows.at["p"], rows.at["h"]
            for name, (columns_of_E, rows_of_H) in self._blocks.items():
                p_i, h_i = p[columns_of_E], h[rows_of_H]
                acting = symmetrised(M, self._E[:, columns_of_E] @ p_i)
                columns[name] = acting - svec(p_i.T @ p_i + h_i.T @ h_i)
        if self._reference is not None:
            w, z = rows.at["w"], rows.at["z"]
            constant = symmetrised(M, self._C @ w) + symmetrised(z, self._D1 @ w)
            supplied = svec(w.T @ w + z.T @ z)
            if gamma is None:
                columns["gamma"] = -supplied
            else:
                constant -= gamma / self._reference * supplied
        columns = {name: part.reshape(len(constant), -1) for name, part in columns.items()}
        whole = np.column_stack([-part for part in columns.values()])
        positive: list[Constraint] = []
        first, places = 0, {}
        for name, part in columns.items():
            places[name] = slice(first, first + part.shape[1])
            first = places[name].stop
        for name in (name for name in columns if name[0] in "PQRe"):
            size = rows.rows_of_P if name == "P" else 1 if name in self._blocks else n
            block = np.zeros((size * (size + 1) // 2, first))
            block[:, places[name]] = product(np.eye(size), np.eye(size), weight=0.5)
            for Q, row, weight in bessel if name == "P" else ():
                part = np.eye(n, size, row * n)
                block[:, places[Q]] += product(part, part, weight=0.5 * weight)
            positive.append(Constraint(size, np.zeros(len(block)), block))
        return [Constraint(rows.total, -constant, whole)], positive

    def _tied(self, M: Array) -> dict[str, Array]:
        """Return the coefficients of the entries of X and of Y: M'(f - x'), z and q."""
        n, m = self._B.shape
        at, on = self._rows.at, self._rows.on
        acted = on[self._acts.index(True)]
        X_columns, Y_columns = [], []
        for a in range(n):
            for b in range(n):
                f = sum(
                    (np.outer(A[:, a], x[b]) for A, x in zip(self._A, on, strict=True)),
                    -np.outer(np.eye(n)[a], at["r"][b]),
                )
                q = sum(np.outer(H[:, a], x[b]) for H, x in zip(self._H, on, strict=True))
                entry = symmetrised(M, f) + symmetrised(at["h"], np.asarray(q))
                if self._reference is not None:
                    entry += symmetrised(at["z"], np.outer(self._D[:, a], at["x"][b]))
                X_columns.append(entry)
        for a in range(m):
            for b in range(n):
                entry = symmetrised(M, np.outer(self._B[:, a], acted[b]))
                if self._reference is not None:
                    entry += symmetrised(at["z"], np.outer(self._D2[:, a], acted[b]))
                Y_columns.append(entry)
        return {"X": np.column_stack(X_columns), "Y": np.column_stack(Y_columns)}

    def _turned(self, S: Array) -> Array:
        """Return S' in the solver's units; it acts on transformed states, which are costates."""
        return S * self._back / self._back[:, None]
