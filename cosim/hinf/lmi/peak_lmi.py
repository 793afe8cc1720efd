"""The peak of the control for the solver, for a gain that is given: the least bound on u.

`cosim.hinf.certificate.control_limits` defines the bounds and proves the result. With the level
of V counted as one and Y = K X everything is affine in X, Qbar, R, eps and mu but for the
level of the initial state, x0'(P + P S P) x0 with S = sum_j dj Qbar_j. From
(X - theta (X + S))' (X + S)^-1 (X - theta (X + S)) >= 0 follows, for any number theta,

    X (X + S)^-1 X >= T = theta (2 - theta) X - theta^2 S,

so that [[1 - mu energy^2, x0'], [x0, T]] >= 0 keeps the level below one; where every Qbar is
zero, theta = 1 loses nothing. Then K_i X K_i' <= t limit_i^2, and the least t is sought.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hinf.certificate import (
    PeakControl,
    offset_corners,
    peak_system,
    proved_peaks,
    theorem_2_proof,
)
from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi.conic import TOLERANCE, Constraint, Solution
from cosim.hinf.lmi.problem import Answer, Problem
from cosim.hinf.lmi.scaling import Scaling, scaling_of
from cosim.hinf.lmi.solver_status import not_found, solver_words
from cosim.hinf.lmi.svec import Array
from cosim.hinf.lmi.weighed import At
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.theorems import Inequality, Scalars

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

THETAS = (1.0, 0.6, 0.3, 0.1)
_ABOVE_LEAST = (1e-3, 1e-2, 1e-1)
_TRIES = 2
"""How many k1, k2 are gone on with, those of the least peak first."""
_SHARE = "share of the limits"


@dataclass(frozen=True)
class AtLevel(Scalars):
    """`Scalars`, the level that bounds V, and theta of the module's text."""

    level: float
    theta: float


def level_inequalities(
    system: DelaySystem, design_constraints: DesignConstraints, *, bounded: bool
) -> list[Inequality]:
    """Return [[level - gamma energy^2, x0'], [x0, T]] > 0 for every corner of the offset.

    The parameters are `AtLevel`; x0 is counted in what the rows say (`level_units`).

    Parameters
    ----------
    bounded : whether there is a gamma.
    """
    energy, made = exact(design_constraints.energy or 0.0), []
    for i, corner in enumerate(offset_corners(design_constraints.offset or ()) or [()]):
        rows = {"V": 1} | ({"V of x": len(corner)} if corner else {})
        form = Inequality(f"level of V {i}", rows)
        form.number(None, form.row("V"), lambda p: p.level)
        if bounded and energy:
            form.number("gamma", form.row("V"), -(energy**2))
        if corner:
            at = form.row("V of x")
            form.twice(None, exact_matrix(np.array([corner]).T) * form.row("V"), at)
            form.square("X", at, lambda p: p.theta * (2 - p.theta))
            for j, delay in enumerate(system.delays):
                if not delay.any_age and delay.d > 0:
                    form.square(f"Q[{j}]", at, lambda p, j=j: -p.d[j] * p.theta**2)
        made.append(form)
    return made


def level_units(units: Scaling) -> dict[str, Array]:
    """Return the units of the rows of `level_inequalities`; V counts in T."""
    root = np.sqrt(units.T)
    return {"V": np.full(1, 1.0 / root), "V of x": root / units.state}


