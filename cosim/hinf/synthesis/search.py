"""Search k1 and k2: they change gamma, or the delay, by up to a factor of ten.

The optimum of the LMI is smooth in k1, k2, and its multipliers give the gradient for free. From
a few fixed starts, k2 a multiple of 1/d and k1 a multiple of k2, the best is improved by a
bounded quasi-Newton descent in log k2 and k1/k2. Nothing is random: the same system gives the
same k1, k2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import scipy

from cosim.core import report
from cosim.hinf.lmi import ROUGH_TOLERANCE, Answer, Array, Problem, Solution
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem, Matrix

_MEDIUM, _LARGE, _VERY_LARGE = 100, 200, 600
"""Unknowns from which a search spends fewer solves: each takes a tenth of a second, one, or ten."""
_SCALES = (0.05, 0.2, 0.5, 1.0)
_RATIOS = (-1.0, -0.2)
MULTIPLES = (1e-4, 1e3)
"""k2 stays within these multiples of 1/d."""
RATIO_LIMIT = 20.0
"""|k1 / k2| stays within this."""
_STEPS_ALONG = 15
_STEPS = 20
_STALLED, _STALLED_IF_MEDIUM = 4, 2  # solves without progress after which a descent ends
_PROGRESS = 1e-4  # relative
_APART = 0.1

Ask = Callable[[Scalars], Answer | None]


def least_gamma(
    problem: Problem,
    p: Scalars,
    gain: Matrix | None = None,
    *,
    ends_at: Callable[[Answer], bool] = lambda _: False,
) -> list[tuple[Scalars, Answer]]:
    """Return the k1, k2 that were passed and the points of least gamma, the best first.

    `p` has the delays, and k1, k2 to start from beside the fixed starts; with a `gain`, its
    least gamma is searched. The best may lie where the gain grows without bound and nothing can
    be proved, so the others are kept: each is worse than the one before by `_APART` at least.

    ends_at : whether the best so far is enough, asked once of the starts and of each better one.
    """
    passed = _Passed(problem, p, gain, ends_at)
    size = problem.size
    feasible = _feasible_starts(passed.ask, p, valley=size >= _LARGE)
    if size >= _VERY_LARGE:
        feasible = feasible[:0]
    # k1 = -k2 is a narrow valley: first along it, from two starts since the best may lead to a
    # worse local minimum, then across
    ends: list[tuple[Scalars, float]] = []
    stalled = _STALLED if size < _MEDIUM else _STALLED_IF_MEDIUM
    for at, _ in sorted(feasible, key=lambda x: x[1])[:2]:
        ends += passed.descend(at, steps=_STEPS_ALONG, ratios=False, most_stalled=stalled)
    if ends and size < _MEDIUM:
        passed.descend(min(ends, key=lambda x: x[1])[0], steps=_STEPS)
    kept: list[tuple[Scalars, Answer]] = []
    for at, answer in sorted(passed.points, key=lambda x: x[1].value):
        if not kept or answer.value > kept[-1][1].value * (1 + _APART):
            kept.append((at, answer))
    return kept


class _Passed:
    """The points of least gamma that a search has passed, and whether the best is enough."""

    def __init__(
        self,
        problem: Problem,
        p: Scalars,
        gain: Matrix | None,
        ends_at: Callable[[Answer], bool],
    ) -> None:
        self._problem, self._gain, self._ends_at = problem, gain, ends_at
        self._expected = len(starts(p)) + 2 * _STEPS_ALONG + _STEPS
        self._known: dict[tuple[str, ...], Answer | None] = {}
        self._judged: tuple[float, bool] = (math.inf, False)
        self.points: list[tuple[Scalars, Answer]] = []

    def ask(self, at: Scalars) -> Answer | None:
        """Return the point of least gamma at k1, k2; a descent asks again where it starts."""
        report("searching k1, k2", len(self._known) / self._expected)
        key = tuple(f"{x:.12g}" for x in (*at.k1, *at.k2))
        if key not in self._known:
            solved = self._problem.least_gamma(at, self._gain, ROUGH_TOLERANCE)
            answer = self._known[key] = _answer(solved)
            if answer is not None and answer.value > 0:
                self.points.append((at, answer))
        return self._known[key]

    def is_enough(self) -> bool:
        """Whether the best so far ends the search."""
        if self.points:
            best = min((answer for _, answer in self.points), key=lambda x: x.value)
            if best.value < self._judged[0]:
                self._judged = best.value, self._ends_at(best)
        return self._judged[1]

    def descend(self, start: Scalars, **how: Any) -> list[tuple[Scalars, float]]:
        """Return where a descent ends; nothing where the best so far is enough."""
        if self.is_enough():
            return []
        return [_descend(self.ask, start, lambda _: self.is_enough(), **how)]


def widest_margin(
    problem: Problem, p: Scalars, gamma: float | None, gain: Matrix | None = None
) -> tuple[Scalars, float] | None:
    """Return k1, k2 with a margin at the delays of `p`, and the margin; < 0: none was found."""
    asked = count()
    expected = len(starts(p)) + 2 * _STEPS

    def ask(at: Scalars) -> Answer | None:
        report("searching k1, k2 for stability", next(asked) / expected)
        return _answer(problem.margin(at, gamma, gain, tolerance=ROUGH_TOLERANCE))

    feasible = _feasible_starts(ask, p)
    if not feasible:
        return None
    best, value = max(feasible, key=lambda x: x[1])
    if value > 0:
        return best, value
    best, value = _descend(
        ask, best, lambda answer: answer.value > 0.0, sign=-1.0, most_stalled=2 * _STEPS
    )
    return best, -value


def initial_scalars(
    system: DelaySystem,
    k1: Sequence[float] | None,
    k2: Sequence[float] | None,
    search: bool | None,  # noqa: FBT001 - passed on as it was given
) -> tuple[Sequence[float], Sequence[float], bool]:
    """Return k1, k2 to start from, and whether to search: by default where neither is given.

    If one is given, the other is its negative; if none is, k2 = 1/(2d).
    """
    if k1 is None and k2 is None:
        positive = [delay.d for delay in system.delays if delay.d > 0]
        k2 = [0.5 / (delay.d or min(positive, default=1.0)) for delay in system.delays]
        search = search is None or search
    if k2 is None:
        k2 = [-value for value in k1 or ()]
    if k1 is None:
        k1 = [-value for value in k2]
    return k1, k2, bool(search and system.delays)


def starts(p: Scalars) -> list[Scalars]:
    """Return `p` itself, and k2 = c/d, k1 = r k2 for fixed c and r."""
    if not any(d > 0 for d in p.d):
        return [p]
    return [p, *(scalars_at(p.d, c, r) for c in _SCALES for r in _RATIOS)]


def scalars_at(d: tuple[float, ...], multiple: float, ratio: float = -1.0) -> Scalars:
    """Return k2 = multiple / d, for a delay of zero that of the shortest other one, and k1 / k2.

    d : one of them positive.
    """
    shortest = min(x for x in d if x > 0)
    k2 = tuple(multiple / (x or shortest) for x in d)
    return Scalars(tuple(ratio * value for value in k2), k2, d)


def _feasible_starts(ask: Ask, p: Scalars, *, valley: bool = False) -> list[tuple[Scalars, float]]:
    """Return the starts at which the solver has an answer, with its value.

    valley : leave out the fixed starts away from k1 = -k2.
    """
    given, *fixed = starts(p)
    if valley:
        fixed = [at for at in fixed if all(x == -y for x, y in zip(at.k1, at.k2, strict=True))]
    tried = [(at, ask(at)) for at in (given, *fixed)]
    return [(at, answer.value) for at, answer in tried if answer is not None]


class SearchDoneError(Exception):
    """Ends a search whose result is good enough."""


def _descend(
    ask: Ask,
    start: Scalars,
    is_enough: Callable[[Answer], bool],
    *,
    sign: float = 1.0,
    steps: int = 2 * _STEPS,
    ratios: bool = True,
    most_stalled: int = _STALLED,
) -> tuple[Scalars, float]:
    """Minimise sign * value from a feasible start; end early where it is enough, or stalls.

    is_enough : asked of every answer.
    ratios : change k1/k2 as well.
    most_stalled : solves without progress after which it ends.
    """
    N = len(start.k2)
    signs = np.sign(start.k2)
    lengths = [d if d > 0 else 1.0 for d in start.d]
    best: list[tuple[Scalars, float]] = []
    stalled = 0

    def scalars(u: Array) -> Scalars:
        k2 = signs * np.exp(u[:N])
        k1 = u[N:] * k2
        return replace(start, k1=tuple(map(float, k1)), k2=tuple(map(float, k2)))

    def value(u: Array) -> tuple[float, Array]:
        nonlocal stalled
        at = scalars(u)
        answer = ask(at)
        if answer is None and not best:
            raise SearchDoneError  # the start itself, rounded: at the edge of what can be solved
        if best and answer is not None:
            stalled *= sign * answer.value >= best[0][1] - _PROGRESS * abs(best[0][1])
        stalled += 1
        if stalled > most_stalled:
            raise SearchDoneError
        if answer is None:
            # a high value makes the line search turn back
            return 10.0 * abs(best[0][1]) + 10.0, np.zeros(2 * N)
        here = sign * answer.value
        if not best or here < best[0][1]:
            best[:] = [(at, here)]
        if is_enough(answer):
            raise SearchDoneError
        by_k1, by_k2 = sign * answer.slopes[:N], sign * answer.slopes[N : 2 * N]
        k1, k2 = np.array(at.k1), np.array(at.k2)
        across = by_k1 * k2 if ratios else np.zeros(N)
        return here, np.concatenate([by_k1 * k1 + by_k2 * k2, across])

    u = np.concatenate([np.log(np.abs(start.k2)), np.array(start.k1) / np.array(start.k2)])
    bounds = [(math.log(MULTIPLES[0] / d), math.log(MULTIPLES[1] / d)) for d in lengths]
    bounds += [(-RATIO_LIMIT, RATIO_LIMIT)] * N
    inside = np.clip(u, *np.array(bounds).T)
    if not np.array_equal(inside, u):
        return start, sign * _value(ask(start))
    with suppress(SearchDoneError):
        scipy.optimize.minimize(
            value,
            u,
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxfun": steps, "ftol": 1e-9, "gtol": 1e-7},
        )
    return best[0] if best else (start, sign * _value(ask(start)))


def _answer(solved: Answer | Solution) -> Answer | None:
    return solved if isinstance(solved, Answer) else None


def _value(answer: Answer | None) -> float:
    return math.inf if answer is None else answer.value


def scaled(p: Scalars, delay_index: int, d: float) -> Scalars:
    """Return `p` with one delay changed, and its k1, k2 in proportion to 1/d."""
    scale = p.d[delay_index] / d

    def put(values: Sequence[float], value: float) -> tuple[float, ...]:
        return (*values[:delay_index], value, *values[delay_index + 1 :])

    return Scalars(
        put(p.k1, p.k1[delay_index] * scale), put(p.k2, p.k2[delay_index] * scale), put(p.d, d)
    )
