"""The LMI that analyses a given loop, of any Bessel-Legendre order, for an SDP solver.

For u = K x(t-d_f) with K given, x' = f = sum_i A_i x(t-di) + C w + E p, p = F(t) sum_i Hi x(t-di).
With the means W_jk = 1/dj int_{-dj}^0 L_k(s) x(t+s) ds over the Legendre polynomials L_k of
[-dj, 0] (L_k = 1 at 0, (-1)^k at -dj), k < N, and y = [x; d1 W_10; d1 W_11; ...]:

    V = y'Py + sum_j (int_{t-dj}^t x'Qj x + dj int_{-dj}^0 int_{t+th}^t x''Rj x')

The Bessel-Legendre inequality (Seuret & Gouaisbaut, Syst. Control Lett. 81, 2015) is

    dj int_{t-dj}^t x''Rj x' >= sum_{k<=N} (2k+1) v_jk'Rj v_jk,
    v_jk = x - (-1)^k xj - sum_{i<k} (2i+1) (1 - (-1)^(k+i)) W_ji = int L_k x',

and y' = [f; v_10; v_11; ...]. Stability, and the gain gamma for every admissible F, follow from

    Phi = y'P y' + its transpose + sum_j (x'Qj x - xj'Qj xj + dj^2 f'Rj f
          - sum_{k<=N} (2k+1) v_jk'Rj v_jk) + eps (q'q - p'p) + z'z/gamma - gamma w'w < 0,
    P + diag(0, (2k+1)/dj Qj) > 0,  Qj > 0,  Rj > 0,  q = sum_i Hi xi,

where F has several blocks with an eps and the entries of p and q of each of them;

a quadratic form in [x, x1.., W.., w, p]: no Schur complement, linear in all unknowns.

**Order 0 is Theorem 1.** Its free M1j, M2j enter through Lemma 2 alone, [M1 M2]' + [M1 M2] +
d [M1 M2]'R^-1[M1 M2], which is least at M1 = -R/d, M2 = R/d (complete the square); there
Lemma 2 is Jensen's inequality, and nothing is lost by putting them there.

**Every delay up to these.** With the same P, Q, R the form Phi is affine in (d1, d2, ..), but
for dj^2 f'Rj f, which is convex: negative at the corners of a box of delays, it is negative all
over the box. What Qj adds to P > 0 only grows as dj falls. So the corners of [0, d1] x [0, d2]
.. prove what order 0 proves by itself, at next to no cost where the loop bears no delay at all.

A delay of any age has Qj = 0 and order 0: -int_{t-d}^t <= -int_{t-tau}^t <= -1/d (x-xj)'R(x-xj).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy

from cosim.hinf.certificate import AnalysisVariables
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.interior_point import solve_dense
from cosim.hinf.lmi.loop_lmi import Constraints, Labelled, LoopLmi
from cosim.hinf.lmi.svec import Array, product, svec, symmetric

if TYPE_CHECKING:
    from cosim.models import DelaySystem


def couplings(k: int) -> list[int]:
    """Return the factors of the means W_0 .. W_(k-1) in v_k: (2i+1) (1 - (-1)^(k+i))."""
    return [(2 * i + 1) * (1 - (-1) ** (k + i)) for i in range(k)]


_MANY_BLOCKS = 8
"""Blocks of F above which there are few unknowns beside the rows that the blocks add."""


class AnalysisLmi(LoopLmi[AnalysisVariables]):
    """The LMI of one loop at one order, to be solved at any delays.

    Inside, P and R are scaled with long delays.

    Parameters
    ----------
    system : Eq. (7).
    K : (m, n) the gain, zero for the system as it is.
    order : N, of every delay that is constant.
    performance : bound the gain from w to z, instead of stability alone.
    """

    def __init__(self, system: DelaySystem, K: Array, order: int, *, performance: bool) -> None:
        super().__init__(system, K, performance=performance)
        self.order = order
        self._any_age = [delay.any_age for delay in system.delays]
        if len(system.blocks) > _MANY_BLOCKS:
            self._solver = solve_dense

    def _labels(self, delays: Sequence[float]) -> Labelled | None:
        if self._solver is solve_dense:
            return None
        x, times = self._part["x"], self._times(delays)
        rows = [x] * (1 + len(times) + sum(self._orders()[i] for i, _, _ in times))
        rows += [self._part["w"]] * self._performance + [self._part["p"]]
        sizes = self._unknowns(delays).values()
        positive = [np.tile(x, size // len(x)) if size % len(x) == 0 else None for size in sizes]
        return np.concatenate(rows), positive

    def unknowns(self, delays: Sequence[float]) -> int:
        """Return the number of unknowns."""
        return sum(size * (size + 1) // 2 for size in self._unknowns(delays).values())

    def _constraints(
        self,
        delays: Sequence[float],
        gamma: float,
        *,
        fixed: bool,
        down_to_zero: bool = False,
    ) -> Constraints:
        phi, *positive = self._at(delays, gamma, fixed=fixed)
        corners = self._corners(delays) if down_to_zero else []
        others = [self._at(delays, gamma, fixed=fixed, shorter=d)[0] for d in corners]
        return [phi, *others], positive

    def _corners(self, delays: Sequence[float]) -> list[list[float]]:
        """The corners of the box from zero to `delays`, but for `delays` themselves."""
        ends = [
            (d,) if d == 0 or free else (d, 0.0)
            for d, free in zip(delays, self._any_age, strict=True)
        ]
        return [list(corner) for corner in itertools.product(*ends)][1:]

    def _orders(self) -> list[int]:
        return [0 if free else self.order for free in self._any_age]

    def _times(self, delays: Sequence[float]) -> list[tuple[int, float, float]]:
        """(i, d, scale of P and R) per positive delay, in the loop's own time."""
        times = [(i, d / self._T) for i, d in enumerate(delays) if d > 0]
        return [(i, d, max(1.0, d)) for i, d in times]

    def _unknowns(self, delays: Sequence[float]) -> dict[str, int]:
        """Names and sizes, in the order in which they stand in a point."""
        n, times, orders = len(self._A[0]), self._times(delays), self._orders()
        sizes = {"P": n * (1 + sum(orders[i] for i, _, _ in times))}
        sizes |= {f"Q{i}": n for i, _, _ in times if not self._any_age[i]}
        sizes |= {f"R{i}": n for i, _, _ in times}
        return sizes | dict.fromkeys(self._blocks, 1)

    def _at(  # noqa: C901 - one table, read from top to bottom
        self,
        delays: Sequence[float],
        gamma: float,
        *,
        fixed: bool,
        shorter: Sequence[float] | None = None,
    ) -> list[Constraint]:
        """-Phi, P + ..., Q, R, eps; unless the gain is `fixed`, (its ratio to `gamma`)^2 last.

        Phi is that of the `shorter` delays, where they are given.
        """
        n, times, orders = len(self._A[0]), self._times(delays), self._orders()
        w, p = self._C.shape[1] if self._performance else 0, self._E.shape[1]
        sizes = {"x": n} | {f"x{i}": n for i, _, _ in times}
        sizes |= {f"W{i},{k}": n for i, _, _ in times for k in range(orders[i])}
        sizes |= {"w": w, "p": p}
        total, at, start = sum(sizes.values()), {}, 0
        for name, size in sizes.items():
            at[name] = np.eye(size, total, start)
            start += size

        late = {i for i, _, _ in times}
        on = [at["x"], *(at[f"x{i}"] if i in late else at["x"] for i in range(len(delays)))]
        f = np.asarray(sum(A @ x for A, x in zip(self._A, on, strict=True)))
        f = f + (self._C @ at["w"] if w else 0.0) + self._E @ at["p"]
        columns: dict[str, Array] = {}
        y, rate = [at["x"]], [f]
        bessel: list[tuple[str, int, float]] = []  # what Q adds to P > 0, per row block of y
        for i, d, s in times:
            v = [
                at["x"]
                - (-1) ** k * at[f"x{i}"]
                - sum(
                    (c * at[f"W{i},{m}"] for m, c in enumerate(couplings(k))), np.zeros((n, total))
                )
                for k in range(orders[i] + 1)
            ]
            own = d if shorter is None else shorter[i] / self._T
            columns[f"R{i}"] = product(f, f, weight=0.5 * (own / s) ** 2) - sum(
                product(term, term, weight=0.5 * (2 * k + 1) / s**2) for k, term in enumerate(v)
            )
            if not self._any_age[i]:
                here, there = at["x"], at[f"x{i}"]
                columns[f"Q{i}"] = product(here, here, weight=0.5) - product(
                    there, there, weight=0.5
                )
            for k in range(orders[i]):
                bessel.append((f"Q{i}", len(y), (2 * k + 1) * s**2 / d))
                y.append(own / s * at[f"W{i},{k}"])
                rate.append(v[k] / s)
        columns["P"] = product(np.concatenate(y), np.concatenate(rate))
        if p:
            q = np.asarray(sum(H @ x for H, x in zip(self._H, on, strict=True)))
            for name, (columns_of_E, rows_of_H) in self._blocks.items():
                here, there = q[rows_of_H], at["p"][columns_of_E]
                columns[name] = svec(here.T @ here - there.T @ there)[:, None]
        constant = np.zeros((total, total))
        ratio = np.zeros((total * (total + 1) // 2, 0))
        if self._performance:
            z = np.asarray(sum(D @ x for D, x in zip(self._D, on, strict=True)))
            z = z + self._D1 @ at["w"]
            supplied = gamma * at["w"].T @ at["w"]
            constant = z.T @ z / gamma - (supplied if fixed else 0.0)
            ratio = ratio if fixed else svec(supplied)[:, None]

        unknowns = self._unknowns(delays)
        whole = np.column_stack([-columns[name] for name in unknowns] + [ratio])
        constraints = [Constraint(total, -svec(constant), whole)]
        first, places = 0, {}
        for name, size in unknowns.items():
            places[name] = slice(first, first + size * (size + 1) // 2)
            first = places[name].stop
        for name, size in unknowns.items():
            block = np.zeros((size * (size + 1) // 2, whole.shape[1]))
            block[:, places[name]] = product(np.eye(size), np.eye(size), weight=0.5)
            if name == "P":
                for Q, row, weight in bessel:
                    part = np.eye(n, size, row * n)
                    block[:, places[Q]] += product(part, part, weight=0.5 * weight)
            constraints.append(Constraint(size, np.zeros(len(block)), block))
        return constraints

    def _variables(
        self, point: Array, delays: Sequence[float], gamma: float | None, *, down_to_zero: bool
    ) -> AnalysisVariables:
        values, start = {}, 0
        for name, size in self._unknowns(delays).items():
            count = size * (size + 1) // 2
            values[name] = symmetric(point[start : start + count], size)
            start += count
        S, times, orders = np.diag(self._back), self._times(delays), self._orders()
        parts = [S]
        for i, _, s in times:
            parts += [S / (self._T * s)] * orders[i]
        whole = scipy.linalg.block_diag(*parts)
        return AnalysisVariables(
            order=self.order,
            P=self._T * whole.T @ values["P"] @ whole,
            Q=tuple(None if self._any_age[i] else S @ values[f"Q{i}"] @ S for i, _, _ in times),
            R=tuple(S @ values[f"R{i}"] @ S / s**2 for i, _, s in times),
            eps=self._multipliers(values),
            gamma=gamma,
            lower=tuple(None if self._any_age[i] else 0.0 for i, _, _ in times)
            if down_to_zero
            else None,
        )
