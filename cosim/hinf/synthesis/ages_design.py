"""Designs where more is known of an age than its bound.

1. Theorem 2, for any age up to a bound, proposes gains: for the bounds as they are and for shorter
   ones, since an age that is sampled, or never as long as its bound for long, bears a gain that is
   made for a shorter one.
2. The LMI of the ages themselves (`ages_synthesis_lmi`) designs further ones, with the multiplier
   b searched, where it has no more than `MOST_ROWS` rows.

All are analysed with the ages of the system, and what is claimed is the best analysis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import NotAchievableError
from cosim.hinf.certificate import choices
from cosim.hinf.lmi import AgesSynthesisLmi
from cosim.hinf.synthesis import synthesis
from cosim.hinf.synthesis.analysis import Analysis, analyse, check_order_of_analysis
from cosim.hinf.synthesis.bessel_legendre_designs import as_design, given_gain_design
from cosim.hinf.synthesis.bessel_legendre_loop import rounded
from cosim.hinf.synthesis.conditions import MOST_ROWS
from cosim.hinf.synthesis.synthesis import Design, check_achievable
from cosim.models import Delay, DelaySystem, Matrix

_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
"""Bounds for which gains are designed, as shares of those of the known ages."""

_DEFAULT_ORDER = 1
_LEAST_B = 1 / 100  # of the search for b, as a share of the longest delay
_WELL_ABOVE = 1.1  # a gain of great margin is taken at this multiple of the least gamma


def ages_are_known(system: DelaySystem) -> bool:
    """Whether more is known of an age than its bound."""
    return any(delay.ages_are_known for delay in system.delays)


def of_any_age(system: DelaySystem, share: float = 1.0) -> DelaySystem:
    """Return the system with its known ages of any variation, up to `share` of their bounds."""
    delays = (
        Delay(share * x.d, x.A, x.H, x.feedback, any_age=True) if x.ages_are_known else x
        for x in system.delays
    )
    return replace(system, delays=tuple(delays))


def ages_design(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    order: int | None = None,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool = False,
) -> Design:
    """Design a gain, or take a given one, and prove it with the ages of the system.

    Parameters
    ----------
    k1, k2, search : of the gains of Theorem 2.
    order : N of the analysis; None for 1.
    gamma : a bound to meet instead of the least one.
    gain : (m, n) a gain to analyse instead of designing one.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no gain could be certified.
    """
    order = _DEFAULT_ORDER if order is None else order
    check_order_of_analysis(order)
    if gamma is not None:
        check_achievable(gamma, system)
    if gain is not None:
        return given_gain_design(system, gain, gamma, order)
    reasons: list[str] = []
    best = _of_theorem_2(system, k1, k2, order, reasons, search=search)
    if best is None or best.gamma is not None:
        for K in _of_the_ages(system, order, best):
            found = analyse(system, K, order=order)
            if not found.certified:
                reasons.append(f"a gain of the LMI of these ages: {found.reason}")
            elif best is None or (found.gamma or 0.0) < (best.gamma or 0.0):
                best = found
            if found.certified and found.gamma is None:
                break
    if best is None or best.K is None:
        raise NotAchievableError(
            "no gain was found that can be certified with these ages",
            where=system.name or None,
            expected="a gain of Theorem 2, for ages up to these or shorter ones, or of the LMI of "
            f"these ages, whose analysis of order {order} has a proof",
            got="; ".join(reasons[:2]) or "the LMI of these ages has no solution",
            hint="shorter ages, another order, a search for k1 and k2",
        )
    return as_design(best if gamma is None else _met(best, best.K, gamma))


def _met(best: Analysis, K: Matrix, gamma: float) -> Analysis:
    """Return the analysis of K, that of `best`, at `gamma` instead of its least one.

    Raises
    ------
    NotAchievableError : the least one is greater.
    """
    if best.gamma is not None and best.gamma > gamma:
        raise NotAchievableError(
            f"gamma = {gamma:g} was not reached with these ages",
            where=best.system.name or None,
            expected=f"a gain whose analysis of order {best.order} proves it",
            got=f"{best.gamma:.6g}, the least that was found",
            hint="a larger gamma, shorter ages, another order, a search for k1 and k2",
        )
    met = analyse(best.system, K, gamma, order=best.order)
    return met if met.certified else best


def _of_theorem_2(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    order: int,
    reasons: list[str],
    *,
    search: bool,
) -> Analysis | None:
    """Return the best certified analysis of gains of Theorem 2; add to `reasons` what failed."""
    best: Analysis | None = None
    for share in _SHARES:
        try:
            K = synthesis.design(of_any_age(system, share), k1, k2, search=search).K
        except NotAchievableError as error:
            reasons.append(f"Theorem 2 at {share:g} of the ages: {error.what}")
            continue
        found = analyse(system, K, order=order)
        if not found.certified:
            reasons.append(f"the gain for {share:g} of the ages: {found.reason}")
            continue
        if found.gamma is None:
            return found
        if best is not None and found.gamma >= (best.gamma or 0.0):
            break
        best = found
    return best


def _of_the_ages(system: DelaySystem, order: int, start: Analysis | None) -> Iterator[Matrix]:
    """Yield gains of the LMI of the ages, the best first; none where it is too large."""
    n, m = system.B.shape
    K = np.zeros((m, n)) if start is None or start.K is None else start.K
    reference = None
    if system.has_performance:
        known = None if start is None else start.gamma
        reference = known or float(np.linalg.norm(system.D1, 2)) or 1.0
    lmi = AgesSynthesisLmi(system, order, [choices(x)[0] for x in system.delays], K, reference)
    if lmi.rows > MOST_ROWS:
        return
    longest = max(delay.d for delay in system.delays)
    tried: list[tuple[float, float, Matrix]] = []  # what is to be small, b, the gain
    for step in (2.0, 0.5):
        b = longest if step > 1 else longest * step
        best = min((value for value, _, _ in tried), default=np.inf)
        while _LEAST_B < b / longest < 1 / _LEAST_B:
            found = lmi.least_gamma(b) if system.has_performance else _stable_gain(lmi, b)
            if found is None or found[0] >= best:
                break
            best = found[0]
            tried.append((best, b, found[1]))
            b *= step
    tried.sort(key=lambda item: item[0])
    for value, b, gain in tried[:2]:
        inside = lmi.central(b, _WELL_ABOVE * value) if system.has_performance else None
        for found in ((value, gain), inside):
            proposed = rounded(found)
            if proposed is not None:
                yield proposed[1]


def _stable_gain(lmi: AgesSynthesisLmi, b: float) -> tuple[float, Matrix] | None:
    """Return minus the greatest margin of stability and its gain; None where it is not positive."""
    found = lmi.central(b, None)
    return None if found is None or found[0] <= 0 else (-found[0], found[1])