class PeakProblem(Problem):
    """The LMI of `peak_system` with a gain, V below a level and K_i X K_i' <= share limit_i^2.

    Offset and energy are counted in a unit so that the level is one, K and the limits as shares
    of their largest.
    """

    def __init__(
        self, system: DelaySystem, gain: Matrix, design_constraints: DesignConstraints
    ) -> None:
        inner = peak_system(system, energy=bool(design_constraints.energy))
        self._gain, self._asked = gain, design_constraints
        units = scaling_of(inner)
        offset = np.array(design_constraints.offset or np.zeros(len(system.A))) / units.state
        energy = (design_constraints.energy or 0.0) / (units.a * np.sqrt(units.T))
        limits = np.array(design_constraints.peak_control or units.input) / units.input
        self._largest_gain = float(np.abs(units.gain(gain)).max(initial=0.0)) or 1.0
        self._largest_limit = float(limits.max())
        self._unit = max(float(offset.max()), energy)
        self._theta, self._least_share = 1.0, np.inf
        self._near: Answer | None = None
        super().__init__(inner, scaling=units)

    def least(self, p: Scalars) -> float | None:
        """Minimise the share of the limits; None: no point found. Rescales X to about one."""
        program = self._program(self._gain)
        best: tuple[float, float, list[Constraint], Solution] | None = None
        for theta in THETAS if self.has_free_Q else THETAS[:1]:
            self._theta = theta
            main, others = program.constraints(at=self._at(p))
            solution = self._solve([*main, *others], program.cost([_SHARE]), TOLERANCE)
            if not solution.usable or solution.value <= 0:
                continue
            if best is None or solution.value < best[0]:
                best = (solution.value, theta, main, solution)
        if best is None:
            return None
        value, self._theta, main, solution = best
        unit = self._largest_gain * self._unit / self._largest_limit
        n = len(self.system.A)
        size = float(program.trace("X") @ solution.y) / n
        answer = self._answer(program, main, solution, p, self._gain, {}, 1.0)
        self._unit *= float(np.sqrt(size))
        self._near = replace(answer, scale=answer.scale / size)
        self._least_share = value / size
        return float(np.sqrt(value) * unit)

    def near(self, p: Scalars, above: float) -> dict[str, Any] | None:
        """Return the unknowns of great margin with a share this much above the least, relative."""
        share = self._least_share * (1 + above) * self._number_units()[_SHARE]
        answer = self._margin(p, {_SHARE: share}, self._gain, self._near, TOLERANCE)
        return answer.unknowns if isinstance(answer, Answer) and answer.value > 0 else None

    @property
    def _is_bounded(self) -> bool:
        return True  # the level of V says how large a solution is to be

    def _inequalities(self, gain: Matrix | None) -> tuple[list[Inequality], list[Inequality]]:
        main, others = super()._inequalities(gain)
        others += level_inequalities(self.system, self._asked, bounded=self.has_gamma)
        for i, limit in enumerate(self._asked.peak_control or ()):
            form = Inequality(f"peak of u[{i}]", {f"u[{i}]": 1})
            u = form.row(f"u[{i}]")
            form.number(_SHARE, u, exact(limit) ** 2)
            form.square("X", exact_matrix(self._gain[[i]].T) * u, -1)
            others.append(form)
        return main, others

    def _parameters(self, p: Scalars) -> Any:
        return AtLevel(p.k1, p.k2, p.d, self.scaling.T * self._unit**2, self._theta)

    def _at(self, p: Scalars) -> At:
        at = super()._at(p)
        return at._replace(rows={**at.rows, "V": 1.0 / self._unit})

    def _row_units(self) -> dict[str, Array]:
        units = self.scaling
        each_u = np.sqrt(units.T) / (units.input * self._largest_gain)
        peaks = {f"u[{i}]": np.full(1, unit) for i, unit in enumerate(each_u)}
        return super()._row_units() | peaks | level_units(units)

    def _number_units(self) -> dict[str, float]:
        share = self._largest_gain**2 / (self.scaling.T * self._largest_limit**2)
        return super()._number_units() | {_SHARE: share}


def proved_peak_control(
    system: DelaySystem,
    gain: Matrix,
    design_constraints: DesignConstraints,
    scalars: Sequence[Scalars],
) -> tuple[PeakControl | None, str]:
    """Prove bounds on u within the limits, close to the least; or return None and why.

    Parameters
    ----------
    system, gain : the loop, with the deployed K.
    design_constraints : with `peak_control`, `offset`, `energy`.
    scalars : k1, k2 to try, the likely ones first.
    """
    offset = tuple(exact(value) for value in design_constraints.offset or ())
    energy = exact(design_constraints.energy or 0.0)
    limits = np.array(design_constraints.peak_control or ())
    inner_system = peak_system(system, energy=energy != 0)
    reason = ""
    problems = [(p, PeakProblem(system, gain, design_constraints)) for p in scalars]
    with solver_words() as words:
        ends = [(problem.least(p), i) for i, (p, problem) in enumerate(problems)]
    enough = [(end, i) for end, i in ends if end is not None]
    for least, i in sorted(enough)[:_TRIES]:
        p, problem = problems[i]
        for share in _ABOVE_LEAST:
            with solver_words() as words:
                unknowns = problem.near(p, share)
            if unknowns is None:
                continue
            proof = theorem_2_proof(inner_system, gain, p.k1, p.k2, unknowns)
            failed = proof.failure(inner_system, gain)
            if failed is not None:
                reason = failed
                continue
            peaks = proved_peaks(system, gain, proof, offset, energy)
            if peaks is None:
                reason = "X is as good as singular"
                continue
            if (np.array(peaks) <= limits).all():
                bounds = tuple(exact(value) for value in peaks)
                return PeakControl(bounds, offset, energy, proof), ""
            reason = f"the peaks proved are {', '.join(f'{x:.6g}' for x in peaks)}"
            break
        if least > 1:
            break
    return None, reason or not_found(words)
