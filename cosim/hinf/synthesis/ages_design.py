"""Designs where more is known of an age than its bound: Theorem 2 proposes, the ages decide.

The conditions of ages as they are cannot be written as an LMI in K. Theorem 2 is one, for any age
up to a bound. So gains are designed by it for the bounds as they are and for shorter ones, and
each is analysed with the ages of the system: an age that is sampled, or never as long as its
bound for long, bears a gain that is made for a shorter one. What is claimed is the analysis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from cosim.core import NotAchievableError
from cosim.hinf.synthesis import synthesis
from cosim.hinf.synthesis.analysis import Analysis, analyse, check_order_of_analysis
from cosim.hinf.synthesis.bessel_legendre_designs import as_design, given_gain_design
from cosim.hinf.synthesis.synthesis import Design, check_achievable
from cosim.models import Delay, DelaySystem

_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
"""Bounds for which gains are designed, as shares of those of the known ages."""

_DEFAULT_ORDER = 1


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
    best: Analysis | None = None
    reasons: list[str] = []
    for share in _SHARES:
        try:
            K = synthesis.design(of_any_age(system, share), k1, k2, search=search).K
        except NotAchievableError as error:
            reasons.append(f"Theorem 2 at {share:g} of the ages: {error.what}")
            continue
        found = analyse(system, K, gamma, order=order)
        if not found.certified:
            reasons.append(f"the gain for {share:g} of the ages: {found.reason}")
            continue
        if found.gamma is None or gamma is not None:
            return as_design(found)
        if best is not None and best.gamma is not None and found.gamma >= best.gamma:
            break
        best = found
    if best is not None:
        return as_design(best)
    raise NotAchievableError(
        "no gain was found that can be certified with these ages",
        where=system.name or None,
        expected="a gain of Theorem 2, for ages up to these or shorter ones, "
        f"whose analysis of order {order} has a proof",
        got="; ".join(reasons[:2]),
        hint="a larger gamma, shorter ages, another order, a search for k1 and k2",
    )
