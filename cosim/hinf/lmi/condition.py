"""A sufficient condition for a given loop: its least gamma, and its greatest margin.

The inequalities are those of `cosim.hinf.theorems.ages`, for u = K x with K given linear in all
unknowns. Where every age is constant or any one ("constant", "jensen"), order 0 is Theorem 1: its
free M1j, M2j enter through Lemma 2 alone, [M1 M2]' + [M1 M2] + d [M1 M2]'R^-1 [M1 M2], which is
least at M1 = -R/d, M2 = R/d (complete the square); there Lemma 2 is Jensen's inequality, and
nothing is lost by putting them there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hinf.exact import exact
from cosim.hinf.lmi.conic import Constraint, Solution, solve
from cosim.hinf.lmi.interior_point import solve_dense
from cosim.hinf.lmi.loop_units import channel_units, closed_loop, eps_units, own_units
from cosim.hinf.lmi.margin import TOLERANCE, Solver, widest_margin
from cosim.hinf.lmi.program import Program
from cosim.hinf.lmi.svec import Array
from cosim.hinf.theorems import (
    Age,
    AgesTheorem,
    Inequality,
    Loop,
    Proof,
    Supports,
    constants_down_to_zero,
    corners_of,
    itself,
    minus_phi,
    number_itself,
    positive_of_ages,
    shapes_of_ages,
    widest_functional,
)

if TYPE_CHECKING:
    from cosim.models import DelaySystem

BOUND = 1e3
"""Largest of the positive matrices in the search for a margin, in the solver's own units.

Where w acts weakly they are larger by themselves: P counts in gamma / |C|^2.
"""
_MANY_BLOCKS = 8
"""Blocks of F above which there are few unknowns beside the rows that the blocks add."""
_MOST_TRIED_AGAIN = 400
"""Unknowns up to which the dense solver tries again what Clarabel does not solve: a second or two.

It bears what is badly conditioned: long and short ages in one loop, at a gamma near the least.
"""


class Condition:
    """The condition of one loop at one order, to be solved at any delays.

    Parameters
    ----------
    system : Eq. (7).
    K : (m, n) the gain, zero for the system as it is.
    order : N.
    functionals : by delay, of those that hold for it (`functionals_of`); None: every age constant,
        or any one from zero to its bound ("constant", "jensen").
    performance : bound the gain from w to z, instead of stability alone.
    supports : of every positive delay of `system`; None: the whole state of each.
    dense : whether the normal equations are factorised as dense ones (`interior_point`); None:
        where this is the quicker way.
    """

    def __init__(
        self,
        system: DelaySystem,
        K: Array,
        order: int,
        functionals: Sequence[str] | None = None,
        *,
        performance: bool,
        supports: Supports | None = None,
        dense: bool | None = None,
    ) -> None:
        self.order, self.performance = order, performance
        self.is_plain = functionals is None
        self.functionals: tuple[str, ...] = (
            tuple(map(widest_functional, system.delays))
            if functionals is None
            else tuple(functionals)
        )
        self._system, self._K = system, K
        given = iter(supports or ())
        self._supports = [
            next(given) if supports is not None and x.d > 0 else None for x in system.delays
        ]
        if dense is None:
            many = self.is_plain and len(system.blocks) > _MANY_BLOCKS
            dense = many or supports is not None
        self._solver: Solver = solve_dense if dense else _solve_steadily
        self._quick_solver: Solver = solve_dense if dense else _solve_quickly
        self._back, self._T = own_units(closed_loop(system, K))
        self._channel = channel_units(system, self._back, self._T)
        self._loops: dict[tuple[int, ...], Loop] = {}
        self._kept: dict[Any, tuple[list[Age], Program]] = {}

    def unknowns(self, delays: Sequence[float]) -> int:
        """Return the number of unknowns, a measure of what a solve costs.

        With constant ages and any ones they are counted as if all was one part.
        """
        if not self.is_plain:
            return self._compiled(delays)[1].width - 2 * self.performance
        loop, ages = self._at(delays, self.theorem(delays))
        return sum(
            x.height * (x.width + 1) // 2
            for name, x in shapes_of_ages(loop, ages, bounded=self.performance).items()
            if name not in ("gamma", "1/gamma")
        )

    def corners(self, delays: Sequence[float], *, down_to_zero: bool = False) -> int:
        """Return at how many corners -Phi is shown; `down_to_zero` as of `margin`."""
        _, ages = self._at(delays, self.theorem(delays, down_to_zero=down_to_zero))
        return prod(len(age.corners()) for age in ages)

    def largest_part(self, delays: Sequence[float]) -> int:
        """Return the most rows that -Phi has in one part."""
        return self._compiled(delays)[1].largest

    def least_gamma(self, delays: Sequence[float], reference: float) -> float | None:
        """Return the solver's least gamma near `reference`; None if it finds no point."""
        program, known = self._compiled(delays)[1], {"1/gamma": 1.0 / reference}
        main, others = program.constraints(known, multiples={"gamma": reference})
        cost = program.cost(["gamma"], known)
        solution = self._solver([*main, *others], cost, tolerance=TOLERANCE)
        if not (solution.usable and solution.value > 0):
            return None
        return float(reference * np.sqrt(solution.value))

    def margin(
        self,
        delays: Sequence[float],
        gamma: float | None,
        *,
        down_to_zero: bool = False,
        enough: float = -np.inf,
    ) -> tuple[float, Proof] | None:
        """Return the greatest margin at `gamma`, negative where it is not met, and its point.

        down_to_zero : for every constant delay up to `delays`, not exactly these.
        enough : as of `widest_margin`: no second round for a margin that is not above it.
        """
        bound = greatest(gamma, self._T * self._back[:, None] * self._system.C)
        program = self._compiled(delays, down_to_zero=down_to_zero)[1]
        known = known_gamma(gamma) if self.performance else {}
        constraints = program.constraints(known)
        # where any margin is enough, a point that is not accurate may do
        solver = self._quick_solver if enough == np.inf else self._solver
        centre = widest_margin(*constraints, bound, enough=enough, solver=solver)
        if centre is None:
            return None
        unknowns = program.values(centre[1], known)
        for name in known:
            del unknowns[name]
        unknowns |= {} if gamma is None else {"gamma": gamma}
        return centre[0], Proof(self.theorem(delays, down_to_zero=down_to_zero), unknowns)

    def theorem(self, delays: Sequence[float], *, down_to_zero: bool = False) -> AgesTheorem:
        """Return the theorem at these delays; `down_to_zero` as of `margin`."""
        positive = [i for i, d in enumerate(delays) if d > 0]
        kinds = tuple(self.functionals[i] for i in positive)
        lower = constants_down_to_zero(kinds) if down_to_zero and self.order else None
        supports = tuple(self._supports[i] for i in positive)
        return AgesTheorem(self.order, kinds, supports, lower, is_analysis=self.is_plain)

    def _at(self, delays: Sequence[float], theorem: AgesTheorem) -> tuple[Loop, list[Age]]:
        """Return the loop with these delays, and the terms of the positive ones."""
        changed = [
            replace(x, d=d, least_age=x.least_age if d else 0.0)
            for x, d in zip(self._system.delays, delays, strict=True)
        ]
        late_delays = tuple(i for i, d in enumerate(delays) if d > 0)
        if late_delays not in self._loops:  # of the delays nothing but their lengths is in it
            system = replace(self._system, delays=tuple(changed))
            self._loops[late_delays] = Loop.of(system, self._K, theorem.supports)
        positive = [changed[i] for i in late_delays]
        lengths = [exact(x.d) for x in positive]
        loop = replace(self._loops[late_delays], delays=positive, d=lengths)
        return loop, theorem.ages(loop)

    def _compiled(
        self, delays: Sequence[float], *, down_to_zero: bool = False
    ) -> tuple[list[Age], Program]:
        """Return the ages and the program; the last ones that were asked for are kept."""
        key = tuple(delays), down_to_zero
        if key not in self._kept:
            loop, ages = self._at(delays, self.theorem(delays, down_to_zero=down_to_zero))
            units = self._row_units(loop, ages)
            program = Program(*self._inequalities(loop, ages), units, numbers=self._numbers())
            self._kept = {key: (ages, program)}
        return self._kept[key]

    def _inequalities(
        self, loop: Loop, ages: Sequence[Age]
    ) -> tuple[list[Inequality], list[Inequality]]:
        """Return -Phi at every corner, and what is positive beside it."""
        main = [
            minus_phi(loop, ages, corner, bounded=self.performance) for corner in corners_of(ages)
        ]
        return main, [*positive_of_ages(len(self._back), ages), *bounded(self._system, ages)]

    def _numbers(self) -> dict[str, float]:
        """Return the units of the numbers."""
        return eps_units(self._system, self._channel) | {"gamma": 1.0}

    def _row_units(self, loop: Loop, ages: Sequence[Age]) -> Mapping[str, Array]:
        units = {"x": 1.0 / self._back, "p": self._channel}
        for age, C in zip(ages, loop.support, strict=True):
            size = np.reshape([float(x) for x in C.entries()], (age.width, -1)) / self._back
            norms = np.linalg.norm(size, axis=1)
            norms = np.where(norms > 0, norms, 1.0)
            units |= dict.fromkeys(age.names, norms) | {f"r{age.j}": norms / self._T}
            units[f"v{age.j}"] = np.tile(norms / self._T, 1 + age.late)
        return units


