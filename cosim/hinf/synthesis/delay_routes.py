"""Two routes to the greatest delay for a given gamma: Theorem 2 (Remark 3), and order N from there.

At fixed k1, k2 the LMI is feasible on an interval from 0: a solution at d is one at every
smaller delay, since d enters it, rows r and m removed, with positive semidefinite factors only.
The interval ends where the margin is zero. Just below, a design is proved exactly; just above,
Farkas' lemma proves exactly that there is no solution.

With k1, k2 searched there may be no end: the loop of section 5 is stable for every delay. Then
the search stops at its limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import scipy

from cosim.core import InputError, NotAchievableError
from cosim.hinf.delay_lti import one_thread
from cosim.hinf.lmi import (
    ROUGH_TOLERANCE,
    Answer,
    Problem,
    not_found,
    refute,
    solver_words,
)
from cosim.hinf.problem import DELAY_LIMIT, with_delay
from cosim.hinf.synthesis.bessel_legendre_gains import Gain, Loop, check_order, continue_gain
from cosim.hinf.synthesis.delay_result import GreatestDelay
from cosim.hinf.synthesis.delay_search import search_greatest_delay
from cosim.hinf.synthesis.designs import check_achievable, design_of_theorem_2, given_gain_design
from cosim.hinf.synthesis.ladder import delays_below, first_proved
from cosim.hinf.synthesis.not_achievable import hint_after
from cosim.hinf.synthesis.stabilisability import unstabilisable_error
from cosim.hinf.synthesis.theorem_2_gamma import checked_scalars, find_certified_gain
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem

_SHORT = 2.0**-10  # first delay tried where Theorem 2 certifies none, as a share of the limit
_SMALLEST = 1e-6  # shortest delay searched, as a share of the limit
_ABOVE = (1e-5, 1e-4, 1e-3, 1e-2)
_PRECISION = 1e-7  # of the end at fixed k1, k2, relative: that of a margin
_BEYOND = (1e-3, 1e-2, 0.1, 1.0)
"""Shares beyond a greatest delay found where its end at fixed k1, k2 is searched."""


@one_thread
def delay_by_theorem_2(
    system: DelaySystem,
    gamma: float | None,
    k1: Sequence[float],
    k2: Sequence[float],
    delay_index: int = 0,
    limit: float = DELAY_LIMIT,
    *,
    search: bool = False,
) -> GreatestDelay:
    """Find the greatest delay by Theorem 2, as `greatest_delay` with k1, k2 given.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no delay at all can be certified.
    """
    check_delay(system, delay_index, limit)
    if gamma is not None:
        check_achievable(gamma, system)
    elif system.has_performance:
        raise InputError("a greatest delay needs a bound gamma", where="gamma", expected="a number")
    p = checked_scalars(system, k1, k2)
    start = with_delay(system, delay_index, limit)
    problem = Problem(start)
    p = replace(p, d=tuple(delay.d for delay in start.delays))
    with solver_words() as words:
        end = _searched_end(problem, p, gamma, delay_index) if search else None
        if end is None:
            end = _end(problem, p, gamma, delay_index)
    if end is None:
        cause = unstabilisable_error(system)
        if cause is not None:
            raise cause
        least = _replaced(p, delay_index, _SMALLEST * limit)
        there = with_delay(system, delay_index, least.d[delay_index])
        proof = None if search else refute(there, problem, least, gamma)
        raise _none_at_all(system, gamma, least, proof, not_found(words), search=search)
    last = end

    def prove(d: float) -> tuple[GreatestDelay | None, str]:
        at = _replaced(last, delay_index, d)
        there = with_delay(system, delay_index, d)
        proved, reason = find_certified_gain(there, problem, at, gamma)
        if proved is None:
            return None, reason
        beyond = None if d == limit else _refuted(system, problem, at, gamma, delay_index)
        refuted_at, refutation = beyond or (None, None)
        result = design_of_theorem_2(there, *proved, None)
        greatest = GreatestDelay(
            *(delay_index, d, result, d == limit), refuted_at=refuted_at, refutation=refutation
        )
        return greatest, ""

    longest = end.d[delay_index]
    greatest, reason = first_proved(delays_below(longest, itself=longest == limit), prove)
    if greatest is not None:
        return greatest
    raise NotAchievableError(
        "no delay could be certified",
        where=system.name or None,
        expected=f"an exact proof near d = {end.d[delay_index]:.6g}, the greatest by the solver",
        got=reason,
        hint=hint_after(
            reason, "a larger gamma" if search else "another k1, k2, or a larger gamma"
        ),
    )


def _end(problem: Problem, p: Scalars, gamma: float | None, delay_index: int) -> Scalars | None:
    """Return where the margin at these k1, k2 is zero, or the delay of `p`; None: nowhere."""
    margin = _margin_by(problem, p, gamma, delay_index)
    limit = p.d[delay_index]
    if margin(limit) > 0:
        return p
    least = _SMALLEST * limit
    if margin(least) <= 0:
        return None
    return _replaced(p, delay_index, _zero(margin, least, limit))


def _searched_end(
    problem: Problem, p: Scalars, gamma: float | None, delay_index: int
) -> Scalars | None:
    """Return the end at the k1, k2 of the greatest delay found, or the limit."""
    end = search_greatest_delay(problem, p, gamma, delay_index)
    if end is None or end.d[delay_index] == p.d[delay_index]:
        return end
    margin = _margin_by(problem, end, gamma, delay_index)
    low = end.d[delay_index]
    if margin(low) <= 0:
        return end
    for share in _BEYOND:
        high = min(end.d[delay_index] * (1 + share), p.d[delay_index])
        if margin(high) <= 0:
            return _replaced(end, delay_index, _zero(margin, low, high))
        low = high
    return _replaced(end, delay_index, low)


def _margin_by(
    problem: Problem, p: Scalars, gamma: float | None, delay_index: int
) -> Callable[[float], float]:
    """Return the margin as a function of the delay; -1 where the solver finds none."""

    @cache
    def margin(d: float) -> float:
        answer = problem.margin(_replaced(p, delay_index, d), gamma, tolerance=ROUGH_TOLERANCE)
        return answer.value if isinstance(answer, Answer) else -1.0

    return margin


def _zero(margin: Callable[[float], float], low: float, high: float) -> float:
    return float(scipy.optimize.brentq(margin, low, high, xtol=_PRECISION * high, rtol=_PRECISION))


def _refuted(
    system: DelaySystem, problem: Problem, p: Scalars, gamma: float | None, delay_index: int
) -> tuple[float, dict[str, Any]] | None:
    """Return a delay just above that of `p` without a solution, and the proof."""
    for share in _ABOVE:
        d = p.d[delay_index] * (1 + share)
        proof = refute(
            with_delay(system, delay_index, d), problem, _replaced(p, delay_index, d), gamma
        )
        if proof is not None:
            return d, proof
    return None


def _none_at_all(
    system: DelaySystem,
    gamma: float | None,
    p: Scalars,
    proof: dict[str, Any] | None,
    reason: str,
    *,
    search: bool,
) -> NotAchievableError:
    """Return the error with the proof that no delay is feasible, or with the `reason` without."""
    goal = "stability" if gamma is None else f"gamma = {gamma:g}"
    at = "" if search else f", with k1 = {list(p.k1)}, k2 = {list(p.k2)}"
    usual = "a larger gamma" if search else "other k1, k2, or a search for them; a larger gamma"
    return NotAchievableError(
        f"no delay was found at which {goal} can be certified"
        if proof is None
        else f"{goal} cannot be achieved at any delay with these k1, k2",
        where=system.name or None,
        expected=f"a feasible LMI at a small delay{at}",
        got=reason
        if proof is None
        else f"proved: the LMI has no solution at delays {list(p.d)}, nor at greater ones",
        hint=usual if proof is not None else hint_after(reason, usual),
        certificate=proof,
    )


def _replaced(p: Scalars, delay_index: int, d: float) -> Scalars:
    return replace(p, d=(*p.d[:delay_index], d, *p.d[delay_index + 1 :]))


def check_delay(system: DelaySystem, delay_index: int, limit: float) -> None:
    """Refuse an index that no delay has, and a limit that is no positive number of seconds.

    Raises
    ------
    InputError : naming which.
    """
    N = len(system.delays)
    if not 0 <= delay_index < N:
        expected = f"an index from 0 to {N - 1}" if N else "a system with a delay"
        raise InputError(
            "there is no such delay", where="delay_index", expected=expected, got=str(delay_index)
        )
    if not (math.isfinite(limit) and limit > 0):
        raise InputError(
            "not a limit for a delay", where="limit", expected="seconds > 0", got=repr(limit)
        )


@one_thread
def delay_by_order(
    system: DelaySystem,
    gamma: float | None,
    k1: Sequence[float],
    k2: Sequence[float],
    delay_index: int = 0,
    limit: float = DELAY_LIMIT,
    *,
    order: int,
    search: bool = False,
    plain: GreatestDelay | NotAchievableError | None = None,
) -> GreatestDelay:
    """Find the greatest delay as `delay_by_theorem_2` does, with order N.

    Continuation from the gain at the greatest delay of Theorem 2; nothing is refuted beyond
    the end. At N > 0 the proof covers exactly that delay, or every one up to it
    (`Result.covers_smaller_delays`).

    plain : what Theorem 2 gave of the same arguments, or raised; None: not tried yet.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no delay at all can be certified.
    """

    def at(d: float) -> Loop:
        return Loop(with_delay(system, delay_index, d), order, gamma)

    if plain is None:
        try:
            plain = delay_by_theorem_2(system, gamma, k1, k2, delay_index, limit, search=search)
        except NotAchievableError as error:
            plain = error
    if isinstance(plain, GreatestDelay):
        K, start = plain.result.K, plain.delay or 0.0
    else:
        start = _SHORT * limit
        short = at(start).initial_gains()
        if not short:
            raise plain from None
        K = short[0]
    check_order(order, at(start).system)
    passed = continue_gain(at, K, start, limit)
    end, K = passed[-1]

    def prove(tried: tuple[float, Gain]) -> tuple[GreatestDelay | None, str]:
        d, gain = tried
        try:
            designed = given_gain_design(at(d).system, gain, gamma, order)
        except NotAchievableError as error:  # also a loop too fast for its roots to be counted
            return None, str(error.got or error.what)
        return GreatestDelay(delay_index, d, designed, d == limit), ""

    below = [(d, K) for d in delays_below(end, itself=True)]
    greatest, reason = first_proved([*below, *reversed(passed[:-1])], prove)
    if greatest is not None:
        return greatest
    raise NotAchievableError(
        f"no delay could be certified at order {order}",
        where=system.name or None,
        expected=f"an exact proof near d = {end:.6g}, the greatest delay by the solver",
        got=reason,
        hint="another order, a larger gamma",
    )
