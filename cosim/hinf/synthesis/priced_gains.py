"""Gains of Theorem 2 with a price on Y = K X, to be analysed again.

The least gamma over gains is often approached only as the gain grows without bound: the solver
then returns a gain of 10^7 with which nothing can be proved. With a price on |Y| beside gamma
(`Problem.priced`) it returns one that is a few percent worse and of moderate size, at any k1, k2:
and these matter little, since the gain is proved by an analysis of its own, which loses far less
than Theorem 2.

The gains are compared by the norm of their nominal loops; nothing here is a proof.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np

from cosim.core import NotAchievableError, report
from cosim.hinf.delay_lti import nominal_figures_of
from cosim.hinf.lmi import ROUGH_TOLERANCE, Answer, Problem
from cosim.hinf.synthesis.gain_size import gain_remark
from cosim.hinf.synthesis.search import scalars_at
from cosim.hinf.synthesis.theorem_2_gamma import gain_at
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem, Matrix

_MULTIPLES = (0.15, 0.3, 0.6)
"""k2 = -k1 in units of 1/d; the first ones lose least, but their gains are the largest."""
_PRICES = (0.001, 0.01, 0.1)
"""Prices of |Y|, as shares of a gamma of the system, both in the units of the LMI."""
_LARGE = 600
"""Unknowns from which a solve takes seconds: only the last price is tried."""


def priced_gains(system: DelaySystem, gamma: float) -> Iterator[Matrix]:
    """Yield gains (m, n) of moderate size, that of the loop of least norm first.

    At each k1, k2 that of the least price with which a gain is of such a size; where none of
    these is taken, those of the higher prices.

    system : Eq. (7) with w, z and a positive delay.
    gamma : the least one by Theorem 2, or about that: the scale of the prices.
    """
    problem, d = Problem(system), tuple(x.d for x in system.delays)
    shares = _PRICES if problem.size < _LARGE else _PRICES[-1:]
    prices = [share * gamma * problem.scaling.a**2 for share in shares]
    waiting = [(scalars_at(d, multiple), price) for multiple in _MULTIPLES for price in prices]
    asked, most = count(), len(waiting)
    while waiting:
        made: dict[Scalars, tuple[float, Matrix]] = {}
        later = []
        for at, price in waiting:
            if at in made:
                later.append((at, price))
                continue
            report("gains with a price on Y", next(asked) / most)
            gain = _moderate_gain(system, problem, at, price)
            if gain is not None:
                made[at] = gain
        yield from (K for _, K in sorted(made.values(), key=lambda x: x[0]))
        waiting = later


def _moderate_gain(
    system: DelaySystem, problem: Problem, at: Scalars, price: float
) -> tuple[float, Matrix] | None:
    """Return the norm of the nominal loop and the gain; None for a gain out of all proportion."""
    answer = problem.priced(at, price, ROUGH_TOLERANCE)
    if not isinstance(answer, Answer) or not np.isfinite(answer.unknowns["Y"]).all():
        return None
    K = gain_at(answer.unknowns, problem.scaling)
    if gain_remark(system, K) is not None:
        return None
    try:
        norm = nominal_figures_of(system, K).exact_norm
    except NotAchievableError:
        return None
    return None if norm is None else (norm, K)
