"""Maximise the delay over k1, k2 and the delay at once.

The least gamma of the LMI is smooth in k1, k2 and d, and its multipliers give the gradient for
free. So one constrained ascent (SLSQP) replaces a bisection with a search at every step. The
budget is a number of solves, so that the result does not depend on the speed of the machine.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from cosim.core import report
from cosim.hinf.lmi import ROUGH_TOLERANCE, Answer, Array, Problem
from cosim.hinf.synthesis.search import MULTIPLES, RATIO_LIMIT, SearchDoneError, scaled, starts
from cosim.hinf.theorems import Scalars

_SHARES = (1.0, 0.25, 0.0625, 2.0**-6, 2.0**-10, 1e-6)
"""Starting delays of the ascent, as shares of the limit."""
_SOLVES = 60
_INSIDE = 1e-5  # slack kept by the ascent, so that its end is feasible
_FAR = 100.0  # logarithm of the limit over a delay that no step goes below: it would be zero
_WALL = -10.0  # in place of log(gamma / least gamma) where there is no least gamma


def search_greatest_delay(
    problem: Problem, p: Scalars, gamma: float | None, delay_index: int
) -> Scalars | None:
    """Return k1, k2 with the greatest delay found, at most that of `p`; None if none is feasible.

    Maximises log d over log d, log k2 d and k1/k2 subject to least gamma <= gamma (margin >= 0
    where there is no gamma), from the best start at the longest delay where one is feasible.
    """
    limit = p.d[delay_index]
    start = _first_feasible(problem, p, gamma, delay_index)
    if start is None or start.d[delay_index] == limit:
        return start
    N = len(p.d)
    lengths = np.array([d if d > 0 else 1.0 for d in start.d])
    signs = np.sign(start.k2)
    shortest = math.log(limit) - _FAR
    best = [start]
    seen: dict[bytes, tuple[float, Array]] = {}
    budget = problem.solve_count + _SOLVES

    def scalars(u: Array) -> Scalars:
        lengths[delay_index] = math.exp(min(max(u[-1], shortest), math.log(limit)))
        k2 = signs * np.exp(u[:N]) / lengths
        d = (*p.d[:delay_index], min(float(lengths[delay_index]), limit), *p.d[delay_index + 1 :])
        return Scalars(tuple(map(float, u[N : 2 * N] * k2)), tuple(map(float, k2)), d)

    def slack(u: Array) -> tuple[float, Array]:
        """Return the slack of a point (negative: infeasible), and its gradient."""
        key = u.tobytes()
        if key not in seen:
            at = scalars(u)
            report("searching the greatest delay", 1.0 - (budget - problem.solve_count) / _SOLVES)
            value_and_slopes = _slack(problem, at, gamma)
            if value_and_slopes is None:
                seen[key] = (_WALL, np.zeros(2 * N + 1))
            else:
                value, slopes = value_and_slopes
                if value >= 0 and at.d[delay_index] > best[0].d[delay_index]:
                    best[0] = at
                seen[key] = (value, _chain(at, slopes, delay_index))
            if best[0].d[delay_index] >= limit or problem.solve_count >= budget:
                raise SearchDoneError
        return seen[key]

    log_k2, k1_by_k2 = np.log(np.abs(start.k2) * lengths), np.array(start.k1) / np.array(start.k2)
    u = np.concatenate([log_k2, k1_by_k2, [math.log(start.d[delay_index])]])
    forward = np.eye(2 * N + 1)[-1]
    low, high = (np.array([math.log(x)] * N) for x in MULTIPLES)
    ratios = np.full(N, RATIO_LIMIT)
    bounds: Any = scipy.optimize.Bounds(
        np.concatenate([low, -ratios, [-np.inf]]),
        np.concatenate([high, ratios, [math.log(limit)]]),
    )
    if not (bounds.lb <= u).all() or not (u <= bounds.ub).all():
        return start
    inside: Any = {
        "type": "ineq",
        "fun": lambda u: slack(u)[0] - _INSIDE,
        "jac": lambda u: slack(u)[1],
    }
    minimize: Any = scipy.optimize.minimize
    with suppress(SearchDoneError):
        minimize(
            lambda u: -float(u[-1]),
            u,
            jac=lambda _: -forward,
            method="SLSQP",
            bounds=bounds,
            constraints=inside,
            options={"maxiter": _SOLVES, "ftol": 1e-5},
        )
    return best[0]


def _first_feasible(
    problem: Problem, p: Scalars, gamma: float | None, delay_index: int
) -> Scalars | None:
    """Return the start of most slack, at the longest of a few delays where one is feasible."""
    for share in _SHARES:
        d = share * p.d[delay_index]
        as_given = replace(p, d=(*p.d[:delay_index], d, *p.d[delay_index + 1 :]))
        at = [as_given, *starts(scaled(p, delay_index, d))]
        with_slack = [(s, _slack(problem, s, gamma)) for s in at]
        slacks = [(s, slack[0]) for s, slack in with_slack if slack is not None and slack[0] > 0]
        if slacks:
            return max(slacks, key=lambda x: x[1])[0]
    return None


def _slack(problem: Problem, p: Scalars, gamma: float | None) -> tuple[float, Array] | None:
    """Return log(gamma / least gamma), or the margin, and its gradient by k1, k2, d; or None."""
    if gamma is None:
        answer = problem.margin(p, None, tolerance=ROUGH_TOLERANCE)
        return (answer.value, answer.slopes) if isinstance(answer, Answer) else None
    answer = problem.least_gamma(p)
    if not isinstance(answer, Answer) or not answer.value > 0:
        return None
    return math.log(gamma / answer.value), -answer.slopes / answer.value


def _chain(p: Scalars, slopes: Array, delay_index: int) -> Array:
    """Convert the gradient by k1, k2, d to log(k2 d), k1/k2 and log d."""
    N = len(p.d)
    by_k1, by_k2, by_d = slopes[:N], slopes[N : 2 * N], slopes[2 * N :]
    k1, k2 = np.array(p.k1), np.array(p.k2)
    by_log_k2 = by_k1 * k1 + by_k2 * k2
    by_log_d = by_d[delay_index] * p.d[delay_index] - by_log_k2[delay_index]
    return np.concatenate([by_log_k2, by_k1 * k2, [by_log_d]])
