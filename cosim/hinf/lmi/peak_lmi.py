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
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.hinf.certificate import PeakControl, failure, offset_corners, peak_system, proved_peaks
from cosim.hinf.exact import exact
from cosim.hinf.lmi.affine import Affine
from cosim.hinf.lmi.assembly import Scalars, Structure
from cosim.hinf.lmi.conic import TOLERANCE, Constraint, Solution
from cosim.hinf.lmi.problem import Answer, Point, Problem, exact_point
from cosim.hinf.lmi.scaling import Scaling, scaling_of
from cosim.hinf.lmi.solver_status import not_found, solver_words
from cosim.hinf.problem import DesignConstraints

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

THETAS = (1.0, 0.6, 0.3, 0.1)
_ABOVE_LEAST = (1e-3, 1e-2, 1e-1)
_TRIES = 2
"""How many k1, k2 are gone on with, those of the least peak first."""


def scaled_design_constraints(
    design_constraints: DesignConstraints, units: Scaling
) -> DesignConstraints:
    """Convert offset, energy and peaks to inner units, where V counts in T, w in a."""
    d = design_constraints
    return replace(
        d,
        peak_control=d.peak_control
        and tuple(float(x) for x in np.array(d.peak_control) / units.input),
        offset=d.offset and tuple(float(x) for x in np.array(d.offset) / units.state),
        energy=d.energy and float(d.energy / (units.a * np.sqrt(units.T))),
    )


def level_constraints(
    structure: Structure, inner: DesignConstraints, level: float, theta: float, width: int
) -> list[Constraint]:
    """Return V <= `level` for every corner of the offset and the energy, as constraints.

    [[level - gamma energy^2, x0'], [x0, T]] >= 0, gamma the structure's own.

    Parameters
    ----------
    structure : its delays and unknowns.
    inner : offset and energy in the structure's units.
    level, theta : numbers, theta of the module's text.
    width : number of unknowns.
    """
    s = structure
    energy = inner.energy or 0.0
    n = s.X.place.shape[0]
    made = []
    for corner in offset_corners(inner.offset or ()) or [()]:
        M = Affine(1 + n if corner else 1).constant(0, 0, np.array([[level]]))
        if s.gamma is not None and energy:
            M.unknown(0, 0, s.gamma.place, -(energy**2))
        if corner:
            M.constant(0, 1, np.array([corner]))
            M.unknown(1, 1, s.X.place, theta * (2 - theta))
            for delay, Q in zip(s.system.delays, s.Q, strict=True):
                if Q is not None and delay.d > 0:
                    M.unknown(1, 1, Q.place, -delay.d * theta**2)
        made.append(M.constraint(width))
    return made


class PeakProblem(Problem):
    """The LMI of `peak_system` with the level of V at one.

    Offset and energy are counted in `unit`, K and the limits as shares of their largest.
    """

    def __init__(
        self, system: DelaySystem, gain: Matrix, design_constraints: DesignConstraints
    ) -> None:
        inner = peak_system(system, energy=bool(design_constraints.energy))
        super().__init__(inner, spare=1, scaling=scaling_of(inner))
        self._gain = gain
        self._design_constraints = scaled_design_constraints(design_constraints, self.scaling)
        self._unit = max(
            *(self._design_constraints.offset or ()), self._design_constraints.energy or 0.0, 0.0
        )
        self._K = self.scaling.gain(gain)
        self._largest_gain = float(np.abs(self._K).max(initial=0.0)) or 1.0
        self._largest_limit = max(self._design_constraints.peak_control or (1.0,))
        self._theta, self._least, self._top = 1.0, np.inf, np.inf
        self._near: Answer | None = None
        self._trace = None  # the level of V says how large a solution is to be
        self._bounds = self._bounded()

    def least(self, p: Scalars) -> float | None:
        """Minimise the share of the limits; None: no point found. Rescales X to about one."""
        q = np.zeros(self._t)
        q[self.structure.spare[0]] = 1.0
        inner = self._inner(p)
        best: tuple[float, float, Solution] | None = None
        for theta in THETAS if any(Q is not None for Q in self.structure.Q) else THETAS[:1]:
            self._theta = theta
            whole = [self._omega(inner, self._gain), *self._signs]
            more = self._more(inner, self._gain, margin=False)
            solution = self._solve([*whole, *more], q, TOLERANCE)
            if not solution.usable or solution.value <= 0:
                continue
            if best is None or solution.value < best[0]:
                best = (solution.value, theta, solution)
        if best is None:
            return None
        value, self._theta, solution = best
        unit = self._largest_gain * self._unit / self._largest_limit
        size = float(np.mean(np.diag(self.structure.X.of(solution.y))))
        self._unit *= float(np.sqrt(size))
        answer = self._answer(solution, inner, self._gain, 1.0)
        self._near = replace(answer, scale=answer.scale / size)
        self._least = value / size
        return float(np.sqrt(value) * unit)

    def near(self, p: Scalars, above: float) -> Point | None:
        """Return a point of great margin with a t this much above the least, relative."""
        self._top = self._least * (1 + above)
        answer = self.margin(p, None, self._gain, self._near)
        return answer.point if isinstance(answer, Answer) and answer.value > 0 else None

    def _more(self, p: Scalars, gain: Matrix | None, *, margin: bool) -> list[Constraint]:
        del p, gain
        d, unit, width = self._design_constraints, self._unit, self._t + 1 if margin else self._t
        counted = replace(
            d,
            offset=tuple(value / unit for value in d.offset or ()),
            energy=(d.energy or 0.0) / unit,
        )
        levels = level_constraints(self.structure, counted, 1.0, self._theta, width)
        return [*levels, *self._peaks(width)]

    def _peaks(self, width: int) -> list[Constraint]:
        """K_i X K_i' <= t limit_i^2; t <= top where it is given."""
        place, X = self.structure.spare[None, :1], self.structure.X.place
        limits = np.array(self._design_constraints.peak_control or ()) / self._largest_limit
        K = self._K / self._largest_gain
        made = []
        for row, limit in zip(K, limits, strict=True):
            M = Affine(1).unknown(0, 0, place, limit**2)
            products = np.outer(row, row)
            for index in np.unique(X):
                M.term(0, 0, int(index), np.array([[-products[index == X].sum()]]))
            made.append(M.constraint(width))
        if np.isfinite(self._top):
            M = Affine(1).constant(0, 0, np.array([[self._top]]))
            made.append(M.unknown(0, 0, place, -1.0).constraint(width))
        return made


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
                point = problem.near(p, share)
            if point is None:
                continue
            v = exact_point(inner_system, point, p)
            failed = failure(inner_system, gain, v)
            if failed is not None:
                reason = failed
                continue
            peaks = proved_peaks(system, gain, v, offset, energy)
            if peaks is None:
                reason = "X is as good as singular"
                continue
            if (np.array(peaks) <= limits).all():
                bounds = tuple(exact(value) for value in peaks)
                return PeakControl(bounds, offset, energy, v), ""
            reason = f"the peaks proved are {', '.join(f'{x:.6g}' for x in peaks)}"
            break
        if least > 1:
            break
    return None, reason or not_found(words)
