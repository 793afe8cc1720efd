"""Gains for a feedback of single states: not every state, or not all through one delay.

K has a zero column for each state that is not measured, and acts on different states at different
ages (`DelaySystem.selections`). The LMIs of a design are not linear in such a K; its analysis is
what it always is. So a direct descent (`descent`) proposes gains, and the analysis proves them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import NotAchievableError
from cosim.hinf.lmi import units_of
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.synthesis import theorem_2_gamma
from cosim.hinf.synthesis.ages_gains import is_past_the_best
from cosim.hinf.synthesis.analysis import Order
from cosim.hinf.synthesis.constrained_search import constrained
from cosim.hinf.synthesis.damped_gains import damped_design
from cosim.hinf.synthesis.descent import proposals
from cosim.hinf.synthesis.designs import given_gain_design, proved_by_analysis, rounded_gain
from cosim.hinf.synthesis.loop_gain import LoopGain
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.search import initial_scalars
from cosim.models import Delay, DelaySystem, Matrix

_LONGER = (1.0, 1.5, 2.5)
"""Ages for which gains are proposed, as multiples of those that vary: a gain for longer constant
ages is more cautious."""

_ROUNDING = 1e-9
_SAME = 1e-3  # gains closer than this, relative, are one


def structured_design(
    system: DelaySystem,
    order: Order | None,
    gamma: float | None,
    gain: ArrayLike | None,
    constraints: DesignConstraints,
) -> Result:
    """Design a gain with the zeros of the system's feedback, or take a given one, and prove it.

    Parameters
    ----------
    system : Eq. (7) with feedback of single states.
    order : of the analysis; None: "auto".
    gamma : a bound to meet instead of the least one.
    gain : (m, n) a gain to analyse instead of designing one.
    constraints : a bound on |K| or damping, which are in the certificate then.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no gain could be certified.
    """
    of_analysis: Order = "auto" if order is None else order

    def proved(K: ArrayLike) -> Result:
        return constrained(given_gain_design(system, K, gamma, of_analysis), constraints)

    if gain is not None:
        return proved(gain)

    def undamped(asked: DesignConstraints) -> Result:
        return constrained(descent_design(system, gamma, of_analysis, asked.gain_limit), asked)

    damping = constraints.damping_to_prove
    if damping is None:
        return undamped(constraints)
    return damped_design(system, constraints, damping, undamped, proved)


def descent_design(
    system: DelaySystem,
    gamma: float | None,
    order: Order = "auto",
    gain_limit: float | None = None,
) -> Result:
    """Prove the best of the gains that a descent proposes, as `structured_design`.

    Raises
    ------
    NotAchievableError : no gain could be certified.
    """
    factors = _LONGER if any(x.any_age and x.d > 0 for x in system.delays) else _LONGER[:1]

    def enough(made: Sequence[Result]) -> bool:
        certified = any(one.certificate is not None for one in made)
        return certified and (len(made) >= len(factors) or is_past_the_best(made))

    gains = structured_gains(system, factors)
    if gain_limit is not None:
        gains = (_below(K, gain_limit) for K in gains)
    return proved_by_analysis(system, gains, gamma, order, enough=enough)


def structured_gains(
    system: DelaySystem, factors: Sequence[float] = _LONGER[:1]
) -> Iterator[Matrix]:
    """Yield gains (m, n) with the zeros of the system's feedback.

    First the best one for the varying ages times each of `factors`, then others, at last those
    that start from a gain of the whole state.
    """
    others: list[Matrix] = []
    last: list[Matrix] = []
    for factor in factors:
        longer = _at_ages(system, factor)
        ranked = _ranked(longer, proposals(longer, last))
        last = ranked[:1]
        yield from last
        others += ranked[1:]
    yield from others
    if system.is_structured:  # otherwise it has been tried
        yield from _ranked(system, proposals(system, list(_of_whole_state(system)), drawn=0))


def _below(K: Matrix, gain_limit: float) -> Matrix:
    """Return the gain, made smaller as a whole where it is above the limit."""
    return K * min(1.0, (1 - _ROUNDING) * gain_limit / float(np.linalg.norm(K, 2) or 1.0))


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


def _at_ages(system: DelaySystem, factor: float) -> DelaySystem:
    """Return the system with its varying ages longer by a factor."""
    delays = tuple(replace(x, d=factor * x.d) if x.any_age else x for x in system.delays)
    return replace(system, delays=delays)


def _of_whole_state(system: DelaySystem) -> Iterator[Matrix]:
    """Yield a gain of Theorem 2 that feeds back every state, through the longest feedback."""
    fed_back = [j for j, x in enumerate(system.delays) if x.feedback]
    longest = max(fed_back, key=lambda j: system.delays[j].d, default=None)
    delays = tuple(
        Delay(x.d, x.A, x.H, j == longest, x.any_age) for j, x in enumerate(system.delays)
    )
    unstructured = replace(system, delays=delays, feedback=None)
    k1, k2, _ = initial_scalars(unstructured, None, None, None)
    with suppress(NotAchievableError):
        yield theorem_2_gamma.design(unstructured, k1, k2, search=bool(delays)).K
