"""The greatest delay as users ask for it, by every condition (Remark 3 of the paper)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

from cosim.core import NotAchievableError
from cosim.hinf.delay_lti import checked_system
from cosim.hinf.lmi import OTHER_UNITS
from cosim.hinf.problem import DELAY_LIMIT, ages_are_known, of_any_age, refuse_structure
from cosim.hinf.synthesis.analysis import Order
from cosim.hinf.synthesis.delay_result import GreatestDelay
from cosim.hinf.synthesis.delay_routes import delay_by_order, delay_by_theorem_2
from cosim.hinf.synthesis.designs import check_achievable
from cosim.hinf.synthesis.improved_delays import improved_delay
from cosim.hinf.synthesis.not_achievable import none_succeeded
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.routes import Request, designed_by_some_route, is_small
from cosim.hinf.synthesis.search import initial_scalars
from cosim.hinf.synthesis.stabilisability import NoGainError
from cosim.models import DelaySystem

_Asked = tuple[float | None, Sequence[float], Sequence[float], int, float]
"""gamma, k1, k2, the index of the delay and its limit [s]."""
_WORTH = 1.02
"""By how much a delay by order 1 must be longer than one by Theorem 2, which covers any age."""


def greatest_delay(
    system: DelaySystem,
    gamma: float | None,
    k1: Sequence[float] | None = None,
    k2: Sequence[float] | None = None,
    *,
    delay_index: int = 0,
    limit: float = DELAY_LIMIT,
    search: bool | None = None,
    order: int | Literal["auto"] | None = None,
) -> GreatestDelay:
    """Find the greatest delay `delay_index` at which a gain with this gamma is certified.

        >>> from cosim import link
        >>> from cosim.hinf import DelaySystem, greatest_delay
        >>> system = DelaySystem(
        ...     A=[[0.1]], B=[[1]], C=[[1]], D=[[1], [0]], D2=[[0], [1]], delays=[link(0.1)]
        ... )
        >>> found = greatest_delay(system, 2.0, k1=[-1], k2=[1])
        >>> 0.5 < found.delay < 0.7, found.result.gamma <= 2.0, found.result.K.shape
        (True, True, (1, 1))

    Parameters
    ----------
    system : the delays other than `delay_index` are kept.
    gamma : bound of the gain from w to z; None, for stability, without w and z.
    k1, k2 : one number per delay; where searched, the first start. Without both, a search.
    delay_index : index of the delay.
    limit : where the search ends [s].
    search : look for better k1, k2 as well.
    order : None for Theorem 2, for ages of any variation, with a refutation just beyond; N for
        the Bessel-Legendre condition of order N; "auto" for Theorem 2, then orders 0 and 1 where
        it certifies no delay, and order 1 where it pays (a small system with a constant delay,
        k1, k2 not given). With N or "auto", what else is known of an age than its bound is used.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no delay at all can be certified.
    """
    system = checked_system(system, control=True)
    refuse_structure(
        system, "the greatest delay of a design", "design a gain, then analyse it with max delay"
    )
    given = k1 is not None or k2 is not None
    one, two, look = initial_scalars(system, k1, k2, search)
    if gamma is not None:
        check_achievable(gamma, system)
    asked = gamma, one, two, delay_index, limit
    greatest, errors = _by_conditions(of_any_age(system), asked, order, given=given, search=look)
    if ages_are_known(system) and order is not None:
        of_analysis: Order = order if isinstance(order, int) else "auto"

        def design_at(there: DelaySystem) -> Result:
            return designed_by_some_route(Request(there, one, two, given, look, gamma), of_analysis)

        greatest = improved_delay(
            system,
            gamma,
            greatest,
            design_at,
            delay_index=delay_index,
            limit=limit,
            order=of_analysis,
        )
    if greatest is None:
        raise none_succeeded(errors, "a larger gamma" if gamma is not None else OTHER_UNITS)
    return greatest


def _by_conditions(
    system: DelaySystem, asked: _Asked, order: Order | None, *, given: bool, search: bool
) -> tuple[GreatestDelay | None, list[tuple[str, NotAchievableError]]]:
    """Return the greatest delay by the conditions that are worth trying, and what each lacked."""
    errors: list[tuple[str, NotAchievableError]] = []
    greatest: GreatestDelay | None = None
    plain: GreatestDelay | NotAchievableError | None = None
    for condition, improves in _conditions_of_delay(system, order, given=given):
        if greatest is not None and not improves:
            continue
        try:
            if condition is None:
                tried = plain = delay_by_theorem_2(system, *asked, search=search)
            else:
                tried = delay_by_order(system, *asked, search=search, order=condition, plain=plain)
        except NoGainError:
            raise
        except NotAchievableError as error:
            plain = error if condition is None else plain
            errors.append(("Theorem 2" if condition is None else f"order {condition}", error))
            continue
        if greatest is None or (tried.delay or 0.0) > _WORTH * (greatest.delay or 0.0):
            greatest = tried
    return greatest, errors


def _conditions_of_delay(
    system: DelaySystem, order: Order | None, *, given: bool
) -> Iterator[tuple[int | None, bool]]:
    """Yield the conditions to find a delay by, and whether each is to improve the one before.

    Order 1 after Theorem 2 where a design would try it too; order 0 before it where it is slow.
    """
    if order != "auto":
        yield order, False
        return
    yield None, False
    small = is_small(system)
    if not small:
        yield 0, False
    yield 1, small and not given and any(not x.any_age for x in system.delays if x.d > 0)
