"""Least gamma and greatest margin of the LMI of one system.

The structure is assembled once (`cosim.hinf.lmi.assembly`), in units in which its numbers are near
one (`cosim.hinf.lmi.scaling`); other k1, k2, d or gamma take new weights and a solve
(`cosim.hinf.lmi.conic`). Arguments and results are in the system's own units.

Where the solver fails in these units, others are tried, and kept if it succeeds there
(`units_of`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from cosim.hinf.certificate import Variables, exact_variables, joined
from cosim.hinf.lmi.affine import Affine
from cosim.hinf.lmi.assembly import Scalars, Structure, Unknown, unit_of_R
from cosim.hinf.lmi.conic import TOLERANCE, Constraint, Solution, solve
from cosim.hinf.lmi.parts import parts_of_system, solve_in_parts
from cosim.hinf.lmi.scaling import Scaling, units_of
from cosim.hinf.lmi.svec import Array, places, svec
from cosim.hinf.theorems import ExactVariables
from cosim.models import DelaySystem, Matrix

_LARGEST_X = 1e3  # X <= this I bounds the margin
_SHARE = 1e-3  # Q >= this times t: the proof needs Q > 0, which nothing else ensures
ROUGH_TOLERANCE = 1e-7
"""Tolerance of a search: for a margin of which only the sign matters, and for k1 and k2."""


@dataclass(frozen=True, eq=False)
class Point:
    """A solution of the LMI, as floats: X, Y, Q, R (one per delay), eps, gamma.

    eps is a tuple where F has several blocks.
    """

    X: Array
    Y: Array
    Q: tuple[Array, ...]
    R: tuple[Array, ...]
    eps: float | tuple[float, ...] | None
    gamma: float | None


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution with its value and its sensitivity to k1 and k2.

    value : the least gamma, or the greatest margin t.
    point : where it is attained.
    scale : |diagonal of Omega| there, the scale of each row in `units`.
    accurate : whether the solver calls it solved.
    slopes : d value / d (k1_1, ..., k1_N, k2_1, ..., k2_N, d_1, ..., d_N), by the multipliers.
    """

    value: float
    point: Point
    scale: Array
    accurate: bool
    slopes: Array
    units: Scaling