def known_gamma(gamma: float | None) -> dict[str, float]:
    """Return what a given gamma fixes; one where there is none."""
    return {"gamma": gamma or 1.0, "1/gamma": 1.0 / (gamma or 1.0)}


def _solve_steadily(constraints: Sequence[Constraint], q: Array, *, tolerance: float) -> Solution:
    """Minimise by Clarabel; where it is not accurate and the problem is small, by normal equations.

    A point that is not accurate may miss a matrix that must be positive by far more than the
    margin: nothing is proved with it.
    """
    solution = _solve_quickly(constraints, q, tolerance=tolerance)
    if solution.status != "inaccurate" or len(q) > _MOST_TRIED_AGAIN:
        return solution
    again = solve_dense(constraints, q, tolerance=tolerance)
    return again if again.status != "failed" else solution


def _solve_quickly(constraints: Sequence[Constraint], q: Array, *, tolerance: float) -> Solution:
    """Minimise by Clarabel; by normal equations only where it fails and the problem is small."""
    solution = solve(constraints, q, tolerance=tolerance)
    if solution.status != "failed" or len(q) > _MOST_TRIED_AGAIN:
        return solution
    return solve_dense(constraints, q, tolerance=tolerance)


def greatest(gamma: float | None, C: Array) -> float:
    """Return the bound of the other matrices in a search for a margin; `C` in units of the loop."""
    if gamma is None or not C.any():
        return BOUND
    return BOUND * max(1.0, gamma / float(np.linalg.norm(C, 2)) ** 2)


def bounded(system: DelaySystem, ages: Sequence[Age]) -> list[Inequality]:
    """Return what -Phi implies to be positive, to be bounded as well: every eps, and U."""
    looped = (age for age in ages if age.functional == "looped")
    each_U = [itself(f"U[{age.j}]", age.width * (1 + age.late)) for age in looped]
    return each_U + [number_itself(f"eps[{b}]") for b in range(len(system.blocks))]
