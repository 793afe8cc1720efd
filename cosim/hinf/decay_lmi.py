"""A rate of decay for the solver: the LMI of the shifted system at all corners at once.

`cosim.hinf.decay` defines the corners and proves the result.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.hinf.assembly import Scalars
from cosim.hinf.conic import Constraint
from cosim.hinf.decay import Decay, acting_delays, corners, growth_of
from cosim.hinf.not_achievable import without_performance
from cosim.hinf.problem import Answer, Problem
from cosim.hinf.proof import exact_point
from cosim.hinf.rational import exact
from cosim.hinf.scaling import Scaling
from cosim.hinf.search import starts
from cosim.hinf.solver_status import not_found, solver_words
from cosim.hinf.svec import svec
from cosim.models import DelaySystem

if TYPE_CHECKING:
    from cosim.models import Matrix

_DIGITS = 3  # of margins that are compared: those behind them may differ between machines


def shifted_systems(system: DelaySystem, rate: float) -> list[DelaySystem]:
    """Return the shifted system at each corner, as doubles, without w and z; outermost last."""
    growth = growth_of(system, rate)
    acting = acting_delays(system)
    ends = corners(tuple(exact(value) for value in growth), acting)
    return [_shifted(system, rate, tuple(float(s) for s in corner)) for corner in ends]


def _shifted(system: DelaySystem, rate: float, growth: tuple[float, ...]) -> DelaySystem:
    n = system.A.shape[0]
    late = [s for s, delay in zip(growth, system.delays, strict=True) if delay.feedback]
    return replace(
        without_performance(system),
        A=system.A + rate * np.eye(n),
        B=system.B * (late[0] if late else 1.0),
        delays=tuple(
            replace(x, A=s * x.A, H=s * x.H) for s, x in zip(growth, system.delays, strict=True)
        ),
    )


class CornersProblem(Problem):
    """The LMIs of all corners, with the unknowns of one; k1, k2 are arguments.

    Slopes by k1, k2 are those of the outermost corner, which is the one that binds.
    """

    def __init__(self, system: DelaySystem, rate: float, scaling: Scaling | None = None) -> None:
        *others, outermost = shifted_systems(system, rate)
        super().__init__(outermost, scaling=scaling)
        self._others = [Problem(corner, scaling=self.scaling) for corner in others]

    def constraints(self, p: Scalars) -> list[Constraint]:
        """-Omega >= 0 at every corner, X >= 0, and every Q >= 0; in inner units."""
        inner = self._inner(p)
        return [self._omega(inner), *self._more(inner, None, margin=False), *self._signs]

    def _more(self, p: Scalars, gain: Matrix | None, *, margin: bool) -> list[Constraint]:
        whole = [other._omega(p, gain) for other in self._others]  # noqa: SLF001 - of one kind
        one = svec(np.eye(self.structure.rows))
        return [constraint.less(one) for constraint in whole] if margin else whole


def corner_scalars(
    system: DelaySystem, rate: float, p: Scalars, gain: Matrix | None = None
) -> list[Scalars]:
    """Return k1, k2 feasible for the outermost corner alone: `p`, and the best fixed start."""
    outermost = Problem(shifted_systems(system, rate)[-1])
    found: list[tuple[float, int, Scalars]] = []
    for at in starts(p):
        answer = outermost.margin(at, None, gain)
        if isinstance(answer, Answer) and answer.value > 0:
            found.append((float(f"{-answer.value:.{_DIGITS}g}"), len(found), at))
            if gain is not None and at is p:
                break
    likely = [at for _, _, at in sorted(found)[:1]]
    return [p, *(at for at in likely if at is not p)] if any(x[2] is p for x in found) else likely


def proved_decay(
    system: DelaySystem, gain: Matrix, rate: float, p: Scalars
) -> tuple[Decay | None, str]:
    """Prove that the loop decays at `rate`; return the proof, or None and why.

    Parameters
    ----------
    system, gain : the loop, with the deployed K.
    rate : [1/s].
    p : k1, k2 to try first.
    """
    growth = tuple(exact(value) for value in growth_of(system, rate))
    problem = CornersProblem(system, rate)
    reason = ""
    with solver_words() as words:
        for at in corner_scalars(system, rate, p, gain):
            weights = None
            for _ in range(2):
                answer = problem.margin(at, None, gain, weights)
                if not isinstance(answer, Answer) or answer.value <= 0:
                    break
                decay = Decay(exact(rate), growth, exact_point(system, answer.point, at))
                failed = decay.failure(system, gain)
                if failed is None:
                    return decay, ""
                reason, weights = failed, answer.scale
    return None, reason or not_found(words)
