"""The routes of a design: the search proposes gains, the conditions prove them.

Every route ends in a proved gain, or in the reason why it does not. They are tried in one order
(`designed_by_some_route`), and an error lists all of them:

1. Theorem 2, at the k1, k2 given or searched; where the least gamma asks for a gain out of all
   proportion, its gains with a price on Y = K X (`priced_gains`) come first;
2. Theorem 2 with k1, k2 searched, where those given fail;
3. the gain of Theorem 2 for stability alone, and what the Bessel-Legendre condition of order 0
   makes of it;
4. gains that the Bessel-Legendre conditions of order 1 and 2 propose, from the gains found so far
   and from starts of their own;
5. the plain LMI in cvxpy;
6. gains that a direct descent on the exact norm proposes, where the system is small;
7. gains for shorter delays, continued to these.

Where more is known of an age than its bound, Theorem 2 and the LMI of these ages propose gains,
and an analysis with these ages proves them.

The first that succeeds ends them, but order 1 is also tried where it pays: k1, k2 are not given,
a delay is constant, and the system is small. The gain is then analysed by the sharpest
conditions that are affordable, and the best proof is claimed. Where none improves that of
Theorem 2 and gamma is not near the exact norm, the best gain with a price on Y is analysed as
well. Of a small system the gain is improved last, by the LMI that is convex for the multipliers
of its analysis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice

import numpy as np

from cosim.core import NotAchievableError, report
from cosim.hinf.delay_lti import nominal_figures_of
from cosim.hinf.problem import ages_are_known, of_any_age
from cosim.hinf.synthesis import theorem_2_gamma
from cosim.hinf.synthesis.ages_gains import (
    gains_for_shorter_ages,
    gains_of_the_ages,
    is_past_the_best,
    nearest_to_a_goal,
)
from cosim.hinf.synthesis.analysis import Order, best_analysis, is_exact, preferred
from cosim.hinf.synthesis.bessel_legendre_gains import bessel_legendre_gains, improved_gain
from cosim.hinf.synthesis.cvxpy_lmi import cvxpy_design
from cosim.hinf.synthesis.designs import proved_by_analysis
from cosim.hinf.synthesis.gain_size import gain_remark
from cosim.hinf.synthesis.not_achievable import none_succeeded
from cosim.hinf.synthesis.priced_gains import priced_gains
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.stabilisability import NoGainError, unstabilisable_error
from cosim.hinf.synthesis.structured_gains import descent_design
from cosim.models import DelaySystem, Matrix

_DESIGN_UNKNOWNS = 60
_MOST_UNKNOWNS = 240
"""Unknowns of the analysis up to which a design of this order takes seconds; minutes at most."""
_CONTINUED_UNKNOWNS = 100
_ORDERS = (1, 2)
_IMPROVABLE = 1.02
"""Of a gamma by Theorem 2 to the exact norm, from which other gains are tried."""
_IMPROVED_UNKNOWNS = 90
"""Unknowns of the analysis up to which a gain is improved: seven states with one delay."""
_AT_THE_FLOOR = 1.001
"""Of a gamma to |D1|, below which no gain has less."""
_CLOSE = 0.95
"""Of a least gamma to a proved one, at which gains out of all proportion are not tried."""


@dataclass(frozen=True)
class Request:
    """What is asked of a design, apart from design constraints.

    k1, k2 : to start from, one number per delay.
    given : whether the caller chose them.
    search : True: search k1, k2; None: where those given fail; False: never.
    gamma : a bound to meet, or None.
    """

    system: DelaySystem
    k1: Sequence[float]
    k2: Sequence[float]
    given: bool
    search: bool | None
    gamma: float | None


@dataclass(frozen=True)
class Route:
    """One way to a proved gain: its name in messages, and the design itself.

    design : from the designs found so far.
    improves : whether to try it after another one has succeeded.
    """

    name: str
    design: Callable[[Sequence[Result]], Result]
    improves: bool = False


def designed_by_some_route(asked: Request, order: Order = "auto") -> Result:
    """Return the design of the first route that succeeds, or of a later one that improves it.

    order : of the analysis where ages are known.

    Raises
    ------
    NotAchievableError : the error of the first route, with the others listed.
    """
    designs: list[Result] = []
    errors: list[tuple[str, NotAchievableError]] = []
    known = ages_are_known(asked.system)
    for route in _routes_with_ages(asked, order) if known else _routes(asked):
        if designs and not route.improves:
            continue
        report(route.name, 0.0)
        try:
            designs.append(route.design(designs))
        except NotAchievableError as error:
            if isinstance(error, NoGainError):
                raise
            errors.append((route.name, error))
            if len(errors) == 1 and not designs:
                cause = unstabilisable_error(asked.system)
                if cause is not None:
                    raise cause from None
    if not designs:
        raise none_succeeded(errors)
    if asked.gamma is not None:
        return preferred(designs)
    best = _with_a_price(asked, preferred([analysed_again(one) for one in designs]))
    return best if known or asked.given else _improved(best)


def _with_a_price(asked: Request, designed: Result) -> Result:
    """Return the design of a gain with a price on Y, where no analysis improves Theorem 2's own.

    That gain may be of a size with which the solver finds nothing.
    """
    s, gamma, norm = asked.system, designed.gamma, designed.exact_norm
    if designed.order is not None or gamma is None or norm is None or not _has_a_price(s):
        return designed
    if gamma < norm * _IMPROVABLE or _unknowns(s, 0) > _MOST_UNKNOWNS:
        return designed
    for K in islice(priced_gains(s, designed.least_gamma or gamma), 1):
        return _or_better(designed, K)
    return designed


def _or_better(designed: Result, K: Matrix) -> Result:
    """Return a design, or the best proof of another gain of the same system."""
    s = designed.system
    again = best_analysis(s, K, None, "auto", nominal_figures_of(s, K), below=designed.gamma)
    return designed if again.certificate is None else preferred([designed, again])


def _improved(designed: Result) -> Result:
    """Return the design of a gain that a few rounds of order 0 make of this one, if it is better.

    Its size has to stay in proportion. At `_IMPROVED_UNKNOWNS` the rounds take as long as a design.
    """
    s, gamma = designed.system, designed.gamma
    floor = float(np.linalg.norm(s.D1, 2)) * _AT_THE_FLOOR
    if gamma is None or gamma < floor or not _has_delay(s):
        return designed
    if _unknowns(s, 0) > _IMPROVED_UNKNOWNS:
        return designed
    report("a better gain near this one", 0.0)
    # what is proved stays so, whatever the numbers of another gain do
    with suppress(NotAchievableError, ArithmeticError, np.linalg.LinAlgError):
        K = improved_gain(s, designed.K)
        if K is None or (gain_remark(s, K) and not gain_remark(s, designed.K)):
            return designed
        return _or_better(designed, K)
    return designed


def _has_delay(system: DelaySystem) -> bool:
    return any(x.d > 0 for x in system.delays)


def _has_a_price(system: DelaySystem) -> bool:
    """Whether gains with a price are proposed: z contains every input, and there is a delay."""
    return bool(_has_delay(system) and system.has_performance and system.D2.any(axis=0).all())


def analysed_again(designed: Result) -> Result:
    """Return a design of Theorem 2 with the best proof of its gain that is affordable."""
    if designed.gamma is None or designed.abscissa is None or designed.order is not None:
        return designed
    return _proved_again(designed)


def _proved_again(designed: Result) -> Result:
    """Return a design with a proof of its gain by an analysis, where that one is better."""
    if _unknowns(designed.system, 0) > _MOST_UNKNOWNS or is_exact(designed):
        return designed
    report("the best proof of this gain", 0.0)
    again = best_analysis(
        designed.system, designed.K, None, "auto", designed.figures, below=designed.gamma
    )
    if again.certificate is None:
        return designed
    best = preferred([designed, again])
    return replace(best, least_gamma=best.least_gamma or designed.least_gamma)


def _routes(asked: Request) -> Iterator[Route]:
    s, gamma = asked.system, asked.gamma
    constant = any(x.d > 0 and not x.any_age for x in s.delays)

    def theorem_2_at(designs: Sequence[Result], *, search: bool) -> Result:
        del designs
        return _by_theorem_2(asked, search=search)

    def proposed(designs: Sequence[Result], *, order: int, continued: bool) -> Result:
        starts = [one.K for one in designs]
        gains = bessel_legendre_gains(s, order, starts, gamma, continued=continued)
        return proved_by_analysis(s, gains, gamma, "auto")

    def for_stability(designs: Sequence[Result]) -> Result:
        del designs
        K = theorem_2_gamma.stabilising_gain(s, asked.k1, asked.k2)
        starts = [] if K is None else [K]
        better: Iterator[Matrix] = iter(())
        if starts and _has_delay(s) and _unknowns(s, 0) <= _MOST_UNKNOWNS:
            better = bessel_legendre_gains(s, 0, starts, gamma, continued=False)
        return proved_by_analysis(s, chain(better, starts), gamma, "auto")

    searched = bool(asked.search)
    yield Route(
        theorem_2_route(asked, searched=searched),
        partial(theorem_2_at, search=searched),
    )
    if not searched and asked.search is None and s.delays:
        name = theorem_2_route(asked, searched=True)
        yield Route(name, partial(theorem_2_at, search=True))
    if s.has_performance:
        yield Route("Theorem 2 for stability, then its gain", for_stability)
    orders = [n for n in (_ORDERS if constant else (0,)) if _has_delay(s)]
    orders = [n for n in orders if _unknowns(s, n) <= _MOST_UNKNOWNS]
    for order in orders:
        pays = constant and is_small(s) and not asked.given and gamma is None and order == 1
        yield Route(f"order {order}", partial(proposed, order=order, continued=False), pays)
    yield Route(
        "the plain LMI in cvxpy",
        lambda _: cvxpy_design(
            s, asked.k1, asked.k2, gamma=gamma, search=asked.search is not False
        ),
    )
    if _unknowns(s, 0) <= _MOST_UNKNOWNS:
        yield Route("a descent on the exact norm", lambda _: descent_design(s, gamma))
    for order in orders[:1] if orders and _unknowns(s, orders[0]) <= _CONTINUED_UNKNOWNS else ():
        continued = partial(proposed, order=order, continued=True)
        yield Route(f"order {order}, continued from shorter delays", continued)


def _routes_with_ages(asked: Request, order: Order) -> Iterator[Route]:
    """Routes where more is known of an age than its bound."""
    s, gamma, search = asked.system, asked.gamma, bool(asked.search)
    tried: list[Result] = []

    def past_the_best(made: Sequence[Result]) -> bool:
        tried[:] = made
        return is_past_the_best(made)

    def shorter(designs: Sequence[Result]) -> Result:
        del designs
        failures: list[str] = []
        gains = gains_for_shorter_ages(s, asked.k1, asked.k2, failures, search=search)
        try:
            return proved_by_analysis(
                s, gains, gamma, order, enough=past_the_best, ranking=order == "auto"
            )
        except NotAchievableError as error:
            if failures:
                error.got = "; ".join([str(error.got), *failures[:2]])
            raise

    def of_the_ages(designs: Sequence[Result]) -> Result:
        # where a gamma is missed, from the gain that came nearest to it
        start = (designs[0].K, designs[0].gamma) if designs else nearest_to_a_goal(tried)
        gains = gains_of_the_ages(s, 1 if order == "auto" else order, start)
        return proved_by_analysis(s, gains, gamma, order, enough=lambda _: False)

    def by_cvxpy(designs: Sequence[Result]) -> Result:
        del designs
        plain = cvxpy_design(of_any_age(s), asked.k1, asked.k2, search=asked.search is not False)
        return proved_by_analysis(s, [plain.K], gamma, order)

    yield Route("Theorem 2 for ages up to these or shorter ones", shorter)
    yield Route("the LMI of these ages", of_the_ages, improves=gamma is None)
    yield Route("the plain LMI in cvxpy, for any age", by_cvxpy)
    yield Route("a descent on the exact norm", lambda _: descent_design(s, gamma, order))


def _by_theorem_2(asked: Request, *, search: bool) -> Result:
    """Design by Theorem 2; where that asks for a gain out of all proportion, with a price on it."""
    s, gamma = asked.system, asked.gamma
    priced: Result | None = None
    if (
        search and gamma is None and _has_a_price(s) and not is_small(s)
    ):  # for those order 1 does it
        try:
            return theorem_2_gamma.design(s, asked.k1, asked.k2, search=True, in_proportion=True)
        except theorem_2_gamma.OutOfProportionError as error:
            with suppress(NotAchievableError):  # then with a gain of whatever size
                priced = proved_by_analysis(s, priced_gains(s, error.least), None, 0)
            if priced is not None and error.least > _CLOSE * (priced.gamma or 0.0):
                return _proved_again(priced)
    below = None if priced is None else priced.gamma
    try:
        return theorem_2_gamma.design(
            s, asked.k1, asked.k2, gamma=gamma, search=search, below=below
        )
    except NotAchievableError:
        if priced is None:
            raise
        return priced


def theorem_2_route(asked: Request, *, searched: bool) -> str:
    """Return the name of the route by Theorem 2; of k1, k2 it speaks where the caller gave them."""
    if not asked.given:
        return "Theorem 2"
    return f"Theorem 2 {'with k1, k2 searched' if searched else 'at these k1, k2'}"


def is_small(system: DelaySystem) -> bool:
    """Whether designs of order 1 take about a second."""
    return _unknowns(system, 1) <= _DESIGN_UNKNOWNS


def _unknowns(system: DelaySystem, order: int) -> int:
    """Return the number of unknowns of an analysis of this order: a measure of its cost."""
    n = len(system.A)
    positive = [x for x in system.delays if x.d > 0]
    rows = n * (1 + sum(0 if x.any_age else order for x in positive))
    constant = sum(not x.any_age for x in positive)
    return rows * (rows + 1) // 2 + (len(positive) + constant) * n * (n + 1) // 2
