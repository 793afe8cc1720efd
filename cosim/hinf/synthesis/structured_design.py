"""Designs where not every state is fed back, or not all through one delay.

K has a zero column for each state that is not measured, and acts on different states at different
ages (`DelaySystem.selections`). The LMIs of a design are not linear in such a K; its analysis is
what it always is. So a direct descent (`descent`) proposes gains, and what is claimed is the best
analysis of them. Where ages vary, gains that are made for longer constant ages are proposed as
well: they are more cautious.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError
from cosim.hinf.lmi import units_of
from cosim.hinf.nominal import nominal_figures_of
from cosim.hinf.synthesis import synthesis
from cosim.hinf.synthesis.analysis import (
    Analysis,
    analysed,
    check_order_of_analysis,
    gain_of,
)
from cosim.hinf.synthesis.bessel_legendre_designs import as_design
from cosim.hinf.synthesis.descent import proposals
from cosim.hinf.synthesis.loop_gain import LoopGain
from cosim.hinf.synthesis.search import initial_scalars
from cosim.hinf.synthesis.synthesis import Design, check_achievable, rounded_gain
from cosim.models import Delay, DelaySystem, Matrix

_LONGER = (1.0, 1.5, 2.5)
"""Ages for which gains are proposed, as multiples of those that vary."""

_ANALYSED = 2  # proposals for each
_SAME = 1e-3  # gains closer than this, relative, are one
_ORDERS = (0, 1, 2)
_WORTH = 0.01  # share of gamma by which a higher order must be better


def structured_design(
    system: DelaySystem,
    *,
    order: int | None = None,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
) -> Design:
    """Design a gain with the zeros of the system's feedback, or take a given one, and prove it.

    Parameters
    ----------
    system : Eq. (7) with feedback of single states.
    order : of the analysis; None: those that pay.
    gamma : a bound to meet instead of the least one.
    gain : (m, n) a gain to analyse instead of designing one.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no gain could be certified.
    """
    if order is not None:
        check_order_of_analysis(order)
    if gamma is not None:
        check_achievable(gamma, system)
    reasons: list[str] = []
    if gain is not None:
        best = _best_analysis(system, gain_of(system, gain), gamma, order, reasons)
    else:
        best = _best_of_descent(system, gamma, order, reasons)
    if best is None:
        raise NotAchievableError(
            "no gain was found that can be certified with this feedback"
            if gain is None
            else "this gain could not be certified",
            where=system.name or None,
            expected="an exact proof" if gamma is None else f"an exact proof of gamma = {gamma:g}",
            got=reasons[-1] if reasons else "a descent on K stabilised the nominal loop from no start",
            hint="more states in feedback, shorter delays, a larger gamma, a smaller uncertainty",
        )
    return as_design(best)


def _best_of_descent(
    system: DelaySystem, gamma: float | None, order: int | None, reasons: list[str]
) -> Analysis | None:
    """Return the best analysis of proposed gains; add to `reasons` what failed."""
    best: Analysis | None = None
    varies = any(x.any_age and x.d > 0 for x in system.delays)
    for longer in _LONGER if varies else _LONGER[:1]:
        found = _best_at(system, longer, gamma, order, reasons, [] if best is None else [best.K])
        if found is None:
            continue
        if best is not None and not _value(found) < _value(best):
            break
        best = found
        if gamma is not None or best.gamma is None:
            break
    return best


def _best_at(
    system: DelaySystem,
    longer: float,
    gamma: float | None,
    order: int | None,
    reasons: list[str],
    starts: Sequence[Matrix | None],
) -> Analysis | None:
    """Return the best analysis of the gains proposed at ages that are longer by a factor."""
    made_for = _at_ages(system, longer)
    found: list[Analysis] = []
    for gains in (
        proposals(made_for, [K for K in starts if K is not None]),
        proposals(made_for, list(_of_whole_state(system)), drawn=0),
    ):
        for K in _ranked(made_for, gains)[:_ANALYSED]:
            one = _best_analysis(system, K, gamma, order, reasons)
            if one is not None:
                found.append(one)
                if gamma is not None or one.gamma is None:
                    return one
        if found:
            break
    return min(found, key=_value, default=None)


def _value(found: Analysis) -> float:
    return found.gamma or 0.0


def _ranked(system: DelaySystem, gains: Iterator[Matrix]) -> list[Matrix]:
    """Return different gains, rounded, that of the least norm first."""
    loop, units = LoopGain(system, uncertain=False), units_of(system)[0]
    ranked: list[tuple[float, Matrix]] = []
    for K in gains:
        rounded = rounded_gain(K, units)
        near = (np.abs(K - other).max() <= _SAME * np.abs(K).max() for _, other in ranked)
        if not any(near):
            value = loop.gain(rounded).value if loop.has_gain else float(np.abs(K).max())
            ranked.append((value, rounded))
    return [K for _, K in sorted(ranked, key=lambda pair: pair[0])]


def _best_analysis(
    system: DelaySystem,
    K: Matrix,
    gamma: float | None,
    order: int | None,
    reasons: list[str],
) -> Analysis | None:
    """Return the best certified analysis of a gain; None, and why in `reasons`."""
    try:
        figures = nominal_figures_of(system, K)
    except NotAchievableError as error:  # a loop too fast for its roots to be counted
        reasons.append(error.what)
        return None
    late = any(x.d > 0 for x in system.delays)
    best: Analysis | None = None
    for own in (_ORDERS if late else _ORDERS[:1]) if order is None else (order,):
        found = analysed(system, K, gamma, own, figures)
        if not found.certified:
            reasons.append(str(found.reason))
            continue
        if best is not None and not _value(found) < _value(best) * (1 - _WORTH):
            break
        best = found
        if gamma is not None or found.gamma is None:
            break
    return best


def _at_ages(system: DelaySystem, longer: float) -> DelaySystem:
    """Return the system with its varying ages longer by a factor."""
    delays = tuple(replace(x, d=longer * x.d) if x.any_age else x for x in system.delays)
    return replace(system, delays=delays)


def _of_whole_state(system: DelaySystem) -> Iterator[Matrix]:
    """Yield a gain of Theorem 2 that feeds back every state, through the longest feedback."""
    late = [j for j, x in enumerate(system.delays) if x.feedback]
    longest = max(late, key=lambda j: system.delays[j].d, default=None)
    delays = tuple(
        Delay(x.d, x.A, x.H, j == longest, x.any_age) for j, x in enumerate(system.delays)
    )
    whole = replace(system, delays=delays, feedback=None)
    k1, k2, _ = initial_scalars(whole, None, None, None)
    with suppress(NotAchievableError):
        yield synthesis.design(whole, k1, k2, search=bool(delays)).K


def refuse_structure(system: DelaySystem, what: str, hint: str) -> None:
    """Refuse a system with feedback of single states for `what`.

    Raises
    ------
    InputError : naming it.
    """
    if system.is_structured:
        raise InputError(
            f"{what} needs the whole state, fed back at once or through one delay",
            where=f"{system.name}: feedback" if system.name else "feedback",
            expected="feedback of every state alike",
            got="feedback of single states",
            hint=hint,
        )
