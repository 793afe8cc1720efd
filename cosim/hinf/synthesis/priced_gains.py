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

import numpy as np

from cosim.core import NotAchievableError, report
from cosim.hinf.lmi import ROUGH_TOLERANCE, Answer, Problem
from cosim.hinf.nominal import nominal_figures_of
from cosim.hinf.synthesis.gain_size import gain_remark
from cosim.hinf.synthesis.search import scalars_at
from cosim.hinf.synthesis.theorem_2 import gain_at
from cosim.models import DelaySystem, Matrix

_MULTIPLES = (0.15, 0.3, 0.6)
"""k2 = -k1 in units of 1/d; the first ones lose least, but their gains are the largest."""
_PRICES = (0.01, 0.1)
"""Prices of |Y|, as shares of a gamma of the system, both in the units of the LMI."""
_LARGE = 600
"""Unknowns from which a solve takes seconds: only the last price is tried."""


def priced_gains(system: DelaySystem) -> Iterator[Matrix]:
    """Yield gains (m, n) of moderate size, that of the loop of least norm first.

    system : Eq. (7) with w, z and a positive delay.
    """
    problem, d = Problem(system), tuple(x.d for x in system.delays)
    prices = _PRICES if problem.size < _LARGE else _PRICES[-1:]
    made: list[tuple[float, Matrix]] = []
    gamma = None
    for k, (multiple, price) in enumerate((x, y) for x in _MULTIPLES for y in prices):
        report("gains with a price on Y", k / len(prices) / len(_MULTIPLES))
        at = scalars_at(d, multiple)
        if gamma is None:
            first = problem.least_gamma(at, tolerance=ROUGH_TOLERANCE)
            if not isinstance(first, Answer):
                continue
            gamma = first.value * problem.scaling.a**2
        answer = problem.priced(at, price * gamma, ROUGH_TOLERANCE)
        if not isinstance(answer, Answer) or not np.isfinite(answer.unknowns["Y"]).all():
            continue
        K = gain_at(answer.unknowns, problem.scaling)
        if gain_remark(system, K) is not None:
            continue
        try:
            figures = nominal_figures_of(system, K)
        except NotAchievableError:
            continue
        if figures.exact_norm is not None:
            made.append((figures.exact_norm, K))
    yield from (K for _, K in sorted(made, key=lambda x: x[0]))
