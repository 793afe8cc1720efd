"""Search the level that bounds V, for a limit on the peak of the control.

A low level bounds the state, a high one leaves the gain free: gamma is least in between. The
search tries the level that a design without the limit reaches and some around it, then smaller
steps from the best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.certificate import offset_corners
from cosim.hinf.lmi import THETAS, Answer, ConstrainedProblem, Solution
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.theorems import Scalars

_COARSE = tuple(math.log(4.0) * k for k in range(-1, 4))
_FINE = (math.log(2.0), math.log(1.4), math.log(1.2))
"""Logarithms of the factors tried on the natural level, and of the steps from the best."""


@dataclass(frozen=True)
class Level:
    """Logarithm of a level of V, in a problem's units, and theta of `peak_lmi`."""

    log: float
    theta: float

    def apply_to(self, problem: ConstrainedProblem) -> None:
        """Bound V by this level in `problem`."""
        problem.set_level(math.exp(self.log), self.theta)


def best_level(
    problem: ConstrainedProblem,
    p: Scalars,
    design_constraints: DesignConstraints,
    near: Level | None,
) -> Level | None:
    """Find the level of least gamma; None where no level has a solution.

    Parameters
    ----------
    problem : with all constraints except the level.
    p : k1, k2 and the delays.
    design_constraints : in the system's units.
    near : the level to start from; None: the natural one.
    """

    def value(level: Level) -> float:
        level.apply_to(problem)
        answer = _optimum(problem, p)
        if not isinstance(answer, Answer):
            return math.inf
        return answer.value if problem.has_gamma else -answer.value

    around = [near] if near is not None else _around_natural(problem, p, design_constraints)
    if not around:
        return None
    best, at = min(((value(level), level) for level in around), key=lambda x: x[0])
    for step in _FINE:
        for other in (Level(at.log - step, at.theta), Level(at.log + step, at.theta)):
            here = value(other)
            if here < best:
                best, at = here, other
                break
    return at if math.isfinite(best) else None


def level_of(
    X: NDArray[np.float64], gamma: float | None, design_constraints: DesignConstraints
) -> float:
    """Return the level that V reaches from the offset with the energy, without Qbar."""
    corners = np.array(offset_corners(design_constraints.offset or ()), dtype=float).reshape(
        -1, len(X)
    )
    levels = [float(x @ np.linalg.solve(X, x)) for x in corners]
    return max(levels, default=0.0) + (gamma or 0.0) * (design_constraints.energy or 0.0) ** 2


def _around_natural(
    problem: ConstrainedProblem, p: Scalars, design_constraints: DesignConstraints
) -> list[Level]:
    free = _optimum(problem, p)
    if not isinstance(free, Answer):
        return []
    try:
        natural = math.log(
            level_of(free.unknowns["X"], free.unknowns.get("gamma"), design_constraints)
            / problem.scaling.T
        )
    except (np.linalg.LinAlgError, ValueError):
        return []  # the solver failed at a point where X is singular, or the level not positive
    thetas = THETAS if problem.has_free_Q else THETAS[:1]
    return [Level(natural + step, theta) for theta in thetas for step in _COARSE]


def _optimum(problem: ConstrainedProblem, p: Scalars) -> Answer | Solution:
    """Return the least gamma, or the greatest margin where there is no gain to bound."""
    return problem.least_gamma(p) if problem.has_gamma else problem.margin(p, None)