class Problem:
    """The LMI of one system; delays and k1, k2 are arguments.

    Attributes
    ----------
    structure : the LMI, in the units of `scaling`.
    has_gamma : whether there is a gain from w to z to bound.
    solve_count : number of solves, the budget of a search.

    A subclass adds constraints by `_more`, with `spare` further unknowns. With a `scaling` no
    other units are tried.
    """

    def __init__(
        self, system: DelaySystem, *, spare: int = 0, scaling: Scaling | None = None
    ) -> None:
        self.system = system
        self.solve_count = 0
        self._n = system.A.shape[0]
        self._spare = spare
        units = [scaling] if scaling is not None else units_of(system)
        self._other_units = units[1:]
        self._set_units(units[0])

    def _set_units(self, units: Scaling) -> None:
        """Assemble the LMI in these units."""
        self.scaling = units
        self.structure = Structure(units.system(self.system), self._spare)
        self.has_gamma = self.structure.gamma is not None
        self._t = self.structure.size
        s, zeros = self.structure, np.zeros((self._n, self._n))
        free = [Q for Q in s.Q if Q is not None]
        self._signs = [self._bound(V, zeros) for V in (s.X, *free)]
        self._trace: tuple[Array, float] | None = None
        if self.has_gamma:
            self._bounds = self._bounded()
        else:
            # the LMI is homogeneous: fix the size of its solution
            trace = np.zeros(self._t + 1)
            trace[np.diag(s.X.place)] = 1.0
            self._trace = (trace, float(self._n))
            self._bounds = [self._bound(V, zeros, t=_SHARE) for V in (*free, s.X)]

    def _bounded(self) -> list[Constraint]:
        """Return the bounds X <= 1000 I and t <= 1 of a margin at a given gamma."""
        X, zeros = self.structure.X, np.zeros((self._n, self._n))
        limit = _LARGEST_X * np.eye(self._n)
        last = scipy.sparse.csc_array(([-1.0], ([0], [self._t])), shape=(1, self._t + 1))
        free = [Q for Q in self.structure.Q if Q is not None]
        return [
            *(self._bound(Q, zeros, t=_SHARE) for Q in free),
            self._bound(X, limit, sign=-1.0, t=0.0),
            self._bound(X, zeros, t=0.0),
            Constraint(1, np.ones(1), last),
        ]

    def least_gamma(
        self, p: Scalars, gain: Matrix | None = None, tolerance: float = TOLERANCE
    ) -> Answer | Solution:
        """Minimise gamma (Remark 2); the solver's result if it finds no point."""
        return self._in_some_units(lambda: self._least_gamma(p, gain, tolerance))

    def _least_gamma(self, p: Scalars, gain: Matrix | None, tolerance: float) -> Answer | Solution:
        gamma = self.structure.gamma
        if gamma is None:
            raise ValueError("expected a system with w and z, got one without")
        q = np.zeros(self._t)
        q[gamma.place[0, 0]] = 1.0
        inner = self._inner(p)
        more = self._more(inner, gain, margin=False)
        constraints = [self._omega(inner, gain), *self._signs, *more]
        solution = self._solve(constraints, q, tolerance, gain=gain)
        if not solution.usable:
            return solution
        return self._answer(solution, inner, gain, 1.0 / self.scaling.a**2)

    def priced(self, p: Scalars, price: float, tolerance: float = TOLERANCE) -> Answer | Solution:
        """Minimise gamma + price |Y|, |Y| the largest singular value, both in inner units.

        The least gamma alone is often approached as Y grows without bound; a price keeps the gain
        of its order of magnitude. The solver's result if it finds no point; no slopes.
        """
        return self._in_some_units(lambda: self._priced(p, price, tolerance))

    def _priced(self, p: Scalars, price: float, tolerance: float) -> Answer | Solution:
        s, inner = self.structure, self._inner(p)
        if s.gamma is None:
            raise ValueError("expected a system with w and z, got one without")
        (m, n), size = s.Y.place.shape, s.size
        q = np.zeros(size + 1)
        q[s.gamma.place[0, 0]], q[size] = 1.0, price
        below = Affine(m + n).term(0, 0, size, np.eye(m)).term(m, m, size, np.eye(n))
        below.unknown(0, m, s.Y.place)
        whole = [self._omega(inner), *self._signs]
        constraints = [c.less(np.zeros(len(c.constant))) for c in whole]
        constraints.append(below.constraint(size + 1))
        solution = self._solve(constraints, q, tolerance)
        if not solution.usable:
            return solution
        found = self._answer(solution, inner, None, 1.0)
        return replace(found, value=found.point.gamma or 0.0, slopes=np.zeros(0))

    def margin(
        self,
        p: Scalars,
        gamma: float | None,
        gain: Matrix | None = None,
        near: Answer | None = None,
        tolerance: float = TOLERANCE,
    ) -> Answer | Solution:
        """Maximise t with Omega <= -t diag(scale), X <= 1000, t <= 1; tr X = n without gamma.

        t > 0: the LMI is feasible at this gamma (within the bound on X), t < 0: it is not.
        Omega and X in inner units, the scale of each row that of the answer `near`, or one. The
        solver's result if it finds no point.
        """
        return self._in_some_units(lambda: self._margin(p, gamma, gain, near, tolerance))

    def _margin(
        self,
        p: Scalars,
        gamma: float | None,
        gain: Matrix | None,
        near: Answer | None,
        tolerance: float,
    ) -> Answer | Solution:
        q = np.zeros(self._t + 1)
        q[self._t] = -1.0
        inner = self._inner(p)
        own = np.ones(self.structure.rows)
        if near is not None and near.units is self.scaling:
            own = near.scale
        whole = self._omega(inner, gain, gamma).less(svec(np.diag(own)))
        more = self._more(inner, gain, margin=True)
        constraints = [whole, *self._bounds, *more]
        solution = self._solve(constraints, q, tolerance, self._trace, gain=gain)
        if not solution.usable:
            return solution
        answer = self._answer(solution, inner, gain, -1.0)
        return (
            answer if gamma is None else replace(answer, point=replace(answer.point, gamma=gamma))
        )

    def _in_some_units(self, ask: Callable[[], Answer | Solution]) -> Answer | Solution:
        """Return the answer in the present units, or where that fails in the others.

        The others are kept where they solve the problem: one that they hardly solve says little.
        """
        found = ask()
        if isinstance(found, Answer) or found.status != "failed" or not self._other_units:
            return found
        usual, (others,) = self.scaling, self._other_units
        self._set_units(others)
        other = ask()
        if isinstance(other, Answer) and other.accurate:
            self._other_units = [usual]
            return other
        self._set_units(usual)
        return other if isinstance(other, Answer) or other.status == "infeasible" else found

    def lmi(self, p: Scalars, gamma: float | None) -> list[Constraint]:
        """Return -Omega >= 0 at this gamma, X >= 0, and Q_j >= 0 where it is free; inner units."""
        return [self._omega(self._inner(p), None, gamma), *self._signs]

    def _more(self, p: Scalars, gain: Matrix | None, *, margin: bool) -> list[Constraint]:
        """Return further constraints in inner units, with or without an unknown t; none here."""
        del p, gain, margin
        return []

    def _inner(self, p: Scalars) -> Scalars:
        T = self.scaling.T
        k1, k2 = (tuple(T * value for value in values) for values in (p.k1, p.k2))
        return Scalars(k1, k2, tuple(d / T for d in p.d))

    def _solve(
        self,
        constraints: list[Constraint],
        q: Array,
        tolerance: float,
        equal: tuple[Array, float] | None = None,
        *,
        gain: Matrix | None = None,
    ) -> Solution:
        self.solve_count += 1
        if type(self) is not Problem:  # further constraints may connect the parts of a system
            return solve(constraints, q, equal=equal, tolerance=tolerance)
        part = parts_of_system(self.structure.system, gain)
        rows = [part[name if name in part else "x"] for name in self.structure.offset]
        labels = [np.concatenate(rows)] + [
            part["x"] if c.size == self._n else None for c in constraints[1:]
        ]
        return solve_in_parts(constraints, labels, q, equal=equal, tolerance=tolerance)

    def _omega(
        self, p: Scalars, gain: Matrix | None = None, gamma: float | None = None
    ) -> Constraint:
        """Return -Omega >= 0; gamma a number where it is given."""
        lmi = self.structure.at(p)
        constant, columns = lmi.constant, lmi.columns
        if gain is not None:
            columns = scipy.sparse.csc_array(
                columns @ self.structure.with_gain(self.scaling.gain(gain))
            )
        place = self.structure.gamma
        if gamma is not None and place is not None:
            unit = np.zeros(self._t)
            unit[place.place[0, 0]] = 1.0
            constant = constant + gamma * self.scaling.a**2 * (columns @ unit)
            columns = scipy.sparse.csc_array(columns @ scipy.sparse.diags_array(1.0 - unit))
        return Constraint(lmi.size, constant, columns)

    def _bound(
        self, V: Unknown, C: Array, *, sign: float = 1.0, t: float | None = None
    ) -> Constraint:
        """Return C + sign V >= t y_last I; without a last unknown where t is None."""
        n = self._n
        rows, columns, factors = places(n)
        place, entries = V.place[rows, columns], sign * factors
        width = self._t if t is None else self._t + 1
        matrix = scipy.sparse.csc_array(
            (entries, (np.arange(len(place)), place)), (len(place), width)
        )
        if t:
            unit = scipy.sparse.csc_array(np.eye(1, width, self._t))
            matrix = scipy.sparse.csc_array(
                matrix - scipy.sparse.kron(t * svec(np.eye(n))[:, None], unit)
            )
        return Constraint(n, svec(C), matrix)

    def _answer(self, solution: Solution, p: Scalars, gain: Matrix | None, factor: float) -> Answer:
        s, units = self.structure, self.scaling
        y = solution.y[: self._t]
        if gain is not None:
            y = s.with_gain(units.gain(gain)) @ y

        def of(V: Unknown | None, power: int, otherwise: float) -> Array:
            return units.back(V.of(y), power) if V is not None else otherwise * np.eye(self._n)

        point = Point(
            X=of(s.X, 1, 0.0),
            Y=units.back_Y(s.Y.of(y)),
            Q=tuple(of(Q, 2, 0.0) for Q in s.Q),
            R=tuple(unit_of_R(d) * of(R, 1, 1.0) for R, d in zip(s.R, p.d, strict=True)),
            eps=None if s.eps is None else joined((units.c**2 * s.eps.of(y)[0]).tolist()),
            gamma=None if s.gamma is None else float(s.gamma.of(y)[0, 0]) / units.a**2,
        )
        diagonal = np.abs(np.diag(s.at(p).at(y)))
        scale = np.maximum(diagonal, 1e-9 * diagonal.max())
        per_unit = np.repeat([units.T, units.T, 1.0 / units.T], len(p.d))
        slopes = factor * per_unit * self._slopes(p, y, solution.Z[0])
        accurate = solution.status == "solved"
        return Answer(factor * solution.value, point, scale, accurate, slopes, units)

    def _slopes(self, p: Scalars, y: Array, Z: Array) -> Array:
        """Return the derivatives of <Z, Omega(y; k1, k2, d)>, and so of the optimum."""
        slopes = []
        multiplier = svec(Z)
        for name in ("k1", "k2", "d"):
            values: tuple[float, ...] = getattr(p, name)
            for j, value in enumerate(values):
                step = 1e-6 * max(abs(value), 1e-6)
                if name == "d" and value == 0:
                    slopes.append(0.0)  # its rows are left out
                    continue
                ends = [
                    replace(p, **{name: (*values[:j], value + h, *values[j + 1 :])})
                    for h in (step, -step)
                ]
                above, below = (float(multiplier @ self._value(end, y)) for end in ends)
                slopes.append((above - below) / (2 * step))
        return np.array(slopes)

    def _value(self, p: Scalars, y: Array) -> Array:
        """Return svec(Omega)."""
        lmi = self.structure.at(p)
        return -np.asarray(lmi.constant + lmi.columns @ y)


def exact_point(system: DelaySystem, point: Point, p: Scalars) -> ExactVariables:
    """Convert a solver's point at k1, k2 to rationals; gamma stays None where it is.

    Raises
    ------
    InputError : as `exact_variables`.
    """
    gamma = 1.0 if point.gamma is None else point.gamma
    v = Variables(point.X, point.Q, point.R, point.eps, p.k1, p.k2, gamma)
    exactly = exact_variables(system, v)
    return exactly if point.gamma is not None else replace(exactly, gamma=None)


def without_performance(system: DelaySystem) -> DelaySystem:
    """Return the system without w and z."""
    s = system
    return replace(s, C=s.C[:, :0], D=s.D[:0], D1=s.D1[:0, :0], D2=s.D2[:0])
