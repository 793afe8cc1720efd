"""The sufficient conditions under which a given gain is analysed, and their proofs.

Each is an LMI with a least gamma, a greatest margin and an exact proof of the point found:

* Theorem 1 and the Bessel-Legendre conditions (`is_plain`), where an age that varies counts as one
  of any age from zero to its bound;
* those of ages as they are: an interval, a bounded rate, sampled. They are used from
  order 1 on, and at every order where more is known of an age than its bound.

Where a system has many states, those of ages as they are are stated on the support of each delay:
the states, or the controls, that act through it. Elsewhere about the whole state.

Theorem 2 is a further one, with a gain that it designs (`cosim.hinf.synthesis.theorem_2_gamma`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.certificate import loop_to_json
from cosim.hinf.lmi import Condition, not_found, solver_words
from cosim.hinf.theorems import MAX_BOX, MAX_CORNERS, Supports, functionals_of, supports_of
from cosim.models import DelaySystem

MOST_ROWS = 60
"""Rows of -Phi, in its largest part, above which a looped functional is not tried.

Its unknowns grow with the square of the rows: with 60 a solve takes about a minute.
"""
_MOST_UNKNOWNS = 300
"""Unknowns, counted at every corner, up to which an order is affordable: a second per solve."""
_LARGE = 250
"""Unknowns of the condition about the whole state above which those on supports take its place."""
_LARGE_BY_ENTRY = 100
"""So too of a loop whose gain acts through different delays by entry, such as a pair's."""
_MOST_WITH_AGES = 3500
"""So too where more is known of an age than its bound: half a minute for a vehicle's axes."""
_MOST_FOR_RANKING = 500
"""So too where gains are compared with each other before the best one is analysed in full."""
_MOST_WORK = 1.5e9
"""Multiplications of an iteration up to which a condition of a large system is affordable.

A quarter of a minute in all on one core of 2024.
"""
AFFORDABLE_ORDERS = (0, 1, 2)
"""Orders that are tried where none is asked for."""


def conditions_of(
    system: DelaySystem,
    K: NDArray[Any],
    order: int,
    *,
    performance: bool,
    large: bool,
) -> list[Condition]:
    """Return the conditions that are worth a try at this order, the sharpest first.

    large : what `is_large` says.
    """
    if large:
        return [
            *_of_ages(system, K, order, performance, supports_of(system, K)),
            *_of_ages(system, K, order, performance, supports_of(system, K, controls=True)),
        ]
    ages = any(x.ages_are_known or (order > 0 and x.any_age and x.d > 0) for x in system.delays)
    plain = Condition(system, K, order, performance=performance)
    if not ages:
        return [plain]
    return [*_of_ages(system, K, order, performance), plain]


def is_large(system: DelaySystem, K: NDArray[Any]) -> bool:
    """Whether a condition about the whole state has too many unknowns at every order."""
    plain = Condition(system, K, 0, performance=system.has_performance)
    by_entry = any(np.ndim(x) > 1 for x in system.selections)
    most = _LARGE_BY_ENTRY if by_entry else _LARGE
    many = plain.unknowns([x.d for x in system.delays]) > most
    return many and any(support is not None for support in supports_of(system, K))


def _of_ages(
    system: DelaySystem,
    K: NDArray[Any],
    order: int,
    performance: bool,  # noqa: FBT001
    supports: Supports | None = None,
) -> list[Condition]:
    """Return the conditions of ages as they are, the sharpest first."""
    conditions: list[Condition] = []
    tried: list[tuple[str, ...]] = []
    possible = [functionals_of(x) for x in system.delays]
    delays = [x.d for x in system.delays]
    for level in range(max(map(len, possible))):
        functionals = tuple(each[min(level, len(each) - 1)] for each in possible)
        if functionals in tried:
            continue
        tried.append(functionals)
        condition = Condition(
            system, K, order, functionals, performance=performance, supports=supports
        )
        large = "looped" in functionals and condition.largest_part(delays) > MOST_ROWS
        if not large and condition.corners(delays) <= MAX_CORNERS:
            conditions.append(condition)
    return conditions


