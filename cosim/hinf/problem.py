"""What is asked of the LMI of one system: the least gamma, the widest margin.

The structure is assembled once (`cosim.hinf.assembly`); every question at other k1, k2, d or
gamma is new weights and a solve (`cosim.hinf.conic`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from cosim.hinf.assembly import Array, Scalars, Structure, Unknown, smat, svec
from cosim.hinf.conic import Cone, Solution, solve

if TYPE_CHECKING:
    from cosim.models.delay_system import DelaySystem, Matrix

_LARGEST_X = 1e3
"""What a margin needs to be bounded: X <= this."""
_Q_SHARE = 1e-3
"""The proof needs Q > 0, and nothing else keeps it off its boundary: Q >= this times t."""


@dataclass(frozen=True, eq=False)
class Point:
    """A solution of the LMI, as floats: X, Y, Q, R (one per delay), eps, gamma."""

    X: Array
    Y: Array
    Q: tuple[Array, ...]
    R: tuple[Array, ...]
    eps: float | None
    gamma: float | None

    @property
    def largest(self) -> float:
        """The largest absolute value of any unknown."""
        matrices = (self.X, self.Y, *self.Q, *self.R)
        scalars = (abs(self.eps or 0.0), abs(self.gamma or 0.0))
        return max(*(float(np.abs(M).max(initial=0.0)) for M in matrices), *scalars)


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution with its value and its sensitivity to k1 and k2.

    value : the least gamma, or the widest margin t.
    point : where it is attained.
    slopes : d value / d (k1_1, ..., k1_N, k2_1, ..., k2_N), by the multipliers.
    """

    value: float
    point: Point
    slopes: Array


