"""Least gamma and greatest margin of the LMI of Theorem 2 of one system.

The inequality is compiled once (`cosim.hinf.lmi.program`), in units in which its numbers are near
one (`cosim.hinf.lmi.scaling`): other k1, k2, d take new weights, another gamma another constant.
Its rows are counted in units of their own, so that

* rows x_j, which the theorem multiplies by k2j, are divided by sqrt|k2j|;
* Rbar_j is counted in multiples of max(1, dj), and rows s_j in units in which its coefficient is
  at most one: a long delay leaves no small numbers.

Delays that are zero stay zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.hinf.exact import exact_matrix
from cosim.hinf.lmi.conic import TOLERANCE, Constraint, Solution, solve
from cosim.hinf.lmi.products import Indices
from cosim.hinf.lmi.program import Program
from cosim.hinf.lmi.scaling import Scaling, units_of
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.lmi.weighed import At
from cosim.hinf.theorems import (
    Inequality,
    Scalars,
    longest_delay,
    minus_omega_of_scalars,
    positive,
)
from cosim.models import DelaySystem, Matrix

_LARGEST_X = 1e3  # X <= this I bounds the margin
_SHARE = 1e-3  # Q >= this times t: the proof needs Q > 0, which nothing else ensures
_PROGRAMS = 3  # how many are kept: as designed, with a price, and for one gain
_SIZE_OF_Y = "size of Y"
ROUGH_TOLERANCE = 1e-7
"""Tolerance of a search: for a margin of which only the sign matters, and for k1 and k2."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution with its value and its sensitivity to k1 and k2.

    value : the least gamma, or the greatest margin t.
    unknowns : where it is attained, as floats: X, Y, Q[j], R[j], eps[b], and gamma, if any.
    scale : |diagonal of Omega| there, the scale of each row in `units`.
    accurate : whether the solver calls it solved.
    slopes : d value / d (k1_1, ..., k1_N, k2_1, ..., k2_N, d_1, ..., d_N), by the multipliers.
    """

    value: float
    unknowns: dict[str, Any]
    scale: Array
    accurate: bool
    slopes: Array
    units: Scaling


class Problem:
    """The LMI of one system; delays and k1, k2 are arguments.

    Attributes
    ----------
    size : number of unknowns.
    scaling : the units it is solved in.
    has_gamma : whether there is a gain from w to z to bound.
    solve_count : number of solves, the budget of a search.

    A subclass states other inequalities, and its weights may have further parameters. With a
    `scaling` no other units are tried.
    """

    def __init__(self, system: DelaySystem, *, scaling: Scaling | None = None) -> None:
        self.system = system
        self.solve_count = 0
        self.has_gamma = system.has_performance
        units = [scaling] if scaling is not None else units_of(system)
        self._other_units = units[1:]
        self._set_units(units[0])

    def _set_units(self, units: Scaling) -> None:
        self.scaling = units
        self._programs: dict[Any, Program] = {}

    @property
    def size(self) -> int:
        """How many unknowns there are, those included that connect parts."""
        shapes = self._program(None).shapes.values()
        return sum(
            x.height * (x.height + 1) // 2 if x.symmetric else x.height * x.width for x in shapes
        )

    @property
    def has_free_Q(self) -> bool:
        """Whether a delay is constant, so that its Qbar is an unknown."""
        return not all(delay.any_age for delay in self.system.delays)

    def least_gamma(
        self, p: Scalars, gain: Matrix | None = None, tolerance: float = TOLERANCE
    ) -> Answer | Solution:
        """Minimise gamma (Remark 2); the solver's result if it finds no point."""
        return self._in_some_units(lambda: self._least(p, gain, {"gamma": 1.0}, tolerance))

    def priced(self, p: Scalars, price: float, tolerance: float = TOLERANCE) -> Answer | Solution:
        """Minimise gamma + price |Y|, |Y| the largest singular value, both in inner units.

        The least gamma alone is often approached as Y grows without bound; a price keeps the gain
        of its order of magnitude. The value is gamma, there are no slopes. The solver's result if
        it finds no point.
        """

        def ask() -> Answer | Solution:
            answer = self._least(p, None, {"gamma": 1.0, _SIZE_OF_Y: price}, tolerance)
            if isinstance(answer, Solution):
                return answer
            return replace(answer, value=answer.unknowns.get("gamma", 0.0), slopes=np.zeros(0))

        return self._in_some_units(ask)

    def _least(
        self, p: Scalars, gain: Matrix | None, prices: dict[str, float], tolerance: float
    ) -> Answer | Solution:
        """Minimise unknown numbers times their prices, in inner units; the value is in gamma's."""
        if not self.has_gamma:
            raise ValueError("expected a system with w and z, got one without")
        program, at = self._program(gain, sized=_SIZE_OF_Y in prices), self._at(p)
        main, others = program.constraints(at=at)
        q = sum(price * program.cost([name]) for name, price in prices.items())
        solution = self._solve([*main, *others], np.asarray(q), tolerance)
        if not solution.usable:
            return solution
        return self._answer(program, main, solution, p, gain, {}, 1.0 / self.scaling.a**2)

    def margin(
        self,
        p: Scalars,
        gamma: float | None,
        gain: Matrix | None = None,
        near: Answer | None = None,
        tolerance: float = TOLERANCE,
    ) -> Answer | Solution:
        """Maximise t with Omega <= -t diag(scale), X <= 1000, t <= 1; tr X = n without w and z.

        t > 0: the LMI is feasible at this gamma (within the bound on X), t < 0: it is not.
        Omega and X in inner units, the scale of each row that of the answer `near`, or one. The
        solver's result if it finds no point.
        """
        known = {"gamma": gamma} if self.has_gamma and gamma is not None else {}
        return self._in_some_units(lambda: self._margin(p, known, gain, near, tolerance))

    def _margin(
        self,
        p: Scalars,
        known: dict[str, float],
        gain: Matrix | None,
        near: Answer | None,
        tolerance: float,
    ) -> Answer | Solution:
        program, at = self._program(gain), self._at(p)
        main, others = program.constraints(known, at=at)
        scale = np.ones(sum(c.size for c in main))
        if near is not None and near.units is self.scaling:
            scale = near.scale
        # the LMI is homogeneous without w and z: the size of its solution is fixed
        trace = None if self._is_bounded else program.trace("X", known)
        of_parts = zip(main, program.main_rows, strict=True)
        constraints = [c.less(svec(np.diag(scale[rows]))) for c, rows in of_parts]
        for name, c in zip(program.names_of_others, others, strict=True):
            if name.startswith("Q") or (name == "X" and trace is not None):
                constraints.append(c.less(_SHARE * svec(np.eye(c.size))))
                continue
            nothing = np.zeros(c.constant.size)
            constraints.append(c.less(nothing))
            if name == "X":
                constraints.append(c.below(_LARGEST_X).less(nothing))
        last = np.zeros((1, len(program.cost([], known)) + 1))
        last[0, -1] = 1.0
        equal = None
        if trace is None:
            constraints.append(Constraint(1, np.ones(1), -last))
        else:
            equal = np.append(trace, 0.0), float(len(self.system.A))
        solution = self._solve(constraints, -last[0], tolerance, equal)
        if not solution.usable:
            return solution
        return self._answer(program, main, solution, p, gain, known, -1.0)

    def _in_some_units(self, ask: Callable[[], Answer | Solution]) -> Answer | Solution:
        """Return the answer in the present units, or where that fails in the others.

        The others are kept where they solve the problem: one that they hardly solve says little.
        """
        first = ask()
        if isinstance(first, Answer) or first.status != "failed" or not self._other_units:
            return first
        usual, (others,) = self.scaling, self._other_units
        self._set_units(others)
        second = ask()
        if isinstance(second, Answer) and second.accurate:
            self._other_units = [usual]
            return second
        self._set_units(usual)
        return second if isinstance(second, Answer) or second.status == "infeasible" else first

    def lmi(self, p: Scalars, gamma: float | None) -> tuple[list[Constraint], list[Constraint]]:
        """Return the parts of -Omega > 0 at this gamma, and of X > 0, Q_j > 0; inner units."""
        known = {} if gamma is None else {"gamma": gamma}
        return self._program(None).constraints(known, at=self._at(p))

    def unknowns_at(self, y: Array, p: Scalars) -> dict[str, Any]:
        """Return the unknowns of a point of `lmi` by name, in the system's units."""
        return self._program(None).values(y, at=self._at(p))

    def rows_of_parts(self, gain: Matrix | None = None) -> list[Indices]:
        """Return which rows of -Omega each part has, in the order of `lmi`."""
        return self._program(gain).main_rows

    def units_of_rows(self, p: Scalars) -> Array:
        """Return (rows,) units of the rows of -Omega: what multiplies them in `lmi`."""
        units, rows = self._row_units(), self._at(p).rows
        form = self._inequalities(None)[0][0]
        return np.concatenate([units[name] * rows.get(name, 1.0) for name in form.rows])

    # ---- what is solved, and in which units

    @property
    def _is_bounded(self) -> bool:
        """Whether something in the LMI says how large a solution is."""
        return self.has_gamma

    def _inequalities(self, gain: Matrix | None) -> tuple[list[Inequality], list[Inequality]]:
        """Return what is positive by the margin, and what is beside it."""
        form = minus_omega_of_scalars(self.system, bounded=self.has_gamma, gain=gain)
        return [form], self._positive()

    def _positive(self) -> list[Inequality]:
        # R_j of a delay of zero is in nothing else
        return [one for one in positive(self.system) if not one.name.startswith("R")]

    def _program(self, gain: Matrix | None, *, sized: bool = False) -> Program:
        key = None if gain is None else gain.tobytes(), sized
        program = self._programs.pop(key, None) or self._compiled(gain, sized=sized)
        self._programs[key] = program
        if len(self._programs) > _PROGRAMS:  # the one that was asked for longest ago
            del self._programs[next(iter(self._programs))]
        return program

    def _compiled(self, gain: Matrix | None, *, sized: bool) -> Program:
        main, others = self._inequalities(gain)
        units = self._row_units()
        return Program(
            main,
            [*others, *([self._below_size_of_Y()] if sized else [])],
            units,
            units_of_others=units,
            numbers=self._number_units(),
            matrices=self._matrix_units(),
        )

    def _below_size_of_Y(self) -> Inequality:
        """Return [[s I, Y], [Y', s I]] > 0 in inner units."""
        m, n, units = self.system.B.shape[1], len(self.system.A), self.scaling
        form = Inequality(_SIZE_OF_Y, {"Y of u": m, "Y of x": n})
        for name, unit in (("Y of u", units.input), ("Y of x", units.state)):
            form.number(_SIZE_OF_Y, exact_matrix(np.diag(unit)) * form.row(name))
        form.twice("Y", form.row("Y of u"), form.row("Y of x"))
        return form

    def _row_units(self) -> dict[str, Array]:
        units, system = self.scaling, self.system
        S, T, a = units.state, units.T, units.a
        of_H = 1.0 / units.per_block(system, units.c)[1]
        rows = {"x": T / S, "w": np.full(system.C.shape[1], a), "z": np.full(len(system.D), a)}
        for j in range(1, 1 + len(system.delays)):
            rows |= {f"x{j}": T / S, f"s{j}": 1.0 / S}
        root = np.sqrt(T)
        return rows | {"h": of_H, "Y of u": root / units.input, "Y of x": root / S}

    def _number_units(self) -> dict[str, float]:
        units = self.scaling
        eps = {f"eps[{b}]": float(c) ** 2 for b, c in enumerate(units.c)}
        return eps | {"gamma": units.a**-2, _SIZE_OF_Y: 1.0 / units.T}

    def _matrix_units(self) -> dict[str, tuple[Array, Array]]:
        units = self.scaling
        S, U, T = units.state, units.input, units.T
        matrices = {"X": (S / T, S), "Y": (U / T, S)}
        for j in range(len(self.system.delays)):
            matrices |= {f"Q[{j}]": (S / T**2, S), f"R[{j}]": (S / T, S)}
        return matrices

    def _parameters(self, p: Scalars) -> Any:
        """Return the parameters of the weights."""
        return p

    def _at(self, p: Scalars) -> At:
        T = self.scaling.T
        rows = {f"x{j}": abs(T * k2) ** -0.5 for j, k2 in enumerate(p.k2, 1)}
        lengths = {j: d / T for j, d in enumerate(p.d) if d > 0}
        unknowns = {f"R[{j}]": max(1.0, d) for j, d in lengths.items()}
        longest = longest_delay(self.system)
        for j, d in lengths.items():
            size = d * max(1.0, d)
            if longest is not None and j != longest:
                b = lengths[longest]
                size *= b * (b + d) * T**2
            rows[f"s{j + 1}"] = size**-0.5
        return At(self._parameters(p), rows, unknowns)

    # ---- its solution

    def _solve(
        self,
        constraints: Sequence[Constraint],
        q: Array,
        tolerance: float,
        equal: tuple[Array, float] | None = None,
    ) -> Solution:
        self.solve_count += 1
        return solve(constraints, q, equal=equal, tolerance=tolerance)

    def _answer(
        self,
        program: Program,
        main: Sequence[Constraint],
        solution: Solution,
        p: Scalars,
        gain: Matrix | None,
        known: dict[str, float],
        factor: float,
    ) -> Answer:
        y = solution.y[: main[0].columns.shape[1]]
        values = program.values(y, known, at=self._at(p))
        n = len(self.system.A)
        for j in range(len(self.system.delays)):  # what is in no inequality
            values.setdefault(f"Q[{j}]", np.zeros((n, n)))
            values.setdefault(f"R[{j}]", np.eye(n))
        if gain is not None:
            values["Y"] = gain @ values["X"]
        diagonal = np.zeros(sum(c.size for c in main))
        for c, rows in zip(main, program.main_rows, strict=True):
            diagonal[rows] = np.abs(np.diag(c.at(y)))
        scale = np.maximum(diagonal, 1e-9 * diagonal.max())
        slopes = factor * self._slopes(program, p, y, solution.Z[: len(main)], known)
        accurate = solution.status == "solved"
        return Answer(factor * solution.value, values, scale, accurate, slopes, self.scaling)

    def _slopes(
        self,
        program: Program,
        p: Scalars,
        y: Array,
        multipliers: Sequence[Array],
        known: dict[str, float],
    ) -> Array:
        """Return the derivatives of <Z, Omega(y; k1, k2, d)>, and so of the optimum."""
        product = program.product(multipliers, y, known, self._at(p))
        slopes = []
        for name in ("k1", "k2", "d"):
            values: tuple[float, ...] = getattr(p, name)
            for j, middle in enumerate(values):
                if name == "d" and middle == 0:
                    slopes.append(0.0)  # its rows are left out
                    continue
                unit = self.scaling.T if name == "d" else 1.0 / self.scaling.T
                step = 1e-6 * max(abs(middle), 1e-6 * unit)
                ends = [
                    replace(p, **{name: (*values[:j], middle + h, *values[j + 1 :])})
                    for h in (step, -step)
                ]
                above, below = (-product(self._at(end)) for end in ends)
                slopes.append((above - below) / (2 * step))
        return np.array(slopes)


def without_performance(system: DelaySystem) -> DelaySystem:
    """Return the system without w and z."""
    s = system
    return replace(s, C=s.C[:, :0], D=s.D[:0], D1=s.D1[:0, :0], D2=s.D2[:0])
