"""A rate of decay for the solver: the LMI of the shifted system at all corners at once.

`cosim.hinf.certificate.decay` defines the corners and proves the result.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.hinf.certificate import acting_delays, corners, growth_of
from cosim.hinf.exact import exact
from cosim.hinf.lmi.assembly import Scalars
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.problem import Problem, without_performance
from cosim.hinf.lmi.scaling import Scaling
from cosim.hinf.lmi.svec import svec
from cosim.models import DelaySystem

if TYPE_CHECKING:
    from cosim.models import Matrix


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
        *self._inner_corners, outermost = shifted_systems(system, rate)
        super().__init__(outermost, scaling=scaling)

    def _set_units(self, units: Scaling) -> None:
        super()._set_units(units)
        self._others = [Problem(corner, scaling=units) for corner in self._inner_corners]

    def constraints(self, p: Scalars) -> list[Constraint]:
        """-Omega >= 0 at every corner, X >= 0, and every Q >= 0; in inner units."""
        inner = self._inner(p)
        return [self._omega(inner), *self._more(inner, None, margin=False), *self._signs]

    def _more(self, p: Scalars, gain: Matrix | None, *, margin: bool) -> list[Constraint]:
        whole = [other._omega(p, gain) for other in self._others]  # noqa: SLF001 - of one kind
        one = svec(np.eye(self.structure.rows))
        return [constraint.less(one) for constraint in whole] if margin else whole
