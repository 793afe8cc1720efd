"""A rate of decay for the solver: the LMI of the shifted system at all corners at once.

`cosim.hinf.certificate.decay` defines the corners and proves the result.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.hinf.certificate import acting_delays, corners, growth_of
from cosim.hinf.exact import exact
from cosim.hinf.lmi.problem import Problem, without_performance
from cosim.hinf.lmi.scaling import Scaling
from cosim.hinf.theorems import Inequality, Shift, minus_omega_of_scalars
from cosim.models import DelaySystem

if TYPE_CHECKING:
    from cosim.models import Matrix


class CornersProblem(Problem):
    """The LMIs of the shifted system, with the unknowns of one; k1, k2 are arguments.

    Parameters
    ----------
    system, rate : Eq. (7), and the rate of decay [1/s].
    outermost : of the corner alone at which everything that acts through a delay grows most.
    scaling : the units; None: those of the outermost corner.
    """

    def __init__(
        self,
        system: DelaySystem,
        rate: float,
        *,
        outermost: bool = False,
        scaling: Scaling | None = None,
    ) -> None:
        self._of, self._rate, self._first = system, rate, -1 if outermost else 0
        shifted = _shifted(without_performance(system), rate, growth_of(system, rate))
        super().__init__(shifted, scaling=scaling)

    def _inequalities(self, gain: Matrix | None) -> tuple[list[Inequality], list[Inequality]]:
        return at_corners(self._of, self._rate, gain)[self._first :], self._positive()


def at_corners(system: DelaySystem, rate: float, gain: Matrix | None = None) -> list[Inequality]:
    """Return -Omega of the shifted system at every corner, the outermost last."""
    growth = tuple(exact(s) for s in growth_of(system, rate))
    return [
        minus_omega_of_scalars(system, bounded=False, gain=gain, shift=Shift(exact(rate), corner))
        for corner in corners(growth, acting_delays(system))
    ]


def _shifted(system: DelaySystem, rate: float, growth: tuple[float, ...]) -> DelaySystem:
    """Return the shifted system in doubles, which says in which units to solve."""
    of_u = [s for s, delay in zip(growth, system.delays, strict=True) if delay.feedback]
    return replace(
        system,
        A=system.A + rate * np.eye(len(system.A)),
        B=system.B * (of_u[0] if of_u else 1.0),
        delays=tuple(
            replace(x, A=s * x.A, H=s * x.H) for s, x in zip(growth, system.delays, strict=True)
        ),
    )