class Problem:
    """The LMI of one system; delays and k1, k2 are arguments."""

    def __init__(self, system: DelaySystem) -> None:
        self.structure = Structure(system)
        self._n = system.A.shape[0]
        self._t = self.structure.size
        zeros = np.zeros((self._n, self._n))
        self._signs = [self._cone(self.structure.X, zeros)]
        self._signs += [self._cone(Q, zeros) for Q in self.structure.Q if Q is not None]
        limit = _LARGEST_X * np.eye(self._n)
        self._bounds = [self._cone(self.structure.X, limit, sign=-1.0)]
        # without w and z the LMI is homogeneous: X >= I says how large its solution is to be
        least = zeros if system.has_performance else -np.eye(self._n)
        self._bounds += [self._cone(self.structure.X, least)]
        self._bounds += [
            self._cone(Q, zeros, t=_Q_SHARE) for Q in self.structure.Q if Q is not None
        ]
        one = sparse.csr_array(np.ones((1, 1)))
        self._bounds.append(Cone(np.ones((1, 1)), np.array([self._t]), one))  # t <= 1

    def least_gamma(self, p: Scalars, gain: Matrix | None = None) -> Answer | Solution:
        """Remark 2: the least gamma, or what the solver says instead of one."""
        gamma = self.structure.gamma
        if gamma is None:
            raise ValueError("expected a system with w and z, got one without")
        q = np.zeros(self.structure.size)
        q[gamma.place[0, 0]] = 1.0
        solution = solve([self._omega(p, gain), *self._signs], q)
        if solution.status not in {"solved", "inaccurate"}:
            return solution
        return self._answer(solution.value, p, solution, 1.0, gain)

    def margin(
        self,
        p: Scalars,
        gamma: float | None,
        gain: Matrix | None = None,
        weights: Array | None = None,
    ) -> Answer | None:
        """The largest t with Omega <= -t diag(weights), X <= 1000, t <= 1; None: no answer.

        t > 0 says that the LMI can be met at this gamma (within the bound on X), t < 0 that
        it cannot.
        """
        q = np.zeros(self.structure.size + 1)
        q[self._t] = -1.0
        if weights is None:
            weights = np.ones(self.structure.rows)
        cone = self._omega(p, gain, gamma=gamma, weights=weights)
        solution = solve([cone, *self._bounds], q)
        if solution.status not in {"solved", "inaccurate"}:
            return None
        answer = self._answer(-solution.value, p, solution, -1.0, gain)
        return replace(answer, point=replace(answer.point, gamma=gamma))

    def refuted_below(self, p: Scalars, gamma: float | None) -> float:
        """How large a solution must be, by Farkas' lemma: none has all |unknowns| below this.

        Multipliers Z >= 0 with <Z, -Omega> + <Z_X, X> + sum <Z_Q, Q> = c + r'y and c < 0 leave
        only solutions with r'y >= -c. They come from the solver, are made positive
        semidefinite, and c and r are computed anew, in floating point. 0 says nothing, as
        where the LMI can be met.
        """
        lmi = self._omega(p, None, gamma=gamma)
        q = np.zeros(self.structure.size + 1)
        q[self._t] = -1.0
        weighted = self._omega(p, None, gamma=gamma, weights=np.ones(self.structure.rows))
        solution = solve([weighted, *self._bounds], q)
        # the multiplier of X <= 1000 is left out, and shows up in r
        cones = [lmi, *self._bounds[1:-1]]
        Z = [_positive(z) for z in (solution.Z[0], *solution.Z[2:-1])]
        parts = [float(np.vdot(cone.C, z)) for cone, z in zip(cones, Z, strict=True)]
        c, noise = (
            sum(parts),
            1e-9
            * sum(
                float(np.linalg.norm(cone.C) * np.linalg.norm(z))
                for cone, z in zip(cones, Z, strict=True)
            ),
        )
        r = np.zeros(self.structure.size + 1)
        for cone, z in zip(cones, Z, strict=True):
            r[cone.unknowns] -= cone.flat @ z.ravel()
        if c >= -noise:
            return 0.0
        return -c / max(float(np.abs(r[: self._t]).sum()), 1e-300)

    def size_of(self, p: Scalars, point: Point) -> Array:
        """|diagonal of Omega| at a point: the scale of each row."""
        diagonal = np.abs(np.diag(self._value(p, self._vector(point))))
        scale: Array = np.maximum(diagonal, 1e-9 * diagonal.max())
        return scale

    def _omega(
        self,
        p: Scalars,
        gain: Matrix | None,
        gamma: float | None = None,
        weights: Array | None = None,
    ) -> Cone:
        """-Omega - t diag(weights) >= 0; gamma a number where it is given."""
        lmi = self.structure.at(p)
        A, b = lmi.A, lmi.b
        if gain is not None:
            A = sparse.csc_array(A @ self.structure.with_gain(gain))
        place = self.structure.gamma
        if gamma is not None and place is not None:
            index = int(place.place[0, 0])
            b = b - gamma * A[:, [index]].toarray().ravel()
            A = A @ sparse.diags_array(np.arange(self.structure.size) != index, dtype=float)
        if weights is not None:
            extra = sparse.csc_array(svec(np.diag(weights))[:, None])
            A = sparse.hstack([A, extra])
        return _cone(sparse.csc_array(A), smat(b, self.structure.rows))

    def _cone(self, V: Unknown, C: Array, *, sign: float = 1.0, t: float = 0.0) -> Cone:
        """C + sign V - t I >= 0."""
        n = V.place.shape[0]
        high, low = np.tril_indices(n)
        values = -sign * np.where(low == high, 1.0, np.sqrt(2.0))
        columns = V.place[low, high]
        shape = (len(values), self.structure.size + 1)
        A = sparse.coo_array((values, (np.arange(len(values)), columns)), shape=shape).tolil()
        if t:
            A[:, [self._t]] = t * svec(np.eye(n))[:, None]
        return _cone(sparse.csc_array(A), C)

    def _answer(
        self, value: float, p: Scalars, solution: Solution, sign: float, gain: Matrix | None
    ) -> Answer:
        y = solution.y[: self.structure.size]
        if gain is not None:
            y = self.structure.with_gain(gain) @ y
        s = self.structure
        n = self._n

        def of(V: Unknown | None, otherwise: float) -> Array:
            return V.of(y) if V is not None else otherwise * np.eye(n)

        point = Point(
            X=s.X.of(y),
            Y=s.Y.of(y),
            Q=tuple(of(Q, 0.0) for Q in s.Q),
            R=tuple(of(R, 1.0) for R in s.R),
            eps=None if s.eps is None else float(s.eps.of(y)[0, 0]),
            gamma=None if s.gamma is None else float(s.gamma.of(y)[0, 0]),
        )
        return Answer(value, point, sign * self._slopes(p, y, solution.Z[0]))

    def _slopes(self, p: Scalars, y: Array, Z: Array) -> Array:
        """d <Z, Omega(y; k1, k2)> for each of k1, k2: how the optimum moves with them."""
        slopes = []
        for name in ("k1", "k2"):
            values: tuple[float, ...] = getattr(p, name)
            for j, value in enumerate(values):
                step = 1e-6 * max(abs(value), 1e-6)
                ends = [
                    replace(p, **{name: (*values[:j], value + h, *values[j + 1 :])})
                    for h in (step, -step)
                ]
                above, below = (float(np.vdot(Z, self._value(end, y))) for end in ends)
                slopes.append((above - below) / (2 * step))
        return np.array(slopes)

    def _value(self, p: Scalars, y: Array) -> Array:
        lmi = self.structure.at(p)
        return smat(lmi.A @ y - lmi.b, self.structure.rows)

    def _vector(self, point: Point) -> Array:
        y, s = np.zeros(self.structure.size), self.structure
        pairs: list[tuple[Unknown | None, Array]] = [(s.X, point.X), (s.Y, point.Y)]
        pairs += [*zip(s.Q, point.Q, strict=True), *zip(s.R, point.R, strict=True)]
        for V, value in (*pairs, (s.eps, point.eps), (s.gamma, point.gamma)):
            if V is not None:
                y[V.place] = value
        return y


def _positive(Z: Array) -> Array:
    """The nearest positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(Z)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)


def _cone(A: sparse.csc_array, C: Array) -> Cone:
    """C - sum y_i A_i >= 0 from the columns svec(A_i)."""
    n = C.shape[0]
    use = np.flatnonzero(np.diff(A.indptr))
    part = sparse.coo_array(A[:, use])
    high, low = np.tril_indices(n)
    i, j = low[part.row], high[part.row]
    off = i != j
    values = part.data / np.where(off, np.sqrt(2.0), 1.0)
    entries = (
        np.concatenate([values, values[off]]),
        (
            np.concatenate([part.col * n + i, part.col[off] * n + j[off]]),
            np.concatenate([j, i[off]]),
        ),
    )
    return Cone(C, use, sparse.csr_array(sparse.coo_array(entries, shape=(len(use) * n, n))))