def affordable_conditions(
    system: DelaySystem,
    K: NDArray[Any],
    order: int,
    *,
    performance: bool,
    large: bool,
    ranking: bool = False,
) -> list[Condition]:
    """Return the conditions of this order that take a few seconds at most and may gain something.

    At order 0, of which one is always affordable, and with known ages up to order 1.

    large : what `is_large` says.
    ranking : to compare gains with each other; about a second each.
    """
    positive = [x for x in system.delays if x.d > 0]
    if order and not any(order == 1 or not x.any_age for x in positive):
        return []  # ages that vary gain nothing from a higher order
    known = any(x.ages_are_known for x in positive)
    if order > 1 and (known or large):
        return []
    conditions = conditions_of(system, K, order, performance=performance, large=large)
    delays = [x.d for x in system.delays]

    def cost(one: Condition) -> int:
        if one.is_plain:
            return one.unknowns(delays)
        return one.unknowns(delays) * one.corners(delays)

    if large:
        quick = [x for x in conditions if _work(x, system) <= _MOST_WORK]
        cheapest = min(conditions, key=lambda x: _work(x, system))
        return quick or ([] if order else [cheapest])
    if order and all(x.any_age for x in positive):  # then this one is that of order 0
        conditions = [x for x in conditions if not x.is_plain]
    most = (_MOST_FOR_RANKING if ranking else _MOST_WITH_AGES) if known else _MOST_UNKNOWNS
    return [x for x in conditions if cost(x) <= most] or ([] if order else conditions[-1:])


def _work(one: Condition, system: DelaySystem) -> float:
    """Return what an iteration of `solve_dense` costs, in multiplications."""
    delays = [x.d for x in system.delays]
    if one.is_plain:
        return math.inf
    return float(one.corners(delays) * (one.unknowns(delays) * one.largest_part(delays)) ** 2)


def affordable_order(system: DelaySystem, K: NDArray[Any], *, performance: bool) -> int:
    """Return the greatest affordable order."""
    large = is_large(system, K)
    return next(
        order
        for order in reversed(AFFORDABLE_ORDERS)
        if affordable_conditions(system, K, order, performance=performance, large=large)
    )


def prove(
    condition: Condition,
    system: DelaySystem,
    K: NDArray[Any],
    gamma: float | None,
    *,
    down_to_zero: bool = False,
    is_search: bool = False,
) -> tuple[dict[str, Any] | None, str]:
    """Return the certificate at the delays of `system`, or None and why there is none.

    is_search : of many delays, where any proof will do: that of the first round of `widest_margin`
        is tried before there is a second one.
    """
    delays, reason = [x.d for x in system.delays], ""
    if not condition.is_plain:
        count = condition.corners(delays, down_to_zero=down_to_zero)
        if count > MAX_CORNERS:
            return None, f"its {count} corners are more than the {MAX_CORNERS} that are proved here"
    for enough in (math.inf, -math.inf) if is_search else (-math.inf,):
        with solver_words() as words:
            centre = condition.margin(delays, gamma, down_to_zero=down_to_zero, enough=enough)
        if centre is None:
            return None, reason or not_found(words)
        margin, point = centre
        proof = point.exactly(system, K)
        failed = proof.failure(system, K)
        if failed is None:
            return loop_to_json(system, K, proof), ""
        reason = failed
        if gamma is None and margin <= 0:  # of stability no second round has turned one
            break
    return None, reason


def widened(
    condition: Condition, system: DelaySystem, K: NDArray[Any], gamma: float | None
) -> dict[str, Any] | None:
    """Return a certificate for every constant delay up to the system's; None without one.

    Also None where the certificate of these delays covers smaller ones, or too many vary.
    """
    if not 0 < exactly_covered(condition, system) <= MAX_BOX:
        return None
    return prove(condition, system, K, gamma, down_to_zero=True)[0]


def exactly_covered(condition: Condition, system: DelaySystem) -> int:
    """Return of how many delays a proof covers one value only, unless it is `widened`."""
    if condition.order == 0:
        return 0
    return sum(delay.d > 0 and not delay.any_age for delay in system.delays)
