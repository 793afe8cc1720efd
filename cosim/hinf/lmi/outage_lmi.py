"""The LMI of outages: one functional for a loop in touch and out of touch, for an SDP solver.

The inequalities are those of `cosim.hinf.theorems.outages`. For given rates alpha and beta they
are linear in all unknowns.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import flint
import numpy as np

from cosim.hinf.certificate import Outages, is_above_exponential, shapes_of_outages
from cosim.hinf.exact import exact
from cosim.hinf.lmi.condition import greatest, known_gamma
from cosim.hinf.lmi.loop_units import channel_units, closed_loop, eps_units, own_units
from cosim.hinf.lmi.margin import widest_margin
from cosim.hinf.lmi.program import Program
from cosim.hinf.lmi.svec import Array
from cosim.hinf.theorems import (
    Modes,
    exact_unknowns,
    minus_phi_of_outages,
    number_itself,
    positive_delays,
    positive_of_outages,
)

if TYPE_CHECKING:
    from fractions import Fraction

    from cosim.models import DelaySystem


class OutageLmi:
    """The LMI of one loop and its fallback, at rates that can be changed.

    Parameters
    ----------
    system : Eq. (7), `outage_delay` its feedback.
    K : (m, n) the gain in touch.
    fallback : (m, n) the gain out of touch.
    fallback_age : its greatest age [s]; 0: it acts at once.
    """

    def __init__(self, system: DelaySystem, K: Array, fallback: Array, fallback_age: float) -> None:
        self._system, self._K = system, K
        self._fallback, self._age = fallback, fallback_age
        self._back, self._T = own_units(closed_loop(system, K))
        self._late = positive_delays(system)
        self.set_rates(1, 1)

    def set_rates(self, alpha: Fraction | int, beta: Fraction | int | None) -> None:
        """Set alpha and beta [1/s]; beta None: in touch alone."""
        self.alpha, self.beta = alpha, beta
        self.rho = [_below_decay(alpha, delay.d) for delay in self._late]

    def is_met(self, gamma: float | None) -> bool:
        """Whether the solver finds a point with a margin; gamma None: of stability alone."""
        centre = self._found(gamma, enough=np.inf)
        return centre is not None and centre[0] > 0

    def central(self, gamma: float | None) -> Outages | None:
        """Return a point of great margin; None if the solver finds none."""
        centre = self._found(gamma, enough=-np.inf)
        if centre is None:
            return None
        values, modes = centre[1], self._modes(gamma)
        for b in range(len(self._system.blocks)):
            values.setdefault(f"eps_out[{b}]", values[f"eps[{b}]"])  # in touch alone
        shapes = shapes_of_outages(self._system, self._K, modes)
        return Outages(**vars(modes), unknowns=exact_unknowns(shapes, values))

    def _modes(self, gamma: float | None) -> Modes:
        return Modes(
            alpha=_rational(self.alpha),
            beta=_rational(self.alpha if self.beta is None else self.beta),
            gamma=None if gamma is None else exact(gamma),
            rho=tuple(exact(x) for x in self.rho),
            fallback=self._fallback,
            fallback_age=self._age,
        )

    def _found(self, gamma: float | None, *, enough: float) -> tuple[float, dict[str, Any]] | None:
        """Return the greatest margin and the unknowns by name."""
        system, modes = self._system, self._modes(gamma)
        modes_looked_at = (False,) if self.beta is None else (False, True)
        main = [minus_phi_of_outages(system, self._K, modes, lost=lost) for lost in modes_looked_at]
        others = list(positive_of_outages(system))
        channel = channel_units(system, self._back, self._T)
        numbers = eps_units(system, channel)
        numbers |= eps_units(system, channel, "eps_out") if len(main) > 1 else {}
        others += [number_itself(name) for name in numbers]
        units = dict.fromkeys(main[0].rows | main[-1].rows, 1.0 / self._back) | {"p": channel}
        units.pop("w", None)
        known = {} if gamma is None else known_gamma(gamma)
        program = Program(main, others, units, numbers=numbers)
        bound = greatest(gamma, self._T * self._back[:, None] * system.C)
        centre = widest_margin(*program.constraints(known), bound, enough=enough)
        return None if centre is None else (centre[0], program.values(centre[1], known))


def _below_decay(alpha: Fraction | int, d: float) -> float:
    """Return a double at most e^{-2 alpha d}."""
    power = 2 * _rational(alpha) * exact(d)
    value = math.exp(-float(power))
    while not is_above_exponential(1 / exact(value), power):
        value = math.nextafter(value, 0.0)
    return value


def _rational(value: Fraction | int) -> Any:
    return flint.fmpq(value.numerator, value.denominator)
