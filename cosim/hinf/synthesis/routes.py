"""The routes of a design: each ends in a proved gain, or in the reason why it does not.

They are tried in one order (`designed_by_some_route`), and an error lists all of them:

1. Theorem 2, at the k1, k2 given or searched;
2. Theorem 2 with k1, k2 searched, where those given fail;
3. the Bessel-Legendre conditions of order 1 and 2, from the gains found so far and from starts
   of their own;
4. the plain LMI in cvxpy.

The first that succeeds ends them, but order 1 is also tried where it pays: k1, k2 are not given,
a delay is constant, and the system is small. The gain is then analysed by the sharpest
conditions that are affordable, and the best proof is claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from cosim.core import NotAchievableError
from cosim.hinf.nominal import NominalFigures, nominal_figures_of
from cosim.hinf.synthesis import synthesis
from cosim.hinf.synthesis.analysis import analysed
from cosim.hinf.synthesis.bessel_legendre_designs import as_design, bessel_legendre_design
from cosim.hinf.synthesis.bessel_legendre_loop import Gain
from cosim.hinf.synthesis.cvxpy_lmi import cvxpy_design
from cosim.hinf.synthesis.stabilisability import NoGainError, unstabilisable_error
from cosim.hinf.synthesis.synthesis import Design
from cosim.models import DelaySystem

_NO_ROUTE_LEFT = (
    "a larger gamma (--gamma), a shorter delay, a smaller envelope, weaker constraints, or other "
    "units for states, inputs and time"
)
_DESIGN_UNKNOWNS = 60
_ANALYSIS_UNKNOWNS = 240
"""Unknowns of the analysis up to which an order is affordable: a few seconds at most."""
_ORDERS = (1, 2)
_MUCH = 0.1  # share of gamma worth a proof of exactly these delays, or an odd gain


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
    """One way to a proved gain: its name in messages, and the design itself."""

    name: str
    design: Callable[[Sequence[Design]], Design]
    improves: bool = False


def designed_by_some_route(asked: Request) -> Design:
    """Return the design of the first route that succeeds, or of a later one that improves it.

    Raises
    ------
    NotAchievableError : the error of the first route, with the others listed.
    """
    found: list[Design] = []
    errors: list[tuple[str, NotAchievableError]] = []
    for route in _routes(asked):
        if found and not route.improves:
            continue
        try:
            found.append(route.design(found))
        except NotAchievableError as error:
            if isinstance(error, NoGainError):
                raise
            errors.append((route.name, error))
            if len(errors) == 1 and not found:
                cause = unstabilisable_error(asked.system)
                if cause is not None:
                    raise cause from None
    if not found:
        raise none_succeeded(errors)
    return preferred([analysed_again(one) if asked.gamma is None else one for one in found])


def none_succeeded(errors: Sequence[tuple[str, NotAchievableError]]) -> NotAchievableError:
    """Return the error of the first route, with those of the others and the first refutation."""
    first = errors[0][1]
    if len(errors) == 1:
        return first
    got = first.got or first.what
    others = [f"{name}: {error.what}" for name, error in errors[1:]]
    proofs = [error.certificate for _, error in errors if error.certificate is not None]
    return NotAchievableError(
        first.what,
        where=first.where,
        expected=first.expected,
        got=f"{got}; tried as well: {'; '.join(others)}" if others else got,
        hint=_NO_ROUTE_LEFT if others else first.hint,
        certificate=next(iter(proofs), None),
    )


def analysed_again(found: Design) -> Design:
    """Return the design with the best proof of its gain that is affordable."""
    if found.gamma is None or found.abscissa is None or found.order not in (None, 0):
        return found
    figures = NominalFigures(**{name: getattr(found, name) for name in NominalFigures._fields})
    proofs = [found]
    if unknowns_of_analysis(found.system, 0) > _ANALYSIS_UNKNOWNS:
        return found
    for order in orders_of_analysis(found.system):
        again = analysed(found.system, found.K, None, order, figures)
        if again.certified:
            proofs.append(as_design(again, found.worst_case))
        if _is_exact(proofs[-1]):
            break
    best = preferred(proofs)
    return replace(best, least_gamma=best.least_gamma or found.least_gamma)


def proved_gain(system: DelaySystem, K: Gain, gamma: float | None) -> Design | None:
    """Return the best proof of a given gain by the orders that are affordable; None without."""
    proofs = []
    try:
        figures = nominal_figures_of(system, K)
    except NotAchievableError:
        return None  # roots that cannot be counted: Theorem 2 does not need them
    for order in orders_of_analysis(system):
        again = analysed(system, K, gamma, order, figures)
        if again.certified:
            proofs.append(as_design(again))
            if gamma is not None or _is_exact(proofs[-1]):
                break
    return preferred(proofs) if proofs else None


def orders_of_analysis(system: DelaySystem) -> list[int]:
    """Return the affordable orders; 0 always."""
    constant = any(x.d > 0 and not x.any_age for x in system.delays)
    orders = _ORDERS if constant else ()
    # each order gains less than the one before
    affordable = (n for n in orders if n * unknowns_of_analysis(system, n) <= _ANALYSIS_UNKNOWNS)
    return [0, *affordable]


def preferred(designs: Sequence[Design]) -> Design:
    """Return the design of least gamma; where little is lost, one that covers smaller delays.

    So too one whose nominal figures can be computed: otherwise its gain is out of all proportion.
    """

    def value(one: Design) -> float:
        worse = (not one.covers_smaller_delays) + 2 * (one.abscissa is None)
        return (one.gamma or 0.0) * (1.0 + _MUCH) ** worse

    return min(designs, key=value)


def unknowns_of_analysis(system: DelaySystem, order: int) -> int:
    """Return the number of unknowns of an analysis of this order: a measure of its cost."""
    n = len(system.A)
    late = [x for x in system.delays if x.d > 0]
    rows = n * (1 + sum(0 if x.any_age else order for x in late))
    constant = sum(not x.any_age for x in late)
    return rows * (rows + 1) // 2 + (len(late) + constant) * n * (n + 1) // 2


def _is_exact(found: Design) -> bool:
    """Whether no analysis of the same gain can be sharper: gamma is the nominal norm."""
    return bool(found.exact_norm and (found.gamma or 0.0) < found.exact_norm * (1 + 1e-3))


def _routes(asked: Request) -> Iterator[Route]:
    s, gamma = asked.system, asked.gamma
    constant = any(x.d > 0 and not x.any_age for x in s.delays)
    late = any(x.d > 0 for x in s.delays)

    def theorem_2(found: Sequence[Design], *, search: bool) -> Design:
        del found
        return synthesis.design(s, asked.k1, asked.k2, gamma=gamma, search=search)

    def of_order(order: int) -> Callable[[Sequence[Design]], Design]:
        def make(found: Sequence[Design]) -> Design:
            starts = [one.K for one in found]
            return bessel_legendre_design(
                s, asked.k1, asked.k2, order=order, gamma=gamma, starts=starts
            )

        return make

    searched = bool(asked.search)
    yield Route(
        "Theorem 2 with k1, k2 searched" if searched else "Theorem 2 at these k1, k2",
        lambda found: theorem_2(found, search=searched),
    )
    if not searched and asked.search is None and s.delays:
        yield Route("Theorem 2 with k1, k2 searched", lambda found: theorem_2(found, search=True))
    if late:
        for order in _ORDERS if constant else (0,):
            small = unknowns_of_analysis(s, order) <= _DESIGN_UNKNOWNS
            pays = constant and small and not asked.given and gamma is None and order == 1
            if small or unknowns_of_analysis(s, order) <= _ANALYSIS_UNKNOWNS:
                yield Route(f"order {order}", of_order(order), improves=pays)
    yield Route(
        "the plain LMI in cvxpy",
        lambda _: cvxpy_design(
            s, asked.k1, asked.k2, gamma=gamma, search=asked.search is not False
        ),
    )
