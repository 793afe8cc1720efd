"""Remark 3: the greatest delay for a given gamma, its feasible side certified.

At fixed k1, k2 the LMI can be met on an interval from 0: whatever solves it at d solves it at
every smaller delay, since d enters it, rows r and m taken out, with positive semidefinite
factors alone. The end of that interval is where its margin is zero. Below it, a design is
proved exactly; above it, multipliers (Farkas) show that no solution exists, in floating point.

With k1, k2 searched there may be no end: section 5's loop is stable for every delay. Then the
search stops at a limit, and says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from scipy import optimize

from cosim.errors import InputError, NotAchievableError
from cosim.hinf.assembly import Scalars
from cosim.hinf.problem import Problem
from cosim.hinf.search import climb, scaled, widest_margin
from cosim.hinf.synthesis import (
    Design,
    check_reachable,
    checked_scalars,
    finished,
    proved_at,
)
from cosim.hinf.threads import one_thread
from cosim.models.delay_system import Delay, DelaySystem

if TYPE_CHECKING:
    from collections.abc import Sequence

DELAY_LIMIT = 20.0
"""Where a search ends [s]."""

_SMALLEST = 1e-6
"""Share of the limit below which a delay counts as none."""
_BELOW = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 5e-2)
_ABOVE = (1e-4, 1e-3, 1e-2)
_LARGE = 1e4
"""Unknowns beyond this multiple of those at the greatest delay count as none at all."""
_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class GreatestDelay:
    """How much delay a gamma bears.

    delay : d* [s], certified; the other delays as they were.
    design : the gain and its proof at d*.
    limit_reached : d* is the limit of the search, and says nothing about what is beyond.
    refuted_at : a delay [s] just above d* at which multipliers show that the LMI has no
        solution at these k1, k2; None: not certified beyond.
    """

    delay: float
    design: Design
    limit_reached: bool
    refuted_at: float | None


@one_thread
def greatest_delay(
    system: DelaySystem,
    gamma: float | None,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    which: int = 0,
    limit: float = DELAY_LIMIT,
    search: bool = False,
) -> GreatestDelay:
    """The greatest delay `which` at which gamma (None: stability) is certified.

    Parameters
    ----------
    system : the delays other than `which` are held.
    gamma : bound of the gain from w to z; None for a system without w and z.
    k1, k2 : one number per delay; where searched, the first start.
    which : index of the delay.
    limit : where the search ends [s].
    search : look for better k1, k2 as well.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no delay at all can be certified.
    """
    if not 0 <= which < len(system.delays):
        raise InputError(
            "there is no such delay",
            where="which",
            expected=f"an index below {len(system.delays)}, the number of delays",
            got=str(which),
        )
    if not (math.isfinite(limit) and limit > 0):
        raise InputError(
            "not a limit for a delay", where="limit", expected="a positive number", got=repr(limit)
        )
    if gamma is not None:
        check_reachable(gamma, system)
    elif system.has_performance:
        raise InputError(
            "a greatest delay needs a gamma to be kept", where="gamma", expected="a number"
        )
    p = checked_scalars(system, k1, k2)
    start = _with_delay(system, which, limit)
    problem = Problem(start)
    p = replace(p, d=tuple(delay.d for delay in start.delays))
    end = _searched_end(problem, p, gamma, which) if search else None
    if end is None:
        end = _end(problem, p, gamma, which)
    if end is None:
        raise _none_at_all(system, gamma, p, search=search)
    shares = (0.0, *_BELOW) if end.d[which] == limit else _BELOW
    reason = ""
    for share in shares:
        d = end.d[which] * (1 - share)
        at = _replaced(end, which, d)
        there = _with_delay(system, which, d)
        found, reason = proved_at(there, problem, at, gamma)
        if found is not None:
            return GreatestDelay(
                delay=d,
                design=finished(there, *found, None),
                limit_reached=d == limit,
                refuted_at=None if search or d == limit else _refuted(problem, at, gamma, which),
            )
    raise NotAchievableError(
        "no delay could be certified",
        where=system.name or None,
        expected=f"an exact proof near d = {end.d[which]:.6g}, where the solver sees the end",
        got=reason,
        hint="another k1, k2, or a larger gamma",
    )


def _end(problem: Problem, p: Scalars, gamma: float | None, which: int) -> Scalars | None:
    """Where the margin at these k1, k2 is zero, or the limit; None: at no delay is there one."""

    def margin(d: float) -> float:
        answer = problem.margin(_replaced(p, which, d), gamma)
        return -1.0 if answer is None else answer.value

    limit = p.d[which]
    if margin(limit) > 0:
        return p
    least = _SMALLEST * limit
    if margin(least) <= 0:
        return None
    end = optimize.brentq(margin, least, limit, xtol=1e-8 * limit, rtol=1e-8)
    return _replaced(p, which, float(end))


def _searched_end(problem: Problem, p: Scalars, gamma: float | None, which: int) -> Scalars | None:
    """The limit if k1, k2 are found for it; else what bisection with searched k1, k2 finds."""
    limit = p.d[which]
    found = widest_margin(problem, p, gamma)
    if found is not None and found[1] > 0:
        return found[0]
    good = _end(problem, p, gamma, which)
    low, high = (good.d[which] if good else _SMALLEST * limit), limit
    for _ in range(_ROUNDS):
        # delays are lengths: halve the ratio while it is large
        d = math.sqrt(low * high) if high > 4 * low else (low + high) / 2
        if good is None:
            found = widest_margin(problem, scaled(p, which, d), gamma)
        else:
            found = climb(problem, scaled(good, which, d), gamma)
        if found is not None and found[1] > 0:
            good, low = found[0], d
        else:
            high = d
    return good


def _refuted(problem: Problem, p: Scalars, gamma: float | None, which: int) -> float | None:
    """A delay just above at which there is no solution, by multipliers."""
    answer = problem.margin(p, gamma)
    if answer is None:
        return None
    for share in _ABOVE:
        d = p.d[which] * (1 + share)
        if problem.refuted_below(_replaced(p, which, d), gamma) > _LARGE * answer.point.largest:
            return d
    return None


def _none_at_all(
    system: DelaySystem, gamma: float | None, p: Scalars, *, search: bool
) -> NotAchievableError:
    goal = "stability" if gamma is None else f"gamma = {gamma:g}"
    where = "the k1, k2 searched" if search else f"k1 = {list(p.k1)}, k2 = {list(p.k2)}"
    return NotAchievableError(
        f"{goal} cannot be had at any delay",
        where=system.name or None,
        expected=f"a feasible LMI at a small delay, with {where}",
        got="the solver finds no feasible point",
        hint="a larger gamma" if search else "other k1, k2, or their search; a larger gamma",
    )


def _replaced(p: Scalars, which: int, d: float) -> Scalars:
    return replace(p, d=(*p.d[:which], d, *p.d[which + 1 :]))


def _with_delay(system: DelaySystem, which: int, d: float) -> DelaySystem:
    return with_delays(system, [d if j == which else x.d for j, x in enumerate(system.delays)])


def with_delays(system: DelaySystem, lengths: Sequence[float]) -> DelaySystem:
    """The same system with other delays [s].

    Raises
    ------
    InputError : not one number per delay, or one that is no delay.
    """
    if len(lengths) != len(system.delays):
        raise InputError(
            "the delays do not fit the system",
            where="delays",
            expected=f"{len(system.delays)} numbers of seconds",
            got=str(list(lengths)),
        )
    try:
        delays = [
            Delay(d, x.A, x.H, x.feedback, x.any_age)
            for d, x in zip(lengths, system.delays, strict=True)
        ]
    except ValueError as error:
        raise InputError(str(error), where="delays") from error
    s = system
    return DelaySystem(s.A, s.B, s.C, s.D, s.D1, s.D2, s.E, s.H, delays, s.name)
